"""What the integration of one robot carries from one Newton step to the next."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.stage_solve import NewtonState, begin_newton
from exosight.mechanics.term import Memories


class Energies(NamedTuple):
    """Kinetic and potential energy; what resistance took and changing loads gave from the start on [J]."""

    kinetic: Float[AnyArray, ""]
    potential: Float[AnyArray, ""]
    dissipated: Float[AnyArray, ""]
    supplied: Float[AnyArray, ""]


class IntegrationState(NamedTuple):
    """One robot between two Newton steps.

    time, q, v         the last accepted point [s; coordinates; coordinates/s]
    energies           there
    contact            time until the first open contact closes at this velocity [s]
    proposed, step     the step that step control asks for, and the one being taken [s]
    stage, newton      the stage being solved (0: the acceleration at the start), and how far it is
    slopes             (stages, 2, dofs) f(Y) = (v, a) of the stages so far
    forces             (stages, channels) ∂Π/∂u at them
    dissipation        (stages,) power of resistance at them [W]
    steps, rejected    accepted and rejected steps
    memories           what the terms remember of the accepted point, see `TermWithMemory`
    failed             given up; the robot stays at the accepted point
    """

    time: Float[AnyArray, ""]
    q: Float[AnyArray, " dofs"]
    v: Float[AnyArray, " dofs"]
    energies: Energies
    contact: Float[AnyArray, ""]
    proposed: Float[AnyArray, ""]
    step: Float[AnyArray, ""]
    stage: Int[AnyArray, ""]
    newton: NewtonState
    slopes: Float[AnyArray, "stages 2 dofs"]
    forces: Float[AnyArray, "stages channels"]
    dissipation: Float[AnyArray, " stages"]
    steps: Int[AnyArray, ""]
    rejected: Int[AnyArray, ""]
    memories: Memories
    failed: Bool[AnyArray, ""]


class Interval(NamedTuple):
    """From one reported time to the next: times [s], and the loads at both, linear in between."""

    start: Float[AnyArray, ""]
    end: Float[AnyArray, ""]
    load: Float[AnyArray, " channels"]
    next_load: Float[AnyArray, " channels"]

    @property
    def span(self) -> Float[AnyArray, ""]:
        """[s]"""
        return self.end - self.start

    @property
    def load_rate(self) -> Float[AnyArray, " channels"]:
        """du/dt [N/s]."""
        return (self.next_load - self.load) / self.span

    def load_at(self, time: Float[AnyArray, ""]) -> Float[Array, " channels"]:
        """u [N]."""
        return jnp.asarray(self.load + (time - self.start) * self.load_rate)


def begin(
    time: float,
    q: Float[np.ndarray, " dofs"],
    v: Float[np.ndarray, " dofs"],
    memories: Memories,
    channels: int,
    stages: int,
) -> IntegrationState:
    """The state before the start of a motion, for so many load channels and stages; in NumPy."""
    none, zero = np.zeros(()), np.zeros((), int)
    return IntegrationState(
        time=none + time,
        q=q,
        v=v,
        energies=Energies(none, none, none, none),
        contact=none + np.inf,
        proposed=none + np.inf,
        step=none,
        stage=zero,
        newton=begin_newton(0 * q),
        slopes=np.zeros((stages, 2, len(q))),
        forces=np.zeros((stages, channels)),
        dissipation=np.zeros(stages),
        steps=zero,
        rejected=zero,
        memories=tuple(np.asarray(memory, float) for memory in memories),
        failed=zero > 0,
    )
