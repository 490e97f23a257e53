"""The size of the next step of time: by the error of the last, up to the next reported time.

A step's error is estimated by the embedded solution, as a displacement in metres: the root mean square over
the robot's mass of the error of the poses, and of the error of the velocities times the step. Where it is
above the tolerance, the step is taken back. An error of order p in the step suggests the next one,

    h_new = 0.9 h (tolerance / error)^(1/p),      within 0.2 h … 5 h.

Source: E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, II.4.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.tableau import Tableau

_SAFETY, _SMALLEST, _LARGEST = 0.9, 0.2, 5.0
_AFTER_DIVERGENCE = 0.25
"""What a step is multiplied by whose stages could not be solved."""
ROUND_OFF = 1e-9
"""What is left of an interval counts as nothing below this fraction of it."""


class StepLimits(NamedTuple):
    """What steps must keep.

    tolerance   [m]   of one step
    largest     [s]   step
    adaptive          whether the error chooses the step; if not, all are the largest
    max_steps         in one interval, rejected ones included
    """

    tolerance: Float[AnyArray, ""]
    largest: Float[AnyArray, ""]
    adaptive: Bool[AnyArray, ""]
    max_steps: Int[AnyArray, ""]


def step_error(
    tableau: Tableau,
    slopes: Float[AnyArray, "stages 2 dofs"],
    step: Float[AnyArray, ""],
    distance: Callable[[Array], Array],
) -> Float[Array, ""]:
    """The estimated error of a step [m]: the larger of its displacement and step × that of the velocity."""
    error = jnp.tensordot(tableau.error_weights, slopes, 1) * step
    return jnp.maximum(distance(error[0]), step * distance(error[1]))


def first_step(limits: StepLimits, acceleration: Float[Array, ""]) -> Float[Array, ""]:
    """The step [s] to propose at the start, in which an acceleration [m/s²] moves by half the tolerance."""
    near = jnp.sqrt(limits.tolerance / jnp.maximum(acceleration, 1e-300))
    return jnp.minimum(jnp.where(limits.adaptive, near, limits.largest), limits.largest)


def after_step(
    limits: StepLimits, step: Float[AnyArray, ""], error: Float[Array, ""], order: int
) -> tuple[Bool[Array, ""], Float[Array, ""]]:
    """Whether a step whose stages are solved is accepted, and the step [s] to propose next."""
    ratio = error / limits.tolerance
    factor = jnp.clip(_SAFETY * ratio ** (-1 / order), _SMALLEST, _LARGEST)
    proposed = jnp.where(limits.adaptive, step * factor, limits.largest)
    return (ratio <= 1) | ~limits.adaptive, jnp.minimum(proposed, limits.largest)


def after_divergence(limits: StepLimits, step: Float[AnyArray, ""]) -> Float[Array, ""]:
    """The step [s] to propose where a stage could not be solved."""
    return jnp.minimum(_AFTER_DIVERGENCE * step, limits.largest)


def fitted_step(
    left: Float[AnyArray, ""], proposed: Float[AnyArray, ""], contact: Float[AnyArray, ""]
) -> Float[Array, ""]:
    """The step [s] to take, so that the next reported time is met.

    It is an equal part of what is left [s] until then, not longer than proposed, and ends where the first
    contact closes, after `contact` [s].
    """
    parts = jnp.ceil(left / jnp.maximum(proposed, 1e-300) - 1e-9)
    return jnp.minimum(left / jnp.maximum(parts, 1.0), contact)
