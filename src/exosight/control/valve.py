"""Actuators that answer late: a dead time and a first-order lag, as of a valve that fills a soft actuator.

What arrives follows τ dy/dt = u(t − T) − y, with commands u that are held from one step of the loop to the
next, and is exact at the ends of the steps. T is the way of the pressure along its line, τ the time in which
the actuator fills (source: a resistance before a volume, as in any text on pneumatics, such as Beater,
Pneumatic Drives, 2007, ch. 5). Neglected: that filling and emptying differ, and that flow is choked.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.control.loop import RATE
from exosight.control.plant import Observation, Plant
from exosight.errors import InputError
from exosight.system.schema import Schema

LONGEST = 2.0
"""[s]"""


@dataclass(frozen=True)
class Valve:
    """How late the actuators of one plant answer; by default at once.

    lag         τ: time in which they go 63 % of the way [s]
    dead_time   T: time in which nothing happens [s]

    Raises InputError for times that are not from 0 to 2 s.
    """

    lag: float = 0.0
    dead_time: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("lag", self.lag), ("dead time", self.dead_time)):
            if not 0 <= value <= LONGEST:
                raise InputError(f"valve, {name}: expected 0 to {LONGEST:g} s, got {value}")

    @property
    def response_time(self) -> float:
        """Time after which 2 % of a change are left, T + 4 τ [s]."""
        return self.dead_time + 4 * self.lag


AT_ONCE = Valve()


class Valves:
    """The valves of several plants, all at 0 before the first step.

    channels   of each plant, which have one valve each, alike
    """

    def __init__(self, valves: Sequence[Valve], channels: int) -> None:
        self._lag, dead_time = np.array([[valve.lag, valve.dead_time] for valve in valves]).T
        # Round-off must not make a dead time of three steps two and nearly one more.
        steps = np.round(dead_time * RATE, 9)
        self._whole, self._part = steps.astype(int), (steps % 1) / RATE
        self._asked = np.zeros((2 + int(self._whole.max()), len(valves), channels))
        self._arrived = np.zeros((len(valves), channels))

    def step(self, commands: Float[np.ndarray, "plants channels"]) -> Float[np.ndarray, "plants channels"]:
        """What has arrived at the end of a step with these commands [each in its channel's unit]."""
        self._asked = np.concatenate([np.asarray(commands, float)[None], self._asked[:-1]])
        plants = np.arange(len(self._arrived))
        for late, seconds in ((1, self._part), (0, 1 / RATE - self._part)):
            goal = self._asked[self._whole + late, plants]
            # 0/0: no time for no lag, nothing arrives; a lag of next to nothing: all does.
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                left = np.nan_to_num(np.exp(-seconds / self._lag), nan=1.0)[:, None]
            self._arrived = goal + (self._arrived - goal) * left
        return self._arrived


class ValvePlant:
    """A plant behind a valve whose outlet is measured: what it shows comes with what has arrived."""

    def __init__(self, plant: Plant, valve: Valve) -> None:
        self._plant, self._valve = plant, valve
        self._valves = Valves([valve], len(plant.schema.channels))

    @property
    def schema(self) -> Schema:
        """That of the plant."""
        return self._plant.schema

    def reset(self) -> Observation:
        """Plant and valve at commands of 0."""
        self._valves = Valves([self._valve], len(self.schema.channels))
        return self._plant.reset()

    def apply(self, commands: Float[np.ndarray, " channels"]) -> Observation:
        """One step of the loop with these commands; InputError as the plant raises it."""
        return self._plant.apply(self._valves.step(self.schema.check_commands(commands)[None])[0])
