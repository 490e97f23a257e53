"""Trials of the closed loop: targets that are held and released, among them the six of the paper."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.control.adaptive import Adaptive
from exosight.control.guard import Guarded
from exosight.control.guarded import Sense, run_guarded
from exosight.control.laws import Proportional
from exosight.control.loop import RATE, Measure, Record, hold, hold_and_release, run
from exosight.control.plant import Plant
from exosight.control.responses import Response, measure_response
from exosight.exosuit.shapes import ExosuitShape, Linear

CONTROL_SHAPE = ExosuitShape(Linear(r0=0.010, r1=0.005), length=0.095)
"""The published system's exosuit in the paper's trials: a taper from 1 cm to 0.5 cm over 9.5 cm."""

STEADY_STATE_TARGETS = (0.25, 0.30, 0.35)
"""Constant targets F_t [N]."""
STEADY_STATE_GAIN = 5.0
"""K_P of the constant targets [N/N]."""
STEADY_STATE_STEPS = 50
"""Steps of the constant targets, 5 s: several times the 14 that the paper's slowest one takes to settle."""

STEP_TARGET = 0.2
"""F_t of the step responses [N], for STEP_SECONDS; then 0 N for as long."""
STEP_SECONDS = 10.0
"""[s]"""
STEP_GAINS = (0.1, 1.0, 100.0)
"""K_P of the step responses [N/N]."""


Asked = tuple[float, Float[np.ndarray, " _"]]
"""Gain K_P [the channel's unit per that of the sensor], and the target of each step [the sensor's unit]."""


@dataclass(frozen=True)
class Trial:
    """One run and what was measured on its true readings."""

    gain: float
    """K_P of the paper's law [the channel's unit per that of the sensor]; NaN: of another controller"""
    record: Record
    response: Response

    @property
    def law(self) -> str:
        """The paper's by its gain, such as "K_P = 5"; empty for another controller."""
        return "" if math.isnan(self.gain) else f"K_P = {self.gain:g}"

    @property
    def released(self) -> bool:
        """Whether the target ends at 0: a step response."""
        return bool(self.record.target[-1] == 0)

    @property
    def settling_steps(self) -> int | None:
        """Steps until the sensor stays within 5 % of the target; None if it never does."""
        steps = self.response.settling_steps
        return int(steps) if np.isfinite(steps) else None


def published_trials() -> list[Asked]:
    """The paper's six: constant targets, then step responses."""
    step = hold_and_release(STEP_TARGET, round(STEP_SECONDS * RATE))
    constant = [(STEADY_STATE_GAIN, hold(force, STEADY_STATE_STEPS)) for force in STEADY_STATE_TARGETS]
    return [*constant, *((gain, step) for gain in STEP_GAINS)]


def run_trials(
    plant: Plant,
    measure: Measure,
    asked: Iterable[Asked],
    sensor: str | None = None,
    channel: str | None = None,
) -> Iterator[Trial]:
    """Trials of the paper's law, each from rest, yielded as they finish; arguments as for `run`.

    asked   targets of one value above 0, perhaps released, as `measure_response` takes them
    """
    driven = plant.schema.channel(channel)
    for gain, target in asked:
        yield _measured(gain, run(plant, Proportional(gain, driven), measure, target, sensor, channel))


def run_guarded_trials(
    plant: Plant, guarded: Guarded | Adaptive, sense: Sense, targets: Iterable[Float[np.ndarray, " _"]]
) -> Iterator[Trial]:
    """Trials of a controller that judges its frames; arguments as for `run_guarded`, targets as above."""
    for target in targets:
        yield _measured(math.nan, run_guarded(plant, guarded, sense, target))


def _measured(gain: float, record: Record) -> Trial:
    response = measure_response(record.time, record.target, record.true, record.command, record.driven)
    return Trial(gain, record, response)
