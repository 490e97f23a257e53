"""The paper's own results, for the side-by-side.

Source: M. I. Refai, A. Y. Alkayas, A. T. Mathew, F. Renda, T. G. Thuruthel, "Learning User Interaction
Forces using Vision for a Soft Finger Exosuit": Tables 3 and 4, and the text of its section "Results".
"""

from dataclasses import dataclass

from exosight.evaluation.metrics import SensorMetrics, Spread
from exosight.system.schema import Schema

SOURCE = "Refai et al., Learning User Interaction Forces using Vision for a Soft Finger Exosuit"

CONTACTS_PUBLISHED = (
    SensorMetrics("C1", "N", rmse=0.02, rms_percent=0.91, r=0.92, largest_true=2.41, largest_estimated=0.69),
    SensorMetrics("C2", "N", rmse=0.01, rms_percent=0.64, r=0.99, largest_true=1.40, largest_estimated=1.43),
    SensorMetrics("C3", "N", rmse=0.06, rms_percent=1.60, r=0.92, largest_true=3.70, largest_estimated=1.07),
    SensorMetrics("C4", "N", rmse=0.07, rms_percent=2.64, r=0.82, largest_true=2.69, largest_estimated=0.95),
    SensorMetrics("C5", "N", rmse=0.06, rms_percent=3.89, r=0.78, largest_true=1.67, largest_estimated=0.94),
    SensorMetrics("C6", "N", rmse=0.07, rms_percent=3.85, r=0.51, largest_true=1.74, largest_estimated=0.28),
    SensorMetrics("C7", "N", rmse=0.01, rms_percent=5.30, r=0.93, largest_true=0.17, largest_estimated=0.11),
)
"""Table 3 (RMSE [N], RMS% [%], r [-]) and the largest forces [N] of the text; split by frame."""


def is_published(schema: Schema) -> bool:
    """Whether a system is the paper's finger and exosuits: its results may stand beside the paper's."""
    names = tuple(contact.name for contact in CONTACTS_PUBLISHED)
    return schema.system in ("published", "index", "index-friction") and schema.outputs == names


@dataclass(frozen=True)
class PublishedCase:
    """One column of Table 4: mean ± SD over C1…C7."""

    rmse: Spread
    """[N]"""
    rms_percent: Spread
    """[% of the range of the true force]"""
    r: Spread
    """[-]"""


def _case(rmse: tuple[float, float], percent: tuple[float, float], r: tuple[float, float]) -> PublishedCase:
    return PublishedCase(Spread(*rmse, 7), Spread(*percent, 7), Spread(*r, 7))


ROBUSTNESS_PUBLISHED = {
    "clean": _case((0.04, 0.03), (2.72, 1.78), (0.83, 0.16)),
    "noise-low": _case((0.05, 0.03), (3.03, 2.03), (0.82, 0.16)),
    "noise-medium": _case((0.07, 0.03), (5.14, 3.98), (0.56, 0.19)),
    "noise-high": _case((0.09, 0.04), (6.42, 4.65), (0.11, 0.07)),
    "contrast-low": _case((0.05, 0.03), (3.58, 2.19), (0.78, 0.16)),
    "contrast-high": _case((0.08, 0.04), (5.06, 2.56), (0.77, 0.18)),
}
"""Table 4, keyed as exosight.vision.corruptions names its cases."""


@dataclass(frozen=True)
class PublishedSteadyState:
    """One steady-state test of the controller with K_P = 5 (N/N)."""

    target: float
    """F_t [N]."""
    settling_steps: int


STEADY_STATES_PUBLISHED = (
    PublishedSteadyState(target=0.25, settling_steps=7),
    PublishedSteadyState(target=0.30, settling_steps=5),
    PublishedSteadyState(target=0.35, settling_steps=14),
)


@dataclass(frozen=True)
class PublishedStep:
    """What the paper says of one step response: F_t = 0.2 N for 10 s, then 0 N for 10 s."""

    gain: float
    """K_P [N/N]."""
    outcome: str


STEPS_PUBLISHED = (
    PublishedStep(0.1, "too slow: u reaches 1.6 N at most before the target is switched off"),
    PublishedStep(1.0, "tracks the step (u = 2.4 N holds 0.2 N) and returns (u = −1 N)"),
    PublishedStep(100.0, "overshoots into a pose it never leaves: F_net stays at 0.23 N after 2.6 s"),
)

STEADY_STATE_GAIN = 5.0
"""K_P of the steady-state tests [N/N]."""
TRAINING_LIMIT = 4.0
"""Largest actuation u in the training data [N]."""
SHAPES = 1375
FRAMES_SIMULATED = 68_750
FRAMES_KEPT = 65_637
FRAMES_LEARNED = 39_382
"""60 % of those kept."""
PARAMETERS = 78_847
EPOCHS = 656
TRAINING_MINUTES = 270.0
"""On an NVIDIA Titan Xp [min]."""
