"""The probability of contact: right on average, and in the same order as before."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from exosight.learning.contact import contact_shift

FRAMES = 50


def shifted(probability: np.ndarray, shift: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-(np.log(probability) - np.log1p(-probability) + shift)))


@given(
    arrays.arrays(np.float64, (FRAMES, 7), elements=st.floats(0.001, 0.999)),
    arrays.arrays(np.bool_, (FRAMES, 7)),
)
def test_probabilities_add_up_to_the_frames_that_touch(probability: np.ndarray, touching: np.ndarray) -> None:
    shift = contact_shift(probability, touching)
    share = touching.mean(axis=0)
    tells = (share > 0) & (share < 1)
    found = shifted(probability, shift).mean(axis=0)
    np.testing.assert_allclose(found[tells], share[tells], atol=1e-9)
    assert np.all(shift[~tells] == 0)


def test_frames_that_came_more_often_are_set_right() -> None:
    """Odds learned where contact came r times as often are r times too high: the shift is −log r."""
    rng = np.random.default_rng(0)
    odds = np.exp(rng.normal(-2, 3, (200_000, 7)))
    touching = rng.random(odds.shape) < odds / (1 + odds)
    often = np.linspace(0.5, 20, 7)
    learned = often * odds / (1 + often * odds)
    # The standard error of a shift is that of a mean of 200,000 over its slope of some 0.05 a unit.
    np.testing.assert_allclose(contact_shift(learned, touching), -np.log(often), atol=0.05)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_certain_probabilities_stay_finite(value: float) -> None:
    touching = np.zeros((10, 7), bool)
    touching[:4] = True
    assert np.isfinite(contact_shift(np.full((10, 7), value), touching)).all()
