import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from schemas import mixed_schema, published_schema

from exosight.errors import InputError
from exosight.evaluation.metrics import Scores, spread
from exosight.evaluation.metrics import score as score_of
from exosight.evaluation.published import CONTACTS_PUBLISHED, ROBUSTNESS_PUBLISHED, is_published

SCHEMA = published_schema()

# Whole millinewtons up to 4 N: every force then differs from its neighbour by much more than round-off.
FORCES = arrays(np.int64, (12, 7), elements=st.integers(0, 4000)).map(lambda forces: forces / 1000)


def score(true: np.ndarray, estimated: np.ndarray) -> Scores:
    return score_of(SCHEMA, true, estimated)


def random_forces(seed: int = 0, frames: int = 50) -> np.ndarray:
    return np.random.default_rng(seed).gamma(1.0, 0.2, (frames, 7))


def per_contact(scores: Scores, quantity: str) -> np.ndarray:
    return np.array([getattr(contact, quantity) for contact in scores.outputs])


def test_perfect_estimate_has_no_error_and_correlation_one():
    true = random_forces()
    scores = score(true, true.copy())
    assert (per_contact(scores, "rmse") == 0).all()
    # Rounding of the two norms: a few units in the last place.
    np.testing.assert_allclose(per_contact(scores, "r"), 1, rtol=1e-12)
    np.testing.assert_array_equal(per_contact(scores, "largest_true"), true.max(axis=0))


def test_known_offset_is_the_rmse_and_leaves_the_correlation_at_one():
    true = random_forces()
    offset = np.linspace(-0.03, 0.03, 7)
    scores = score(true, true + offset)
    # Adding 0.03 to forces near 1 N rounds at 1e-16 N.
    np.testing.assert_allclose(per_contact(scores, "rmse"), np.abs(offset), atol=1e-14)
    np.testing.assert_allclose(per_contact(scores, "r"), 1, rtol=1e-12)
    expected = 100 * np.abs(offset) / np.ptp(true, axis=0)
    np.testing.assert_allclose(per_contact(scores, "rms_percent"), expected, rtol=1e-9, atol=1e-11)


def test_hand_computed_example():
    true, estimated = np.zeros((4, 7)), np.zeros((4, 7))
    true[:, 0] = [0, 1, 2, 3]
    estimated[:, 0] = [1, 1, 2, 2]
    first = score(true, estimated).outputs[0]
    # Squared errors 1, 0, 0, 1; covariance 1/2, variances 5/4 and 1/4.
    assert first.rmse == pytest.approx(math.sqrt(0.5), rel=1e-14)
    assert first.rms_percent == pytest.approx(100 * math.sqrt(0.5) / 3, rel=1e-14)
    assert first.r == pytest.approx(0.5 / math.sqrt(5 / 16), rel=1e-14)
    assert (first.largest_true, first.largest_estimated) == (3, 2)


def test_correlation_agrees_with_numpy():
    true, estimated = random_forces(1), random_forces(2)
    expected = [np.corrcoef(true[:, i], estimated[:, i])[0, 1] for i in range(7)]
    # Two orders of summation over 50 numbers.
    np.testing.assert_allclose(per_contact(score(true, estimated), "r"), expected, rtol=1e-12, atol=1e-13)


@given(FORCES, FORCES, st.sampled_from([1e-3, 0.2248, 1e6]))
def test_changing_the_unit_scales_rmse_alone(true, estimated, factor):
    newtons, other = score(true, estimated), score(factor * true, factor * estimated)
    # Each step of the formulas rounds at 1e-16 of the largest force, 4 N.
    np.testing.assert_allclose(
        per_contact(other, "rmse"), factor * per_contact(newtons, "rmse"), rtol=1e-12, atol=factor * 1e-14
    )
    np.testing.assert_allclose(
        per_contact(other, "rms_percent"), per_contact(newtons, "rms_percent"), rtol=1e-12, atol=1e-9
    )
    np.testing.assert_allclose(per_contact(other, "r"), per_contact(newtons, "r"), atol=1e-10)


@given(FORCES, FORCES)
def test_correlation_ignores_gain_and_offset_and_changes_sign_with_the_estimate(true, estimated):
    reference = per_contact(score(true, estimated), "r")
    np.testing.assert_allclose(per_contact(score(true, 3 * estimated + 1), "r"), reference, atol=1e-10)
    np.testing.assert_allclose(per_contact(score(true, -estimated), "r"), -reference, atol=1e-10)
    defined = reference[~np.isnan(reference)]
    assert (np.abs(defined) <= 1).all()


def test_order_of_the_frames_does_not_matter():
    true, estimated = random_forces(1), random_forces(2)
    order = np.random.default_rng(0).permutation(len(true))
    a, b = score(true, estimated), score(true[order], estimated[order])
    for quantity in ("rmse", "rms_percent", "r"):
        np.testing.assert_allclose(per_contact(a, quantity), per_contact(b, quantity), rtol=1e-12)


