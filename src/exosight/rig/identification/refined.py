"""Forces on one picture from its outline, the load and an identified model: Gauss–Newton from a known pose.

With the model's parameters p within the intervals of its file, the load within its error and the camera about
where the file says, whitened as x, the least

    ½ |x|² + Σ ρ(d(q(x), x)/σ),    ∇Π(q; x) = 0,

is looked for, with d the distances of the outline's points from the model's silhouette and ρ of Huber, as in
`fit`. Forces and their covariance are those of the equilibrium there,

    f = f(q(x), x),    cov f = G C Gᵀ,    G = df/dx,

C that of `posterior`. Where several stable poses belong to a load, the one that fits best is taken.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from exosight.errors import ConvergenceError, InputError
from exosight.rig.identification.fit import LARGEST_NOISE, Fit, Problem, cost, search, started
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.outlines import Outline
from exosight.rig.identification.parameters import Parameter, Prior, complete, parameters_of
from exosight.rig.identification.posterior import NORMAL_95, posterior
from exosight.rig.identification.response import Model, at_rest, relaxed
from exosight.system.build import build
from exosight.system.description import ActuatorTable
from exosight.system.faults import at_place
from exosight.system.file import Values, describe
from exosight.system.system import System
from exosight.system.units import FORCE, TORQUE, split_quantity

ONE_PICTURE = Prior(gain=0.01, shift=0.0005, scale=0.003, roll=0.005, aside=0.01)
"""Of the load's error, as a share of it, and of what the camera moves between pictures. Of bodies the
intervals of the system file count instead."""
BEYOND = 3.0
"""Times the load, within the channels' range, from which poses are approached that unloading leads to."""
STEPS = 15
SAME_POSE = 1e-4
"""Largest difference of coordinates of one pose that is found in two ways."""
OWN_UNIT = "load"
"""What commands in newtons are called, so that their gain, 1 N, has an entry and may be in error."""


@dataclass(frozen=True)
class Refined:
    """What the model says of one picture.

    readings     (sensors,)           of all sensors of the system [their units]
    covariance   (sensors, sensors)   of their errors
    q            (dofs,)              the pose
    command      (channels,)          that explains the picture best [the channels' units]
    misfit       of the outline, root mean square [pixels]
    rested       whether the search ended because nothing more was to gain
    """

    readings: Float[np.ndarray, " sensors"]
    covariance: Float[np.ndarray, "sensors sensors"]
    q: Float[np.ndarray, " dofs"]
    command: Float[np.ndarray, " channels"]
    misfit: float
    rested: bool

    @property
    def deviations(self) -> Float[np.ndarray, " sensors"]:
        """Standard deviations of the readings [their units]."""
        return np.sqrt(np.diag(self.covariance))


