"""Intervals hold the share of frames that they promise, whatever the errors look like."""

import numpy as np
import pytest

from exosight.errors import InputError
from exosight.learning.intervals import FEW, LEVELS, calibrate_intervals, interval

FORCES = np.ones(7, dtype=bool)


def drawn(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimates, expected errors and truths: heavy-tailed errors, expected wrongly by a factor a contact."""
    rng = np.random.default_rng(seed)
    forces = np.maximum(0, rng.normal(0.2, 0.3, (count, 7)))
    expected = rng.uniform(0.01, 0.1, (count, 7))
    error = rng.standard_t(3, (count, 7)) * expected * np.linspace(0.5, 3, 7)
    truth = np.where(forces > 0, forces + error, np.maximum(0, error) * (rng.random((count, 7)) < 0.1))
    return forces, expected, truth


@pytest.mark.parametrize("level", LEVELS)
def test_coverage_on_new_frames_is_the_level(level: float) -> None:
    widths = calibrate_intervals(*drawn(20_000, 0), FORCES)
    forces, expected, truth = drawn(20_000, 1)
    low, high = interval(widths, level, forces, expected, FORCES)
    # A lower end below zero is cut off, which these truths, unlike forces, may be.
    covered = (truth <= high + 1e-6) & ((truth >= low - 1e-6) | (low == 0))
    for i in range(7):
        pressed = forces[:, i] > 0
        # Four standard deviations of both quantile and count, about 15,000 frames each; cut ends only add.
        slack = 4 * np.sqrt(2 * level * (1 - level) / pressed.sum())
        assert covered[pressed, i].mean() > level - slack
        # Nine in ten of the frames without a force are exactly right: the width is zero up to 90 %.
        assert covered[~pressed, i].mean() > max(level, 0.9) - 4 * np.sqrt(0.2 / (~pressed).sum())


def test_far_from_zero_coverage_is_not_above_the_level_either() -> None:
    def shifted(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        forces, expected, _ = drawn(20_000, seed)
        noise = np.random.default_rng(seed + 10).standard_t(3, forces.shape) * expected
        return forces + 10, expected, forces + 10 + noise

    widths = calibrate_intervals(*shifted(0), FORCES)
    forces, expected, truth = shifted(1)
    for level in LEVELS:
        low, high = interval(widths, level, forces, expected, FORCES)
        covered = ((truth >= low) & (truth <= high)).mean(axis=0)
        # Four standard deviations of quantile and count.
        assert covered == pytest.approx(level, abs=4 * np.sqrt(2 * level * (1 - level) / 20_000))


def test_few_frames_give_wide_intervals_to_estimates_of_zero_and_of_a_force_alike() -> None:
    forces, expected, truth = drawn(FEW + 5, 0)
    forces = forces + 1
    forces[: FEW - 1, 0] = 0
    widths = calibrate_intervals(forces, expected, truth, FORCES)
    largest = np.max(np.abs(forces - truth) / expected, axis=0)
    assert widths.estimated_force[LEVELS.index(0.99)] == pytest.approx(largest)
    assert widths.estimated_zero == widths.estimated_force
    forces[FEW - 1, 0] = 0
    own = calibrate_intervals(forces, expected, truth, FORCES).estimated_zero
    zeros = (np.abs(forces - truth) / expected)[:FEW, 0]
    assert own[LEVELS.index(0.99)][0] == pytest.approx(zeros.max())


def test_a_level_that_was_not_calibrated_is_refused() -> None:
    with pytest.raises(InputError, match=r"level: expected one of 0.5, 0.8, .*, got 0.7"):
        interval(calibrate_intervals(*drawn(10, 0), FORCES), 0.7, *drawn(10, 0)[:2], FORCES)


def test_intervals_of_angles_hold_on_both_sides_of_zero() -> None:
    """Angles have no zero of their own: one width for all of them, and no end that is cut off."""
    angles = np.array([False])

    def turned(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rng = np.random.default_rng(seed)
        value, error = rng.normal(0, 0.1, (20_000, 1)), rng.normal(0, 0.05, (20_000, 1))
        value[:500] = 0.0
        return value, np.full_like(value, 0.02), value + error

    widths = calibrate_intervals(*turned(0), angles)
    value, expected, truth = turned(1)
    for level in LEVELS:
        low, high = interval(widths, level, value, expected, angles)
        covered = float(((truth >= low) & (truth <= high)).mean())
        # Four standard deviations of quantile and count.
        assert covered == pytest.approx(level, abs=4 * np.sqrt(2 * level * (1 - level) / 20_000))
        assert low[0, 0] < 0 < high[0, 0]
