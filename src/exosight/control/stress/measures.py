"""What is measured on an episode, and on all of them."""

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from exosight.control.guard import State
from exosight.control.loop import RATE
from exosight.control.paths import ControllerConfig
from exosight.control.responses import TOLERANCE, measure_response
from exosight.control.scheduled import RELEASED
from exosight.control.stress.episodes import Episode
from exosight.control.stress.suite import Traces

RELEASE_SECONDS = 1.0
"""Within so long after its target dropped the controlled sensor is to be below 0.005 of its unit [s]."""

_ROUND_OFF = 1e-9  # of sums of commands, as a share of the channel's peak


@dataclass(frozen=True)
class Measured:
    """One episode, measured on the true force. NaN: does not apply, or never happened."""

    kind: str
    """of target"""
    settling_steps: float
    """until the controlled sensor stays within 5 % of a constant target"""
    overshoot_percent: float
    """of a constant target [%]"""
    steady_state_percent: float
    """|target − mean of the last quarter| of a constant target [%]"""
    tracking_error: float
    """root mean square of target − reading from 1 s on, until the target drops [the sensor's unit]"""
    hold_error: float
    """mean of |target − reading| over the same time [the sensor's unit]"""
    largest_contact: float
    """largest contact force that is estimated [N]; NaN: none is"""
    largest_net: float
    """largest reading of the controlled sensor [its unit]"""
    seconds_outside: float
    """time in which some estimated sensor reads more than it may [s]"""
    commands_outside: int
    """commands beyond the amplitude or the rate that the controller may ask for"""
    release_seconds: float
    """from the target's drop until the controlled sensor stays below 0.005 of its unit [s]"""
    recovered: bool
    """the controlled sensor is below that in the end"""
    given_up: bool
    """the guard released before the target dropped"""
    latency: float
    """age of the frames [s]"""
    user_moves: bool
    """joints stiffen, soften and flex"""
    camera_displaced: bool
    """the camera is not where it was at first"""
    lag: float
    """of the actuators [s]"""
    dead_time: float
    """of the actuators [s]"""
    friction: float
    """coefficient between the bodies [-]"""
    creep: float
    """share of the rods' instantaneous modulus that relaxes [-]"""


def measure_episode(episode: Episode, traces: Traces, number: int, limits: ControllerConfig) -> Measured:
    """What happened in one episode.

    limits   of commands and outputs; for all controllers the same
    """
    target, u, net = traces.target[number], traces.command[number], traces.true[number]
    outputs = traces.outputs[number]
    contacts = outputs[:, [spec.quantity == "contact force" for spec in limits.schema.estimated]]
    settling = overshoot = steady = math.nan
    if episode.kind in ("constant", "snap"):
        found = measure_response(np.arange(len(target)) / RATE, target, net, u, limits.driven)
        settling, overshoot = found.settling_steps, found.overshoot_percent
        steady = 100 * abs(found.steady_state_error) / target[0]
    held = slice(round(RATE), episode.drop)
    pressing = np.flatnonzero(net[episode.drop :] >= RELEASED)
    released = int(pressing[-1]) + 1 if len(pressing) else 0
    recovered = bool(net[-1] < RELEASED)
    slack = _ROUND_OFF * abs(limits.driven.peak)
    beyond = (u < limits.u_min - slack) | (u > limits.u_max + slack)
    beyond[1:] |= np.abs(np.diff(u)) > limits.step + slack
    return Measured(
        kind=episode.kind,
        settling_steps=settling,
        overshoot_percent=overshoot,
        steady_state_percent=steady,
        tracking_error=float(np.sqrt(np.mean((target - net)[held] ** 2))),
        hold_error=float(np.mean(np.abs(target - net)[held])),
        largest_contact=float(contacts.max()) if contacts.size else math.nan,
        largest_net=float(net.max()),
        seconds_outside=float((outputs > limits.output_limits).any(axis=1).sum() / RATE),
        commands_outside=int(beyond.sum()),
        release_seconds=released / RATE if recovered else math.nan,
        recovered=recovered,
        given_up=any(t.after is State.RELEASE and t.step < episode.drop for t in traces.logs[number]),
        latency=episode.latency / RATE,
        user_moves=episode.moves,
        camera_displaced=episode.displaced,
        lag=episode.valve.lag,
        dead_time=episode.valve.dead_time,
        friction=episode.friction or 0.0,
        creep=episode.creep.share if episode.creep else 0.0,
    )


