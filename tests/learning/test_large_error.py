"""The probability of a large error: follows what it was fitted on, rises with both of its inputs."""

from dataclasses import replace

import numpy as np
import pytest
from schemas import published_schema

from exosight.learning.large_error import LargeError, error_probability, fit_large_error, is_large

SCHEMA = published_schema(32, 32)
OUTPUTS = len(SCHEMA.outputs)
MEANT = LargeError(("F_net",), (0.05,), -1.0, 1.5, 0.8)


def spread(total: np.ndarray) -> np.ndarray:
    """Values of the outputs with these sums."""
    return np.repeat(total[:, None] / OUTPUTS, OUTPUTS, axis=1)


def frames(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """True values, estimates, expected errors and OOD scores of frames whose errors are as MEANT says."""
    rng = np.random.default_rng(seed)
    truth = spread(rng.normal(0.5, 0.25, count))
    expected = spread(0.05 * np.exp(rng.normal(0, 1.5, count)))
    score = np.exp(rng.normal(0, 1, count))
    large = rng.random(count) < error_probability(MEANT, SCHEMA, expected, score)
    return truth, truth + spread(np.where(large, 0.1, 0.01)), expected, score


def test_the_fit_finds_the_probability_that_frames_were_drawn_with() -> None:
    truth, values, expected, score = frames(20_000, 0)
    nothing = np.empty((0, OUTPUTS)), np.empty(0)
    found = fit_large_error(SCHEMA, truth, values, expected, truth, score, nothing)
    # A fifth of 0.25 N, as is drawn above.
    assert (found.sensors, found.limits) == (("F_net",), (0.05,))
    # Standard errors are below 0.03 (weights of order one, 20,000 frames of which a third are large).
    weights = found.bias, found.error, found.ood
    np.testing.assert_allclose(weights, (MEANT.bias, MEANT.error, MEANT.ood), atol=0.12)
    assert np.array_equal(is_large(found, SCHEMA, values, truth), np.abs(values - truth).sum(axis=1) > 0.05)


def test_images_of_other_things_are_probably_wrong() -> None:
    """Errors of 1 mN throughout: what is left to learn from is that other things have a high OOD score."""
    truth, _, expected, _ = frames(500, 1)
    rng = np.random.default_rng(2)
    others = expected[:100], rng.uniform(20, 50, 100)
    usual = np.full(500, 0.5)
    found = fit_large_error(SCHEMA, truth, truth + 1e-4, expected, truth, usual, others)
    assert error_probability(found, SCHEMA, *others).min() > 0.5
    assert error_probability(found, SCHEMA, expected, usual).max() < 0.5


def test_the_probability_rises_with_expected_error_and_ood_score() -> None:
    width = np.geomspace(1e-4, 10, 30)
    rising = error_probability(MEANT, SCHEMA, spread(width), np.ones(30))
    assert (np.diff(rising) > 0).all()
    score = np.geomspace(0.01, 100, 40)
    along = error_probability(MEANT, SCHEMA, spread(np.full(40, 0.05)), score)
    within = score <= 1
    assert np.ptp(along[within]) == 0  # below its limit the score says nothing
    assert (np.diff(along[~within]) > 0).all()
    # At ê = limit and within the distribution only the bias is left.
    assert along[0] == pytest.approx(1 / (1 + np.e))


@pytest.mark.parametrize("changed", [{"sensors": ()}, {"limits": (0.0,)}, {"limits": (0.1, 0.1)}])
def test_what_means_nothing_is_refused(changed: dict[str, tuple]) -> None:
    with pytest.raises(ValueError, match="large_error: expected"):
        replace(MEANT, **changed)
