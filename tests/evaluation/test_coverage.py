import numpy as np
import pytest
from schemas import published_schema

from exosight.errors import InputError
from exosight.evaluation import figures
from exosight.evaluation.coverage import calibration_table, evaluate_intervals, interval_table

SCHEMA = published_schema()
LEVELS = (0.5, 0.9)
Z = {0.5: 0.67449, 0.9: 1.64485}
"""Of a normal number's magnitude, this many standard deviations hold that share."""


def normal_errors(frames: int = 20_000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    estimated = rng.uniform(1, 2, (frames, 7)) * (rng.random((frames, 7)) < 0.5)
    return estimated + 0.1 * rng.normal(size=(frames, 7)), estimated


def test_intervals_of_known_errors_hold_what_they_promise() -> None:
    true, estimated = normal_errors()
    ends = {level: (estimated - 0.1 * Z[level], estimated + 0.1 * Z[level]) for level in LEVELS}
    found = evaluate_intervals(SCHEMA, true, estimated, ends)
    # Four standard deviations of a share of 10 000 frames.
    for k, level in enumerate(LEVELS):
        np.testing.assert_allclose(found.share[k], level, atol=4 * np.sqrt(level * (1 - level) / 1e4))
        np.testing.assert_allclose(found.width[k], 0.2 * Z[level], rtol=1e-12)
        np.testing.assert_array_equal(found.at(level), found.share[k, :, 0])
    assert found.calibration_error.max() < 0.02


def test_groups_are_told_apart() -> None:
    true, estimated = normal_errors()
    half = np.where(estimated == 0, 10.0, 0.0)  # everything, and nothing
    found = evaluate_intervals(SCHEMA, true, estimated, {0.9: (estimated - half, estimated + half)})
    np.testing.assert_array_equal(found.share[0, :, 1], 1)
    np.testing.assert_array_equal(found.share[0, :, 2], 0)
    np.testing.assert_allclose(found.share[0, :, 0], np.mean(estimated == 0, axis=0))
    np.testing.assert_allclose(found.calibration_error[:, 1:], [[0.1, 0.9]] * 7)


def test_a_group_without_frames_is_undefined() -> None:
    true, estimated = np.ones((5, 7)), np.ones((5, 7))
    found = evaluate_intervals(SCHEMA, true, estimated, {0.9: (estimated - 1, estimated + 1)})
    assert np.isnan(found.share[0, :, 1]).all()
    assert np.isnan(found.width[0, :, 1]).all()
    assert found.share[0, :, 2].tolist() == [1.0] * 7
    last = calibration_table("calibration", "Calibration", found).rows[-1]
    assert last[0] == "mean"
    assert last[1] == pytest.approx(10)
    assert np.isnan(last[2])


def test_tables_have_a_row_for_each_contact_and_level() -> None:
    true, estimated = normal_errors(50)
    found = evaluate_intervals(
        SCHEMA, true, estimated, {level: (estimated - level, estimated + level) for level in LEVELS}
    )
    rows = interval_table("intervals", "Intervals", found).rows
    assert [row[:2] for row in rows[:3]] == [("C1", 50.0), ("C1", 90.0), ("C2", 50.0)]
    assert len(rows) == 14
    assert rows[1][5:] == pytest.approx((1.8, 1.8))
    assert len(calibration_table("calibration", "Calibration", found).rows) == 8


def test_other_shapes_are_refused() -> None:
    true, estimated = normal_errors(10)
    for ends in ({}, {0.9: (estimated[1:], estimated)}):
        with pytest.raises(InputError, match="intervals: expected levels with one lower and one upper end"):
            evaluate_intervals(SCHEMA, true, estimated, ends)


def test_reliability_shows_promised_against_found() -> None:
    true, estimated = normal_errors(50)
    found = evaluate_intervals(
        SCHEMA, true, estimated, {level: (estimated - level, estimated + level) for level in LEVELS}
    )
    figure = figures.reliability(found)
    everything, zero, force = figure.axes
    for k, ax in enumerate((everything, zero, force)):
        lines = {line.get_label(): line for line in ax.lines}
        np.testing.assert_allclose(lines["C3"].get_xdata(), [50, 90])
        np.testing.assert_allclose(lines["C3"].get_ydata(), 100 * found.share[:, 2, k])
    assert everything.get_ylabel() == "true value inside [% of frames]"