class Refiner:
    """An identified model with what of it is uncertain.

    values   entries of its system file; bodies are uncertain within their `vary` intervals, taken as 95 %
    prior    deviations of load, camera and edges

    Raises InputError for a system with friction.
    """

    def __init__(self, values: Values, prior: Prior = ONE_PICTURE) -> None:
        self._prior = prior
        own = _with_gains(complete(values))
        self.system: System = build(describe(values))
        self._model = Model(own, tuple(uncertain(own, prior)))
        self._gains = [
            next(i for i, each in enumerate(self._model.parameters) if each.entry == f"actuators.{name}.gain")
            for name in describe(own).actuators
        ]

    def refine(
        self,
        outline: Outline,
        command: Float[np.ndarray, " channels"],
        before: Refined | None = None,
    ) -> Refined:
        """Readings of a picture taken at a command [the channels' units].

        before   what was found of the picture before; its pose is one more to start from

        Raises ConvergenceError if no stable pose is found at the command.
        """
        command = self.system.schema.check_commands(command)
        problem = Problem(self._model, Measurements(command[None], (outline,)), self._prior)
        found: list[tuple[Fit, bool]] = []
        x = np.zeros(problem.unknowns)
        for q in self._poses(problem, x, command, before):
            found.append(search(problem, started(problem, x, q[None], LARGEST_NOISE), STEPS))
        if not found:
            shown = " ".join(f"{value:g}" for value in command)
            raise ConvergenceError(
                f"no stable pose of {self.system.name} at the load {shown}; check load and unit"
            )
        # σ is estimated with each; costs are compared at the least.
        noise = min(state.noise for state, _ in found)
        state, rested = min(found, key=lambda each: cost(replace(each[0], noise=noise)))
        return self._result(problem, state, rested, command)

    def _poses(
        self,
        problem: Problem,
        x: Float[np.ndarray, " unknowns"],
        command: Float[np.ndarray, " channels"],
        before: Refined | None,
    ) -> Iterator[Float[np.ndarray, " dofs"]]:
        """Stable poses at the command: from rest, unloaded from beyond, and from the picture before."""
        system = problem.numbers(x).system
        rest, none = at_rest(system), np.zeros_like(command)
        peaks = np.array([abs(channel.peak) for channel in self.system.schema.channels])
        limits = np.maximum(peaks, np.abs(command))
        beyond = np.clip(BEYOND * command, -limits, limits)
        above, reached = relaxed(system, beyond[None], rest[None], none[None])
        starts = [(rest, none)]
        starts += [(above[0], beyond)] * bool(reached[0])
        starts += [] if before is None else [(before.q, before.command)]
        seen: list[np.ndarray] = []
        for q, at in starts:
            pose, stable = relaxed(system, command[None], q[None], at[None])
            if stable[0] and not any(np.abs(pose[0] - other).max() < SAME_POSE for other in seen):
                seen.append(pose[0])
                yield pose[0]

    def _result(
        self, problem: Problem, state: Fit, rested: bool, command: Float[np.ndarray, " channels"]
    ) -> Refined:
        known = posterior(problem, state)
        count = len(self._model.parameters)
        numbers, slopes = problem.numbers(state.x), self._model.slopes(state.x[:count])
        _, _, value, slope = problem.seen(state.x, numbers, slopes, problem.pictures[0], command, state.q[0])
        gradient = np.asarray(slope.readings)  # no reading depends on the camera
        bodies = gradient.shape[-1]
        shares = [
            self._model.parameters[i].value(float(state.x[i])) / self._model.parameters[i].nominal
            for i in self._gains
        ]
        return Refined(
            readings=np.asarray(value.readings),
            covariance=gradient @ known.covariance[:bodies, :bodies] @ gradient.T,
            q=state.q[0],
            command=command * shares,
            misfit=float(np.sqrt(np.mean(state.rows.outline**2))),
            rested=rested,
        )


def uncertain(values: Values, prior: Prior) -> Iterator[Parameter]:
    """Of what can be identified: bodies as their `vary` tables say, gains and camera as the prior does."""
    varied = {table["entry"]: table for table in values.get("vary", ())}
    for each in parameters_of(values, prior, known_gains=False):
        if each.entry in varied:
            yield _within(each, varied[each.entry])
        elif each.entry.startswith(("actuators.", "cameras.")):
            yield each


def _within(parameter: Parameter, vary: Any) -> Parameter:
    """The parameter with the deviation of a `vary` table, whose ends are those of a 95 % interval."""
    place = f"vary {parameter.entry}"
    ends = [at_place(place, split_quantity, vary[end], "1 mm") for end in ("low", "high")]
    if any(unit != parameter.unit for _, unit in ends):
        raise InputError(
            f"{place}: expected its ends in {parameter.unit}, as the entry is, got "
            f"{vary['low']} and {vary['high']}"
        )
    low, high = (number for number, _ in ends)
    width = np.log(high / low) if parameter.size else high - low
    return replace(parameter, deviation=float(width) / (2 * NORMAL_95))


def _with_gains(values: Values) -> Values:
    """The file with a gain at every actuator."""
    tables: dict[str, Any] = {}
    for name, table in describe(values).actuators.items():
        entries = dict(values["actuators"][name])
        tables[name] = entries if table.gain is not None else _with_gain(entries, table)
    return {**values, "actuators": tables}


def _with_gain(entries: dict[str, Any], table: ActuatorTable) -> dict[str, Any]:
    kind = TORQUE if table.type == "joint_torque" else FORCE
    natural = next(iter(kind.units))
    ends = [split_quantity(text, "4 N") for text in table.range]
    entries["range"] = [f"{number * kind.units[unit]!r} {OWN_UNIT}" for number, unit in ends]
    entries["gain"] = f"1.0 {natural}/{OWN_UNIT}"
    return {name: value for name, value in entries.items() if name not in ("rate", "drive")}
