import numpy as np
import pytest
from schemas import mixed_schema, published_schema

from exosight.errors import InputError
from exosight.evaluation.details import detail_table, evaluate_details, resampled_r

SCHEMA = published_schema()
FRAMES = 400


@pytest.fixture
def true() -> np.ndarray:
    """Half of the frames of each contact are free; the others press with up to 1 N."""
    rng = np.random.default_rng(0)
    return (rng.uniform(0.01, 1, (FRAMES, 7)) * (rng.random((FRAMES, 7)) < 0.5)).astype(np.float32)


UP = np.where(np.arange(FRAMES) < FRAMES // 2, 1, -1).astype(np.int8)


DESIGNS = np.repeat(np.arange(40), FRAMES // 40).astype(np.int32)


def touching(forces: np.ndarray) -> np.ndarray:
    return (forces > 0).astype(np.float32)


def test_perfect_estimates_have_no_error(true: np.ndarray) -> None:
    for d in evaluate_details(SCHEMA, true, true, touching(true), UP, DESIGNS):
        assert (d.r2, d.f1, d.p95, d.largest, d.rmse_loading, d.rmse_unloading) == (1, 1, 0, 0, 0, 0)


def test_the_mean_explains_nothing_and_all_contact_is_half_right(true: np.ndarray) -> None:
    mean = np.tile(true.mean(axis=0), (FRAMES, 1))
    for i, d in enumerate(evaluate_details(SCHEMA, true, mean, np.ones_like(true), UP, DESIGNS)):
        assert d.r2 == pytest.approx(0, abs=1e-6)  # the mean is rounded to single precision
        share = np.mean(true[:, i] > 0)
        assert d.f1 == pytest.approx(2 * share / (1 + share))


def test_rare_errors_show_in_the_largest_and_not_in_the_percentile(true: np.ndarray) -> None:
    estimated = true + np.float32(0.01)
    estimated[:4, 2] += 0.49  # one in a hundred
    d = evaluate_details(SCHEMA, true, estimated, touching(true), UP, DESIGNS)[2]
    # Sums of numbers up to 1.5 in single precision.
    assert d.p95 == pytest.approx(0.01, abs=1e-6)
    assert d.largest == pytest.approx(0.5, abs=1e-6)


def test_loading_and_unloading_are_told_apart(true: np.ndarray) -> None:
    estimated = true + np.where(UP > 0, 0.1, 0.3).astype(np.float32)[:, None]
    d = evaluate_details(SCHEMA, true, estimated, touching(true), UP, DESIGNS)[0]
    assert d.rmse_loading == pytest.approx(0.1, abs=1e-6)
    assert d.rmse_unloading == pytest.approx(0.3, abs=1e-6)
    only_up = evaluate_details(SCHEMA, true, estimated, touching(true), np.ones_like(UP), DESIGNS)[0]
    assert np.isnan(only_up.rmse_unloading)


def test_forces_below_a_millinewton_do_not_count_as_contact() -> None:
    true = np.zeros((2, 7), np.float32)
    true[0], true[1] = 0.9e-3, 1e-3
    said = np.array([[0.4] * 7, [0.6] * 7], np.float32)
    assert [
        d.f1 for d in evaluate_details(SCHEMA, true, true, said, np.ones(2, np.int8), np.zeros(2, np.int32))
    ] == [1.0] * 7


def test_what_never_happens_is_undefined_and_left_out_of_means(true: np.ndarray) -> None:
    true[:, 6] = 0
    found = evaluate_details(SCHEMA, true, true, touching(true), UP, DESIGNS)
    assert np.isnan([found[6].r2, found[6].r_low, found[6].r_high]).all()
    assert np.isnan(found[6].f1)
    table = detail_table("details", "Details", SCHEMA, found)
    assert [row[0] for row in table.rows] == ["C1", "C2", "C3", "C4", "C5", "C6", "C7", "mean"]
    assert table.rows[-1][3:5] == (1.0, 1.0)


def test_an_angle_has_no_contact_and_without_a_direction_none_is_shown(true: np.ndarray) -> None:
    schema, values = mixed_schema(), true[:, :4]
    found = evaluate_details(schema, values, values, touching(values), 0 * UP, DESIGNS)
    assert [np.isnan(d.f1) for d in found] == [False, True, False, False]
    table = detail_table("details", "Details", schema, found)
    assert "loading" not in [column.name for column in table.columns]
    assert table.rows[1][0] == "knuckle_of_the_index [rad]"
    mean = dict(zip([column.name for column in table.columns], table.rows[-1], strict=True))
    assert mean["R²"] == 1
    assert mean["largest"] is None  # newtons and radians have no mean


def test_wrong_probabilities_and_forces_are_refused(true: np.ndarray) -> None:
    with pytest.raises(InputError, match="probabilities within 0…1"):
        evaluate_details(SCHEMA, true, true, 2 * np.ones_like(true), UP, DESIGNS)
    true[3, 2] = np.nan
    with pytest.raises(InputError, match="expected finite numbers"):
        evaluate_details(SCHEMA, true, true, touching(true), UP, DESIGNS)


def test_r_of_other_designs_spreads_as_theory_says() -> None:
    """Of independent normal pairs Fisher's z has a deviation of 1/√(n − 3); every design is one frame."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal((500, 1))
    y = 0.8 * x + 0.6 * rng.standard_normal((500, 1))
    low, high = resampled_r(x, y, np.arange(500, dtype=np.int32))
    z = np.arctanh(np.corrcoef(x[:, 0], y[:, 0])[0, 1])
    expected = np.tanh(z + np.array([-1.96, 1.96]) / np.sqrt(497))
    # A quantile of 2000 draws is known to about a tenth of the deviation, which is 0.017 in r.
    np.testing.assert_allclose([low[0], high[0]], expected, atol=0.006)


def test_frames_of_one_design_add_no_certainty() -> None:
    """Ten equal frames of each leave the interval where it was; taken for ten designs they would not."""
    rng = np.random.default_rng(4)
    x = rng.standard_normal((100, 7))
    y = x + rng.standard_normal((100, 7))
    once = resampled_r(x, y, np.arange(100, dtype=np.int32))
    tenfold = [np.repeat(values, 10, axis=0) for values in (x, y)]
    np.testing.assert_allclose(resampled_r(*tenfold, np.repeat(np.arange(100, dtype=np.int32), 10)), once)
    narrow = resampled_r(*tenfold, np.arange(1000, dtype=np.int32))
    np.testing.assert_array_less(np.diff(narrow, axis=0), np.diff(once, axis=0) / 2)


def test_r_that_is_not_defined_has_no_interval() -> None:
    x = np.random.default_rng(5).standard_normal((30, 2)) + 1e3
    y = x.copy()
    y[:, 1] = 0.1
    found = resampled_r(x, y, np.arange(30, dtype=np.int32))
    np.testing.assert_allclose(found[:, 0], 1.0)
    assert np.isnan(found[:, 1]).all()