def summary(measured: Sequence[Measured], traces: Traces) -> dict[str, Any]:
    """All episodes of one controller in plain numbers; None where nothing applies."""
    constant = [m for m in measured if not math.isnan(m.overshoot_percent)]
    late = [m for m in measured if not m.release_seconds <= RELEASE_SECONDS]
    causes = Counter(f"{t.after.value}: {_kind_of(t.cause)}" for log in traces.logs for t in log)
    return {
        "episodes": len(measured),
        "constant_targets": len(constant),
        "settled": sum(not math.isnan(m.settling_steps) for m in constant),
        "settling_steps": _quantiles([m.settling_steps for m in constant]),
        "overshoot_percent": _quantiles([m.overshoot_percent for m in constant]),
        "steady_state_percent": _quantiles([m.steady_state_percent for m in constant]),
        "tracking_error": {
            kind: _quantiles([m.tracking_error for m in measured if m.kind == kind])
            for kind in sorted({m.kind for m in measured})
        },
        "hold_error": {
            "user at rest": _mean([m.hold_error for m in measured if not m.user_moves]),
            "user moves": _mean([m.hold_error for m in measured if m.user_moves]),
        },
        "largest_contact": _quantiles([m.largest_contact for m in measured]),
        "largest_net": _quantiles([m.largest_net for m in measured]),
        "outside_contact_limit": sum(m.seconds_outside > 0 for m in measured),
        "seconds_outside": _quantiles([m.seconds_outside for m in measured]),
        "commands_outside": sum(m.commands_outside for m in measured),
        "release_seconds": _quantiles([m.release_seconds for m in measured]),
        "released_late": len(late),
        "unrecovered": sum(not m.recovered for m in measured),
        "given_up": sum(m.given_up for m in measured),
        "without_a_pose": int((~traces.converged).any(axis=1).sum()),
        "transitions": dict(causes.most_common()),
        "percentiles": {
            "settling_steps": _percentiles([m.settling_steps for m in constant]),
            "overshoot_percent": _percentiles([m.overshoot_percent for m in constant]),
            "largest_contact": _percentiles([m.largest_contact for m in measured]),
            "release_seconds": _percentiles([m.release_seconds for m in measured]),
        },
    }


def attained(measured: Sequence[Measured], bound: Sequence[Measured]) -> dict[str, Any]:
    """Of the constant targets at which the bound settles: how many there are, how many a controller settles
    at, both for each kind of disturbance as well, and why the others are missed.

    bound   the same episodes of the oracle
    """
    kept = [m for m, best in zip(measured, bound, strict=True) if not math.isnan(best.settling_steps)]
    missed = Counter(_cause(m) for m in kept if math.isnan(m.settling_steps))
    return {
        "attainable": len(kept),
        "attained": _settled(kept),
        "attainable_steady_state_percent": _quantiles([m.steady_state_percent for m in kept]),
        "not_attained": dict(missed.most_common()),
        "attained_by_disturbance": {
            name: {"attainable": len(part), "attained": _settled(part)}
            for name, applies in _DISTURBANCES.items()
            if (part := [m for m in kept if applies(m)])
        },
    }


_DISTURBANCES: dict[str, Callable[[Measured], bool]] = {
    "user at rest": lambda m: not m.user_moves,
    "user at rest, camera displaced": lambda m: not m.user_moves and m.camera_displaced,
    "user moves, frames up to 0.1 s late": lambda m: m.user_moves and m.latency < _LATE,
    "user moves, frames 0.2 s late or more": lambda m: m.user_moves and m.latency >= _LATE,
    "friction up to 0.3": lambda m: 0 < m.friction <= 0.3,
    "friction above 0.3": lambda m: m.friction > 0.3,
    "creep up to 12.5 %": lambda m: 0 < m.creep <= 0.125,
    "creep above 12.5 %": lambda m: m.creep > 0.125,
    "lag and dead time up to 0.25 s together": lambda m: 0 < m.lag + m.dead_time <= 0.25,
    "lag and dead time above 0.25 s together": lambda m: m.lag + m.dead_time > 0.25,
}
_LATE = 0.15  # [s]


def _settled(measured: Sequence[Measured]) -> int:
    return sum(not math.isnan(m.settling_steps) for m in measured)


def _cause(measured: Measured) -> str:
    """Why an episode has not settled."""
    if measured.given_up:
        return "given up"
    if measured.steady_state_percent > 100 * TOLERANCE:
        return "mean of the last quarter off by more than 5 %"
    return "mean within 5 %, not every step"


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _quantiles(values: Sequence[float]) -> dict[str, float] | None:
    known = [value for value in values if not math.isnan(value)]
    if not known:
        return None
    at = {"median": 0.5, "p90": 0.9, "p99": 0.99, "largest": 1.0}
    return {name: float(np.quantile(known, share)) for name, share in at.items()}


def _percentiles(values: Sequence[float]) -> list[float | None]:
    """The values that 0, 1 … 100 % of the episodes do not pass; None where so many never got there."""
    if not values:
        return [None] * 101
    known = np.sort(np.where(np.isnan(values), np.inf, values))
    found = np.quantile(known, np.linspace(0, 1, 101), method="inverted_cdf")
    return [None if math.isinf(value) else round(float(value), 6) for value in found]


def _kind_of(cause: str) -> str:
    """A cause without its numbers."""
    return re.sub(r"\d+(\.\d+)?", "…", cause)
