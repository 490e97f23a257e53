"""The model of its plant that a controller has: readings along the paths up and down, and limits."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from exosight.errors import InputError
from exosight.system.schema import Channel, Schema, SensorSpec


@dataclass(frozen=True, eq=False)
class ForcePath:
    """Readings along a path of commands, each pose the start of the next.

    u           (points,)           command, strictly rising or strictly falling [the channel's unit]
    outputs     (points, outputs)   of the estimated sensors [each in its unit]
    controlled  (points,)           of the sensor that is controlled [its unit]
    snapped     (points,)           the pose jumped on the way from the point before

    Raises InputError for fewer than two points, other shapes, a number that is not finite, or another order.
    """

    u: Float[np.ndarray, " points"]
    outputs: Float[np.ndarray, "points outputs"]
    controlled: Float[np.ndarray, " points"]
    snapped: Bool[np.ndarray, " points"]

    def __post_init__(self) -> None:
        steps = np.diff(self.u)
        counts = {len(self.u), len(self.outputs), len(self.controlled), len(self.snapped)}
        if len(self.u) < 2 or len(counts) > 1:
            raise InputError(
                "force path: expected two points or more, each with u, outputs, controlled and snapped"
            )
        if not all(np.isfinite(values).all() for values in (self.u, self.outputs, self.controlled)):
            raise InputError("force path: expected finite numbers, got one that is not")
        if not (np.all(steps > 0) or np.all(steps < 0)):
            raise InputError("force path, u: expected commands that strictly rise or strictly fall")

    @property
    def slopes(self) -> Float[np.ndarray, "steps outputs"]:
        """Change of each output per change of u between two points; 0 across a jump, which has none."""
        slope = np.diff(self.outputs, axis=0) / np.diff(self.u)[:, None]
        return np.where(self.snapped[1:, None], 0.0, slope)

    @property
    def jumps(self) -> list[tuple[float, float]]:
        """The controlled sensor before and after each jump [its unit]."""
        net = self.controlled
        return [(float(net[i - 1]), float(net[i])) for i in np.flatnonzero(self.snapped)]

    def skips(self, reading: float) -> bool:
        """Whether a reading of the controlled sensor [its unit] lies within a jump."""
        return any(min(jump) < reading < max(jump) for jump in self.jumps)

    def inverse(self) -> tuple[np.ndarray, np.ndarray]:
        """The controlled sensor, rising [its unit], and the u that shows it, for `numpy.interp`.

        A reading within a jump is given the command just beyond the jump; where the path dips, its running
        extreme counts.
        """
        up = self.u[-1] > self.u[0]
        net = (np.maximum if up else np.minimum).accumulate(self.controlled)
        reading, command = [float(net[0])], [float(self.u[0])]
        for i in range(1, len(net)):
            if self.snapped[i]:
                reading.append(float(net[i - 1]) + math.copysign(1e-9, 1 if up else -1))
                command.append(float(self.u[i]))
            reading.append(float(net[i]))
            command.append(float(self.u[i]))
        order = slice(None) if up else slice(None, None, -1)
        return np.array(reading[order]), np.array(command[order])


@dataclass(frozen=True, eq=False)
class ControllerConfig:
    """The model of a plant that `Scheduled` uses; `exosight.control.tuning.tune` makes one.

    schema         of the plant
    sensor         name of the sensor that is controlled; it follows from the estimated ones
    channel        name of the channel that is driven
    loading        from u = 0 up to the largest command
    unloading      from there down to the smallest
    output_limits  (outputs,)  largest reading of each estimated sensor [its unit]; ∞: not limited
    rate           largest change of u a second [the channel's unit/s]
    period         of a step of the loop [s]
    smallest_gain  bounds of Δu per change of the sensor: without the lower one a jump that comes later than
    largest_gain   the path would never be passed, without the upper one a flat path would ask for any u

    Raises InputError for names that are none of the schema's, paths of other outputs or that do not meet, or
    numbers that are not finite and above 0.
    """

    schema: Schema
    sensor: str
    channel: str
    loading: ForcePath
    unloading: ForcePath
    output_limits: Float[np.ndarray, " outputs"]
    rate: float
    period: float
    smallest_gain: float
    largest_gain: float

    def __post_init__(self) -> None:
        self.schema.channel(self.channel)
        outputs = len(self.weights)
        if not outputs == self.loading.outputs.shape[1] == self.unloading.outputs.shape[1]:
            raise InputError(f"controller: expected paths of {outputs} outputs, as its schema has")
        if self.output_limits.shape != (outputs,):
            raise InputError(f"controller: expected {outputs} limits, got {self.output_limits.shape}")
        if not (self.loading.u[0] == 0 and self.loading.u[-1] == self.unloading.u[0] > self.unloading.u[-1]):
            raise InputError("controller: expected a path from u = 0 up, and one from its end down")
        if self.unloading.u[-1] > 0:
            raise InputError("controller: expected an unloading path down to u = 0 at least")
        numbers = (self.rate, self.period, self.smallest_gain)
        if not (all(0 < number < math.inf for number in numbers) and (self.output_limits > 0).all()):
            raise InputError(
                "controller: expected limits, rate, period and gains that are finite and above 0"
            )
        if not self.smallest_gain <= self.largest_gain < math.inf:
            raise InputError("controller: expected finite gains, the smallest first")

    @cached_property
    def weights(self) -> Float[np.ndarray, " outputs"]:
        """w with the controlled sensor = w · outputs."""
        return self.schema.weights(self.sensor)

    @property
    def driven(self) -> Channel:
        """The channel that is driven."""
        return self.schema.channel(self.channel)

    @property
    def controlled(self) -> SensorSpec:
        """The sensor that is controlled."""
        return self.schema.sensor(self.sensor)

    @property
    def u_max(self) -> float:
        """Largest command [the channel's unit]."""
        return float(self.loading.u[-1])

    @property
    def u_min(self) -> float:
        """Smallest command [the channel's unit], 0 or below."""
        return float(self.unloading.u[-1])

    @property
    def step(self) -> float:
        """Largest change of u in one step [the channel's unit]."""
        return self.rate * self.period

    @property
    def margin(self) -> float:
        """A small command: 1/80 of the channel's peak [its unit]."""
        return abs(self.driven.peak) / 80

    @property
    def default_target(self) -> float:
        """Half of the largest reading of the controlled sensor [its unit], to two digits."""
        return float(f"{0.5 * self.loading.controlled.max():.2g}")

    @property
    def default_gain(self) -> float:
        """K_P of a proportional law [u per the sensor's unit]: the smallest gain, to two digits."""
        return float(f"{self.smallest_gain:.2g}")

    def sum(self, outputs: Float[np.ndarray, " outputs"]) -> float:
        """The controlled sensor as it follows from the estimated ones [its unit]."""
        return float((outputs * self.weights).sum())

    def commands(self, u: float | Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch channels"]:
        """u on the driven channel, 0 on the others."""
        return self.schema.commands(u, self.channel)

    def reachable(self, target: float) -> float:
        """The target [the sensor's unit], or the largest reading below it that the plant can rest at.

        What lies in a jump both up and down is never at rest; then 98 % of the reading before the jump up.
        """
        if self.unloading.skips(target):
            for low, high in self.loading.jumps:
                if low < target < high:
                    return 0.98 * low
        return min(target, float(self.loading.controlled[-1]))


def limited(config: ControllerConfig, u: float, wanted: float) -> float:
    """The command nearest to the wanted one that amplitude and rate allow from u; u if it is NaN."""
    if math.isnan(wanted):
        return u
    wanted = max(u - config.step, min(u + config.step, wanted))
    return float(max(config.u_min, min(config.u_max, wanted)))