def test_net_force_is_the_sum_of_the_seven():
    true, estimated = random_forces(1), random_forces(2)
    net = score(true, estimated).sums[0]
    error = estimated.sum(axis=1) - true.sum(axis=1)
    assert net.name == "F_net"
    assert net.rmse == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-12)
    assert net.largest_true == true.sum(axis=1).max()


def test_single_precision_estimates_are_compared_in_double():
    true = random_forces()
    rmse = per_contact(score(true, true.astype(np.float32)), "rmse")
    assert (rmse > 0).all()
    assert (rmse < 1e-7).all()  # half a float32 step of forces near 1 N


def test_contact_that_never_varies_is_undefined_left_out_of_the_mean_and_counted():
    true, estimated = random_forces(1), random_forces(2)
    # A constant whose mean rounds: the variance is not zero then, yet nothing varies.
    true[:, 3] = 0.1
    scores = score(true, estimated)
    assert math.isnan(scores.outputs[3].r)
    assert math.isnan(scores.outputs[3].rms_percent)
    assert scores.outputs[3].rmse > 0
    assert (scores.r.count, scores.rms_percent.count, scores.rmse.count) == (6, 6, 7)
    others = np.delete(per_contact(scores, "r"), 3)
    assert scores.r.mean == pytest.approx(others.mean(), rel=1e-12)
    assert scores.r.sd == pytest.approx(others.std(ddof=1), rel=1e-12)


def test_estimate_that_never_varies_has_no_correlation_but_an_error():
    true = random_forces()
    estimated = true.copy()
    estimated[:, 0] = 0.1
    first = score(true, estimated).outputs[0]
    assert math.isnan(first.r)
    assert first.rms_percent > 0


def test_sums_and_units_follow_the_schema():
    """An angle among forces: the grip is the sum of two of them, and errors in N and rad have no mean."""
    schema = mixed_schema()
    rng = np.random.default_rng(0)
    true = rng.gamma(1.0, 0.2, (50, 4)) * [1, -1, 1, 1]
    found = score_of(schema, true, true + np.array([0.1, 0.2, 0.3, 0.3]))
    assert [(o.name, o.unit) for o in found.outputs] == [
        ("zone_0", "N"),
        ("knuckle_of_the_index", "rad"),
        ("zone_1", "N"),
        ("zone_2", "N"),
    ]
    assert [o.rmse for o in found.outputs] == pytest.approx([0.1, 0.2, 0.3, 0.3])
    (grip,) = found.sums
    assert (grip.name, grip.rmse) == ("grip", pytest.approx(0.6))
    assert grip.largest_true == pytest.approx((true[:, 2] + true[:, 3]).max())
    assert math.isnan(found.rmse.mean)
    assert found.r.mean == pytest.approx(1)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("which", ["true", "estimated"])
def test_numbers_that_are_not_finite_are_refused(bad, which):
    forces = {"true": random_forces(1), "estimated": random_forces(2)}
    forces[which][7, 2] = bad
    with pytest.raises(InputError, match=rf"{which} values: .* in frame 7"):
        score(**forces)


@pytest.mark.parametrize("shape", [(0, 7), (5, 8), (7,), (5, 7, 1)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(InputError, match=r"expected shape \(frames, 7\)"):
        score(np.zeros(shape), np.zeros(shape))


def test_different_numbers_of_frames_are_refused():
    with pytest.raises(InputError, match="got 3 and 4"):
        score(np.zeros((4, 7)), np.zeros((3, 7)))


def test_spread_of_too_few_numbers_is_undefined():
    assert math.isnan(spread([math.nan]).mean)
    one = spread([2.0, math.nan])
    assert (one.mean, one.count) == (2.0, 1)
    assert math.isnan(one.sd)


@pytest.mark.parametrize(
    ("quantity", "tolerance"),
    [
        # Half a digit of the seven printed values and half a digit of their printed mean.
        ("rmse", 0.01),
        ("r", 0.01),
        # The paper's two tables differ by 0.04 % here, more than their rounding.
        ("rms_percent", 0.05),
    ],
)
def test_means_of_the_papers_contacts_are_its_clean_column(quantity, tolerance):
    ours = spread([getattr(contact, quantity) for contact in CONTACTS_PUBLISHED])
    paper = getattr(ROBUSTNESS_PUBLISHED["clean"], quantity)
    assert ours.mean == pytest.approx(paper.mean, abs=tolerance)
    assert ours.sd == pytest.approx(paper.sd, abs=tolerance)


def test_sample_standard_deviation_is_the_papers_choice():
    values = np.array([contact.r for contact in CONTACTS_PUBLISHED])
    printed = ROBUSTNESS_PUBLISHED["clean"].r.sd
    assert round(values.std(ddof=1), 2) == printed
    assert round(values.std(ddof=0), 2) != printed


def test_only_the_published_system_is_the_papers():
    assert is_published(SCHEMA)
    assert tuple(contact.name for contact in CONTACTS_PUBLISHED) == SCHEMA.outputs
    assert not is_published(mixed_schema())
    assert not is_published(replace(SCHEMA, system="mine"))
