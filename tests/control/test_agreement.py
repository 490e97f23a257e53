"""Agreement of a network with a model."""

from statistics import NormalDist

import numpy as np
import pytest

from exosight.control.agreement import LIMIT, MODEL_ERROR, agreement
from exosight.control.estimator import Reading


def _reading(values: list[float], half: float) -> Reading:
    row = np.array([values], np.float32)
    none = np.zeros(1, np.float32)
    return Reading(row, np.maximum(row - np.float32(half), 0), row + np.float32(half), 0 * row, none)


@pytest.mark.parametrize("level", [0.5, 0.9, 0.99])
def test_an_interval_stands_for_its_normal_deviation(level: float) -> None:
    """Half a 90 % interval is 1.64 deviations; what is cut off at 0 counts as if it were not."""
    half = NormalDist().inv_cdf((1 + level) / 2) * 0.03
    found = agreement(("a", "b"), _reading([0.01, 0.5], half), level, np.array([0.01, 0.4]), np.full(2, 0.04))
    floor = MODEL_ERROR * 0.4
    # Readings are of single precision.
    np.testing.assert_allclose(found.deviation, np.sqrt(0.03**2 + 0.04**2 + floor**2), rtol=1e-5)
    np.testing.assert_allclose(found.difference, [0.0, 0.1], atol=1e-7)
    assert found.score == pytest.approx(0.1 / found.deviation[1] / LIMIT, rel=1e-5)


def test_no_force_in_either_is_agreement() -> None:
    found = agreement(("a",), _reading([0.0], 0.0), 0.9, np.zeros(1), np.zeros(1))
    assert found.score == 0
