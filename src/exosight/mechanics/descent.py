"""Descent to a stable equilibrium at a fixed load: the overdamped flow M dq/dt = −∇Π in implicit steps.

A step of time h minimises the incremental potential Π(q) + |q − qₙ|²/2h, here to second order:
(∇²Π + M/h) p = −∇Π. It ends where a gap closes. h is as large as a trust radius allows, |p| ≤ radius; the
radius grows while the quadratic model predicts the energy, so that the last steps are Newton's. At a saddle,
where the flow would rest, it is left in a fixed direction.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.mechanics.energy import Evaluation
from exosight.mechanics.evaluator import solve_definite
from exosight.mechanics.metric import Metric

LARGEST = 0.5
"""Largest step of a descent, relative to `Metric.range`."""


NEAR = 1e-3
"""Residual from which on Newton's method alone finds the end of a descent with friction."""

UPHILL = 100 * NEAR
"""Residual that the first uphill step from there may lead to; each further one to less than the one before.
Else two sets of points that slip, each with its own solution beyond the other's, would alternate for ever."""

LESS = 0.9
"""By how much less."""

SHORTEST = 1e-6
"""Part of a step with friction, down to which it is tried. Where no shorter one leads downhill either, the
force has a jump (a point passes to another body): what lies beyond is remembered, and the descent goes on."""


class Descent(NamedTuple):
    """Where a descent is.

    q, here, residual  the accepted point, and what was found there
    step, fraction     the step being tried, and how much of it; the trial point is q + fraction · step
    slope, curvature   ∇Πᵀ step and stepᵀ ∇²Π step [J]
    radius             trust radius
    shift              1/h of the last step
    convex             ∇²Π is positive definite at q
    uphill             residual that an uphill step may lead to, see UPHILL
    fresh              the trial point is the start, to be accepted whatever its energy
    """

    q: Float[AnyArray, " dofs"]
    here: Evaluation
    residual: Float[AnyArray, ""]
    step: Float[AnyArray, " dofs"]
    fraction: Float[AnyArray, ""]
    slope: Float[AnyArray, ""]
    curvature: Float[AnyArray, ""]
    radius: Float[AnyArray, ""]
    shift: Float[AnyArray, ""]
    convex: Bool[AnyArray, ""]
    uphill: Float[AnyArray, ""]
    fresh: Bool[AnyArray, ""]


def accept(
    descent: Descent,
    metric: Metric,
    trial: Float[AnyArray, " dofs"],
    there: Evaluation,
    arriving: Float[AnyArray, " dofs"],
    residual: Float[AnyArray, ""],
    conservative: bool,
) -> tuple[Descent, Bool[AnyArray, ""]]:
    """The descent at the trial point if that is lower, with its trust radius adapted; and whether it is.

    arriving   ∇Π of the step that leads there
    """
    change = there.energy - descent.here.energy
    if there.coupling is not None:  # friction has no energy that could be compared: its work is
        change = 0.5 * (descent.here.gradient + arriving) @ (trial - descent.q)
    fraction = descent.fraction
    model = fraction * descent.slope + 0.5 * fraction**2 * descent.curvature
    # Where the change of energy drowns in round-off, the residual decides; on the way from a saddle it grows.
    noise = 1e-12 * (jnp.abs(there.energy) + metric.size(trial) ** 2)
    hidden = (jnp.abs(model) < noise) & (change > -noise)
    ratio = change / jnp.where(jnp.abs(model) > 0, model, -1e-300)
    good = jnp.where(hidden, (residual <= descent.residual) | ~descent.convex, (change < 0) & (ratio > 0.1))
    jump, uphill = jnp.array(False), descent.uphill
    if there.coupling is not None:  # between stick and slip, Newton's method need not lead downhill
        tolerated = ~good & near_rest(descent) & (residual < uphill) & (fraction >= 1)
        uphill = jnp.where(tolerated, LESS * residual, uphill)
        good = good | tolerated
        jump = ~good & (fraction < SHORTEST)
    if not conservative:
        good = residual <= (1 - 1e-4 * fraction) * descent.residual
    accepted = descent.fresh | ((good | jump) & jnp.isfinite(residual))
    length = jnp.where(jump, 0.1, fraction) * metric.size(descent.step)
    wider = jnp.where(ratio > 0.6, jnp.maximum(descent.radius, 2 * length), descent.radius)
    wider = jnp.where(ratio < 0.25, 0.5 * length, wider)
    radius = jnp.where(
        accepted, jnp.where(hidden, jnp.maximum(descent.radius, 2 * length), wider), 0.25 * length
    )
    radius = jnp.where(descent.fresh, descent.radius, radius)
    q, here, residual = jax.tree.map(
        lambda new, old: jnp.where(accepted, new, old),
        (trial, there, residual),
        (descent.q, descent.here, descent.residual),
    )
    radius = jnp.minimum(radius, LARGEST * metric.range(q))
    return descent._replace(q=q, here=here, residual=residual, radius=radius, uphill=uphill), accepted


def near_rest(descent: Descent) -> Bool[AnyArray, ""]:
    """Whether a descent with friction is about to end, within one step of what is remembered."""
    return descent.convex & (descent.residual < NEAR)


