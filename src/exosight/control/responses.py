"""How well a force followed its target: settling, overshoot, steady-state error, release."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from exosight.errors import InputError
from exosight.system.schema import Channel

TOLERANCE = 0.05
"""Half-width of the band in which a force counts as on target, as a share of the target. The paper prints
none; 2 % and 5 % are customary, and 2 % of its targets is less than a camera estimate scatters."""


@dataclass(frozen=True)
class Response:
    """One response to a target that is held and then perhaps released; see `measure_response`.

    "Late" is the last quarter of the steps for which the target is held (at least one).
    """

    settling_steps: float
    """Steps after which the force stays in the band while the target is held; NaN: it never settles, or too
    late to distinguish it from an oscillation, within the last quarter."""
    overshoot: float
    """Largest reading above the target while it is held [the sensor's unit]; 0 if there is none."""
    overshoot_percent: float
    """The same as a share of the target [%]."""
    steady_state_error: float
    """Target − mean of the late readings [the sensor's unit]."""
    ripple: float
    """Largest − smallest late reading [the sensor's unit]: distinguishes a loop that oscillates from one that
    rests."""
    release_time: float
    """Time after the switch to 0 from which the force stays in the band around 0 [s]; NaN: it never
    does, or the target is not released."""
    largest_u: float
    """Largest command [the channel's unit]."""
    smallest_u: float
    """Smallest command [the channel's unit]."""
    locked_up: bool
    """In the last quarter of the whole run u stands at one end of the channel's range, and yet the force is
    never in the band: the law has nothing left to give, and the pose does not answer."""


def measure_response(
    time: Float[np.ndarray, " steps"],
    target: Float[np.ndarray, " steps"],
    force: Float[np.ndarray, " steps"],
    u: Float[np.ndarray, " steps"],
    channel: Channel,
    tolerance: float = TOLERANCE,
) -> Response:
    """Measure one response of the loop, of the true or of the estimated readings.

    The band is target ± tolerance · held target, also after the release.

    time       (steps,)  [s]
    target     (steps,)  one value above 0, held to the end or followed by 0 to the end [the sensor's unit]
    force      (steps,)  what the sensor reads [its unit]
    u          (steps,)  command [the channel's unit]
    channel    that the law drove
    tolerance  half-width of the band, as a share of the held target

    Raises InputError for arrays of other lengths, a number that is not finite, another target, or a tolerance
    that is not above 0.
    """
    if not 0 < tolerance < math.inf:
        raise InputError(f"tolerance: expected a finite number above 0, got {tolerance}")
    if not time.shape == target.shape == force.shape == u.shape or time.ndim != 1 or len(time) == 0:
        raise InputError(
            "response: expected time, target, force and u of one length above 0, "
            f"got shapes {time.shape}, {target.shape}, {force.shape}, {u.shape}"
        )
    if not all(np.isfinite(values).all() for values in (time, target, force, u)):
        raise InputError(
            "response: expected finite numbers, got one that is not; a lost frame has no response"
        )
    step = float(target[0])
    held = int(np.argmax(target != step)) if np.any(target != step) else len(target)
    if step <= 0 or np.any(target[held:] != 0):
        raise InputError("target: expected one number above 0, held and then perhaps 0 to the end")

    inside = np.abs(force - target) <= tolerance * step
    settled, released = _stays_from(inside[:held]), _stays_from(inside[held:])
    late = force[held - math.ceil(held / 4) : held]
    last = slice(len(u) - math.ceil(len(u) / 4), None)
    at_limit = u[last].min() >= channel.high or u[last].max() <= channel.low
    overshoot = max(float(force[:held].max()) - step, 0.0)
    return Response(
        settling_steps=math.nan if settled is None else float(settled),
        overshoot=overshoot,
        overshoot_percent=100 * overshoot / step,
        steady_state_error=step - float(late.mean()),
        ripple=float(np.ptp(late)),
        release_time=math.nan if released is None else float(time[held + released] - time[held]),
        largest_u=float(u.max()),
        smallest_u=float(u.min()),
        locked_up=bool(at_limit and not inside[last].any()),
    )


def _stays_from(inside: Bool[np.ndarray, " steps"]) -> int | None:
    """The first index from which all are true; None unless that is so for the last quarter at least.

    A loop that oscillates is in the band now and then, also at the very end.
    """
    outside = np.flatnonzero(~inside)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return first if first <= len(inside) - math.ceil(len(inside) / 4) and len(inside) else None
