"""Random numbers that belong to a frame: their distribution, and what they depend on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest, norm

from exosight.errors import InputError
from exosight.vision.counter_rng import mix, normal_quantiles, pick, uniforms

seeds = st.integers(0, 2**63 - 1)


def test_generator_is_splitmix64() -> None:
    """The first three outputs from state 0, as published with the reference implementation."""
    step = 0x9E3779B97F4A7C15
    found = [int(mix(np.uint64(step * k % 2**64))) for k in (1, 2, 3)]
    assert found == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]


@given(seeds, st.lists(st.integers(0, 2**62), min_size=1, max_size=8), st.integers(1, 5))
def test_a_row_depends_on_its_number_alone(seed: int, numbers: list[int], count: int) -> None:
    together = uniforms(seed, np.array(numbers), 5)
    for row, number in zip(together, numbers, strict=True):
        np.testing.assert_array_equal(uniforms((seed,), np.array([number]), count)[0], row[:count])


def test_numbers_are_even_and_independent() -> None:
    values = uniforms(0, np.arange(4000), 6)
    assert kstest(values.ravel(), "uniform").pvalue > 1e-4
    across = np.corrcoef(values.T)[np.triu_indices(6, 1)]
    along = np.corrcoef(values[:-1, 0], values[1:, 0])[0, 1]
    assert np.abs([*across, along]).max() < 5 / np.sqrt(4000)  # five standard errors of no correlation


@pytest.mark.parametrize("other", [(1,), (0, 0), (0, 1), (1, 0)])
def test_seeds_give_unrelated_numbers(other: tuple[int, ...]) -> None:
    one, two = uniforms((0,), np.arange(4000), 1), uniforms(other, np.arange(4000), 1)
    assert abs(np.corrcoef(one[:, 0], two[:, 0])[0, 1]) < 5 / np.sqrt(4000)


def test_normal_quantiles_are_those_of_the_normal_distribution() -> None:
    quantiles = normal_quantiles()
    np.testing.assert_allclose(quantiles, norm.ppf((np.arange(65536) + 0.5) / 65536), rtol=1e-6, atol=1e-7)
    # 16 bits hold all but 3e-5 of the variance, which lies in the tails that they cut off.
    assert quantiles.var(dtype=float) == pytest.approx(1, abs=1e-4)


def test_each_kind_is_picked_as_often() -> None:
    picked = pick(uniforms(3, np.arange(3000), 1)[:, 0], (2, 5, 7))
    counts = [np.sum(picked == kind) for kind in (2, 5, 7)]
    assert sum(counts) == 3000
    assert np.abs(np.array(counts) - 1000).max() < 5 * np.sqrt(3000 * 2 / 9)  # five standard deviations


@pytest.mark.parametrize(("seed", "number"), [(-1, 0), (0, -1), ((0, -1), 0), ((), 0), (2**63, 0)])
def test_impossible_seeds_are_refused(seed: int | tuple[int, ...], number: int) -> None:
    with pytest.raises(InputError, match="whole numbers from 0"):
        uniforms(seed, np.array([number]), 1)