def least(descent: Descent) -> Float[Array, ""]:
    """Residual from which on a step of a descent with friction ends where it leads to.

    The start is no step, and one that leads near rest (`near_rest`) is the last: it goes on to there.
    """
    return jnp.where(descent.fresh, jnp.inf, jnp.where(descent.convex, NEAR, 0.0))


class Asked(NamedTuple):
    """What a step that is no whole Newton step is found from, see `damped`.

    along    (dofs,)  −(∇²Π + M/h) step
    shift    1/h, before the first attempt
    longest  length that the step may have
    wanted   whether there is to be one
    """

    along: Float[AnyArray, " dofs"]
    shift: Float[AnyArray, ""]
    longest: Float[AnyArray, ""]
    wanted: Bool[AnyArray, ""]


class Damped(NamedTuple):
    """A step with ∇²Π + M/h positive definite, not a number if there is none: its length, stepᵀ ∇²Π step."""

    step: Float[AnyArray, " dofs"]
    shift: Float[AnyArray, ""]
    length: Float[AnyArray, ""]
    curvature: Float[AnyArray, ""]


class Flow(NamedTuple):
    """The next step, before gaps, 1/h of it, and stepᵀ ∇²Π step."""

    step: Float[AnyArray, " dofs"]
    shift: Float[AnyArray, ""]
    curvature: Float[AnyArray, ""]


def ask(
    descent: Descent,
    metric: Metric,
    newton: Float[AnyArray, " dofs"],
    stable: Bool[AnyArray, ""],
    saddle: Bool[AnyArray, ""],
    wanted: Bool[AnyArray, ""],
) -> tuple[Asked, Bool[AnyArray, ""]]:
    """What `damped` needs for the next step, and whether it is a whole Newton step and needs nothing.

    newton   −(∇²Π)⁻¹ ∇Π, of no meaning unless `stable`
    saddle   ∇Π is zero but ∇²Π not positive definite
    wanted   whether the answer is used at all
    """
    # With friction Newton's step may lead uphill, where no part of it is a step of the flow.
    downhill = (descent.here.gradient @ newton < 0) | near_rest(descent._replace(convex=stable))
    whole = stable & downhill & (metric.size(newton) <= descent.radius)
    along = jnp.where(saddle, _some_direction(len(newton)), descent.here.gradient)
    first = jnp.maximum(descent.shift / 16, 1e-3)
    return Asked(along, first / 4, 2 * descent.radius, wanted & ~whole), whole


def attempt(
    hessian: Float[AnyArray, "dofs dofs"],
    matrix: Float[AnyArray, "dofs dofs"],
    along: Float[AnyArray, " dofs"],
    shift: Float[AnyArray, ""],
) -> tuple[Float[AnyArray, " dofs"], Float[AnyArray, ""], Float[AnyArray, ""]]:
    """The step of this 1/h, its length, and stepᵀ ∇²Π step; `matrix`: M."""
    solved, definite = solve_definite(hessian + shift * matrix, along[:, None])
    step = jnp.where(definite, -solved[:, 0], jnp.nan)
    return step, jnp.sqrt(step @ matrix @ step), step @ hessian @ step


def damped(
    attempted: Callable[..., tuple],
    hessian: Float[AnyArray, "dofs dofs"],
    matrix: Float[AnyArray, "dofs dofs"],
    asked: Asked,
) -> Damped:
    """The first step that is short enough, with 1/h four times as large each time; as begun if not wanted.

    attempted   `attempt`, by XLA or as a program
    """

    def too_long(found: Damped) -> Array:
        return jnp.asarray(~(found.length <= asked.longest) & (found.shift < 1e12) & asked.wanted)

    def again(found: Damped) -> Damped:
        step, length, curvature = attempted(hessian, matrix, asked.along, 4 * found.shift)
        return Damped(step, 4 * found.shift, length, curvature)

    nothing = jnp.array(jnp.nan)
    begun = Damped(jnp.full(len(hessian), jnp.nan), asked.shift, nothing, nothing)
    return jax.lax.while_loop(too_long, again, begun)


def direction(
    descent: Descent,
    newton: Flow,
    stable: Bool[AnyArray, ""],
    saddle: Bool[AnyArray, ""],
    whole: Bool[AnyArray, ""],
    found: Damped,
) -> Flow:
    """The next step: Newton's if it may be `whole`, else what has been found."""
    length = jnp.maximum(found.length, 1e-300)
    # Past a fold or at a saddle the gradient says little; a step of the trust radius leaves them at once.
    part = jnp.where(stable, jnp.minimum(1.0, descent.radius / length), descent.radius / length)
    damped = Flow(found.step * part, found.shift, part**2 * found.curvature)
    step, shift, curvature = (jnp.where(whole, a, b) for a, b in zip(newton, damped, strict=True))
    step = jnp.where(saddle & (descent.here.gradient @ step > 0), -step, step)
    return Flow(step, shift, curvature)


def _some_direction(dofs: int) -> Array:
    """A fixed direction without symmetry, to leave a saddle along: orthogonal to no eigenvector by design."""
    return jnp.asarray(np.random.default_rng(0).normal(size=dofs))
