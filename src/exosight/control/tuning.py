"""The controller's model of one's own plant, from one path of its simulation up and down (needs JAX).

1. Solve the system from rest up, in steps of 1/160 of the channel's peak, to the first command at which an
   estimated sensor reads more than it may. Before it, the controlled sensor reads most at u_max: beyond, more
   u would mean less.
2. Solve from there down to u_min, below 0, where the pose must be released.
3. The controlled sensor on both is the schedule; its jumps are those that `drive` reports.
4. Δu per change of the sensor is bounded by the slopes in contact: above by the flattest tenth of them, below
   by half of what the steepest tenth asks for.
"""

import math
from collections.abc import Sequence

import numpy as np

from exosight.control.loop import RATE
from exosight.control.paths import ControllerConfig, ForcePath
from exosight.control.scheduled import RELEASED
from exosight.errors import InputError
from exosight.mechanics import State
from exosight.system.schema import Channel, Schema, SensorSpec
from exosight.system.simulation import SystemStates, simulate_path
from exosight.system.system import System

CONTACT_LIMIT = 0.5
"""Largest reading of a contact force whose sensor has no limit of its own [N]."""

_FLAT = 4e-3  # change of the sensor over the channel's peak; a path that is flatter than that does not press


def default_rate(channel: Channel) -> float:
    """Largest change of the command a second: the channel's own, or its peak in 0.4 s [its unit/s]."""
    return 2.5 * abs(channel.peak) if channel.rate is None else channel.rate


def default_limits(schema: Schema, contact_limit: float | None = None) -> np.ndarray:
    """Largest reading of each estimated sensor [its unit], (outputs,).

    contact_limit  of every contact force [N]; by default the sensor's own, or 0.5 N where it has none
    """

    def limit(spec: SensorSpec) -> float:
        if spec.quantity == "contact force" and contact_limit is not None:
            return contact_limit
        if spec.limit is not None:
            return spec.limit
        return CONTACT_LIMIT if spec.quantity == "contact force" else math.inf

    return np.array([limit(spec) for spec in schema.estimated])


def tune(
    system: System,
    sensor: str | None = None,
    channel: str | None = None,
    *,
    contact_limit: float | None = None,
    rate: float | None = None,
    pull: float | None = None,
    period: float = 1 / RATE,
) -> ControllerConfig:
    """The model of a system by which `Scheduled` drives one channel by one sensor.

    sensor         that is controlled; by default the one that the schema names
    channel        that is driven, by default the first; the others rest at 0
    contact_limit  largest contact force on each zone [N]; by default the sensors' own, or 0.5 N
    rate           largest change of u a second; by default the channel's own, or its peak in 0.4 s [its
                   unit/s]
    pull           −u_min; by default a quarter of the peak, within the channel's range [its unit]
    period         of a step of the loop [s]

    Raises InputError for a name that is none of the system's, a number that is not finite and above 0, a
    channel whose peak is below 0, or a system whose sensor does not rise within its limits or is not released
    at u_min; ConvergenceError if the path has no stable pose at some command.
    """
    schema = system.schema
    driven, sensor = schema.channel(channel), sensor or schema.controlled
    weights = schema.weights(sensor)
    rate = default_rate(driven) if rate is None else rate
    pull = min(0.25 * driven.peak, -driven.low) if pull is None else pull
    _check_numbers(driven, contact_limit, rate, pull, period)
    limits = default_limits(schema, contact_limit)
    loading, state = _loading(system, sensor, driven, limits)
    falling = np.concatenate([loading.u[:0:-1], _grid(driven, -pull)])
    unloading, _ = _force_path(system, sensor, driven, falling, state)
    if not unloading.controlled[-1] < RELEASED:
        raise InputError(
            f"tune: {sensor} is not released at {driven.name} = {-pull:g} {driven.unit}; "
            "allow it a larger pull"
        )
    smallest, largest = _gain_bounds((loading, unloading), weights, driven.peak)
    return ControllerConfig(
        schema=schema,
        sensor=sensor,
        channel=driven.name,
        loading=loading,
        unloading=unloading,
        output_limits=limits,
        rate=rate,
        period=period,
        smallest_gain=smallest,
        largest_gain=largest,
    )


def _check_numbers(
    driven: Channel, contact_limit: float | None, rate: float, pull: float, period: float
) -> None:
    if driven.high <= 0 or driven.peak < 0:
        raise InputError(
            f"tune, channel {driven.name}: expected one that loads towards its upper end, got a peak of "
            f"{driven.peak:g} {driven.unit}; turn its sign in the system's description"
        )
    for name, value in (("contact limit", contact_limit), ("rate", rate), ("period", period)):
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"tune, {name}: expected a finite number above 0, got {value}")
    if not 0 <= pull <= -driven.low:
        raise InputError(f"tune, pull: expected 0…{-driven.low:g} {driven.unit}, got {pull}")


def _loading(system: System, sensor: str, driven: Channel, limits: np.ndarray) -> tuple[ForcePath, State]:
    """The path up to the largest reading of the sensor within the limits, and the state at its end."""
    rising = _grid(driven, driven.high)
    up, path = _force_path(system, sensor, driven, rising)
    over = (up.outputs > limits).any(axis=1)
    allowed = int(np.argmax(over)) if over.any() else len(rising)
    last = int(np.argmax(up.controlled[:allowed])) if allowed else 0
    if last < 1 or up.controlled[last] < RELEASED:
        end = "a sensor passes its limit" if over.any() else "its range ends"
        raise InputError(
            f"tune: {sensor} stays below {RELEASED:g} {system.schema.sensor(sensor).unit} while "
            f"{driven.name} rises to {rising[max(allowed - 1, 0)]:g} {driven.unit}, where {end}; choose "
            "another sensor or channel, or allow more"
        )
    part = (x[: last + 1] for x in (up.u, up.outputs, up.controlled, up.snapped))
    return ForcePath(*part), path.state(system, last)


def _gain_bounds(paths: Sequence[ForcePath], weights: np.ndarray, peak: float) -> tuple[float, float]:
    """Smallest and largest Δu per change of the sensor."""
    slopes = np.concatenate([(path.slopes * weights).sum(axis=1) for path in paths])
    flat, steep = np.quantile(slopes[slopes * peak > _FLAT], [0.1, 0.9])  # in contact, and not falling
    return float(0.5 / steep), float(1 / flat)


def _grid(driven: Channel, end: float) -> np.ndarray:
    """Commands from 0 to the end; by at most a step of them a jump is passed."""
    steps = max(2, math.ceil(abs(end) / driven.peak * 160 - 1e-9))
    return np.linspace(0.0, end, steps + 1) if end else np.zeros(1)


def _force_path(
    system: System, sensor: str, driven: Channel, u: np.ndarray, state: State | None = None
) -> tuple[ForcePath, SystemStates]:
    """The path over these commands, all others at 0, and its states."""
    schema = system.schema
    path = simulate_path(system, schema.commands(u, driven.name), state)
    outputs = np.asarray(path.observation.readings)[:, schema.output_indices()]
    controlled = (outputs * schema.weights(sensor)).sum(axis=1)
    return ForcePath(u, outputs, controlled, np.array(path.equilibria.snapped)), path
