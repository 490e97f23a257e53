"""Trials of the closed loop: targets that are held and released, and the paper's study of one exosuit.

The paper's: three constant targets and three step responses of the published system's F_net.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.control.laws import Proportional
from exosight.control.loop import RATE, Measure, Record, hold, hold_and_release, run
from exosight.control.plant import Plant
from exosight.control.responses import Response, measure_response
from exosight.exosuit.shapes import ExosuitShape, Linear

CONTROL_SHAPE = ExosuitShape(Linear(r0=0.010, r1=0.005), length=0.095)
"""The published system's exosuit in the paper's study: a taper from 1 cm to 0.5 cm over 9.5 cm."""

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


@dataclass(frozen=True)
class Trial:
    """One run and what was measured on its true readings."""

    gain: float
    """K_P [the channel's unit per that of the sensor]"""
    record: Record
    response: Response


@dataclass(frozen=True)
class ControllerStudy:
    """The six runs of the paper."""

    steady_states: tuple[Trial, ...]
    """One a target of STEADY_STATE_TARGETS."""
    step_responses: tuple[Trial, ...]
    """One a gain of STEP_GAINS."""


def run_trial(
    plant: Plant,
    law: Proportional,
    measure: Measure,
    target: Float[np.ndarray, " steps"],
    sensor: str | None = None,
    channel: str | None = None,
) -> Trial:
    """One run of the paper's law from rest, measured on the true readings; arguments as for `run`.

    target   (steps,)  one value above 0, perhaps released, as `measure_response` takes it
    """
    record = run(plant, law, measure, target, sensor, channel)
    response = measure_response(record.time, record.target, record.true, record.command, record.driven)
    return Trial(law.gain, record, response)


def study(
    plant: Plant, measure: Measure, done: Callable[[Trial], None] = lambda trial: None
) -> ControllerStudy:
    """The six runs of the paper, each from rest, with the paper's law.

    plant    in the paper an `exosight.control.simulated.SimulatedPlant` of an exosuit with CONTROL_SHAPE
    measure  `from_image(estimator, plant.schema)`, or `true_reading()` for a perfect sensor
    done     called with each run as it finishes
    """

    def trial(gain: float, target: Float[np.ndarray, " steps"]) -> Trial:
        finished = run_trial(plant, Proportional(gain, plant.schema.channels[0]), measure, target)
        done(finished)
        return finished

    steps = hold_and_release(STEP_TARGET, round(STEP_SECONDS * RATE))
    return ControllerStudy(
        steady_states=tuple(
            trial(STEADY_STATE_GAIN, hold(force, STEADY_STATE_STEPS)) for force in STEADY_STATE_TARGETS
        ),
        step_responses=tuple(trial(gain, steps) for gain in STEP_GAINS),
    )
