"""Newton's method on one stage of an implicit Runge–Kutta step of the equation of motion.

With y = (q, v) and f(y) = (v, a), stage i of a step h asks for the acceleration A that satisfies

    Q = q* + η V,      V = v* + η A,      r(Q, V, A; u(t_n + c_i h)) = 0,      η = γ h,

(q*, v*) = y_n + h Σ_{j<i} a_ij f(Y_j) being known. One Newton step solves M δQ = −r for M = ∂r/∂q + ∂r/∂v / η
+ ∂r/∂a / η², and then δV = δQ/η, δA = δQ/η². The explicit stage at the start of a motion is the limit η → 0:
Q and V are given, and M η² is the mass matrix, so that the one step, linear in A, is exact.

Source of the test of convergence: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.8.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.equation_of_motion import Linearization
from exosight.mechanics.tableau import Tableau

MAX_ITERATIONS = 10
"""Newton steps for one stage before its time step is shortened."""

_SHORT = 1e-14
"""η of the explicit stage [s]: inertia then outweighs all else in M by far more than round-off."""


class Stage(NamedTuple):
    """What is known of a stage: q* and v* (dofs,), η [s], and whether it is the explicit one, with η = 0."""

    q: Float[Array, " dofs"]
    v: Float[Array, " dofs"]
    eta: Float[Array, ""]
    explicit: Bool[Array, ""]


class NewtonState(NamedTuple):
    """Newton's method between two of its steps.

    a            (dofs,)   the stage's acceleration, as far as it is known
    iterations             steps spent on this stage
    update                 size of the last step [m]
    contraction            ratio of two successive sizes; before the first two, an estimate
    """

    a: Float[AnyArray, " dofs"]
    iterations: Int[AnyArray, ""]
    update: Float[AnyArray, ""]
    contraction: Float[AnyArray, ""]


class NewtonStep(NamedTuple):
    """What one Newton step found.

    q, v, a        (dofs,)   the stage's values after it
    potential                energy Π there [J], to first order in the step
    dissipation              power of viscosity and other resistance there [W], likewise
    update, contraction      see NewtonState
    converged                the stage is solved
    diverged                 it cannot be with this step of time
    """

    q: Float[Array, " dofs"]
    v: Float[Array, " dofs"]
    a: Float[Array, " dofs"]
    potential: Float[Array, ""]
    dissipation: Float[Array, ""]
    update: Float[Array, ""]
    contraction: Float[Array, ""]
    converged: Bool[Array, ""]
    diverged: Bool[Array, ""]


def begin_newton(a: Float[AnyArray, " dofs"]) -> NewtonState:
    """Newton's method at the start of a step of time, from the acceleration there; in NumPy."""
    return NewtonState(a, np.zeros((), int), np.zeros(()), np.ones(()))


def stage_of(
    tableau: Tableau,
    index: Int[AnyArray, ""],
    step: Float[AnyArray, ""],
    y: Float[Array, "2 dofs"],
    slopes: Float[AnyArray, "stages 2 dofs"],
) -> Stage:
    """Stage `index` of a step [s] from y = (q, v), where f(Y_j) of the stages before it are known."""
    start = y + step * jnp.einsum("s,sij->ij", jnp.asarray(tableau.lower)[index], slopes)
    explicit = jnp.asarray(index) == 0
    return Stage(start[0], start[1], jnp.where(explicit, 0.0, tableau.diagonal * step), explicit)


def newton_point(stage: Stage, a: Float[AnyArray, " dofs"]) -> tuple[Array, Array, Array]:
    """Q, V and the η > 0 at which the equation of motion is linearized, for an acceleration."""
    v = stage.v + stage.eta * jnp.asarray(a)
    return stage.q + stage.eta * v, v, jnp.where(stage.explicit, _SHORT, stage.eta)


def newton_step(
    stage: Stage,
    here: Linearization,
    state: NewtonState,
    tolerance: Float[AnyArray, ""],
) -> NewtonStep:
    """One step from `newton_point`, where the equation of motion is linearized.

    tolerance   [m]   of a step of time; the stage is solved to a hundredth of it
    """
    q, v, eta = newton_point(stage, state.a)
    explicit = stage.explicit
    change = -jnp.linalg.solve(here.matrix, here.residual)
    mass = jnp.diag(here.matrix) * eta**2  # that each coordinate moves, in the explicit stage
    massless = explicit & jnp.any(mass <= 1e-14 * jnp.max(mass))

    # The remaining error is a geometric series in the contraction so far.
    update = here.displacement(change)
    contraction = jnp.where(
        state.iterations > 0, update / jnp.maximum(state.update, 1e-300), state.contraction
    )
    remaining = update * contraction / jnp.maximum(1 - contraction, 0.1)
    converged = explicit | (remaining < 1e-2 * tolerance)
    exhausted = (contraction > 2) | (state.iterations + 1 >= MAX_ITERATIONS)
    diverged = massless | ~jnp.isfinite(update) | (~converged & exhausted)
    moved = jnp.where(explicit, 0.0, change)
    faster = jnp.where(explicit, 0.0, change / eta)
    resistance = here.resistance.force + here.resistance.by_velocity @ faster
    return NewtonStep(
        q=q + moved,
        v=v + faster,
        a=state.a + change / eta**2,
        potential=here.potential.energy + here.potential.gradient @ moved,
        dissipation=(v + faster) @ (resistance + here.resistance.by_position @ moved),
        update=update,
        contraction=contraction,
        converged=converged & ~diverged,
        diverged=diverged,
    )


def next_newton(state: NewtonState, found: NewtonStep) -> NewtonState:
    """Newton's method after a step: on the same stage, or on the next from this one's acceleration.

    There the first contraction is estimated by this stage's, made worse: Hairer and Wanner's η^0.8.
    """
    estimate = jnp.clip(found.contraction, 1e-3, 1.0) ** 0.8
    return NewtonState(
        a=found.a,
        iterations=jnp.where(found.converged, 0, state.iterations + 1),
        update=found.update,
        contraction=jnp.where(found.converged, estimate, found.contraction),
    )
