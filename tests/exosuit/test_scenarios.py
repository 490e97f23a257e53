"""The eleven scenarios: on the grid, within bounds, distinct in geometry, reproducible."""

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.exosuit.scenarios import (
    SCENARIOS,
    SampledShape,
    sample_shapes,
    sampled_from_dict,
    sampled_to_dict,
)
from exosight.exosuit.shapes import FAMILIES, TABLE_I, ExosuitShape, Range, radius, ranges

SEEDS = st.integers(0, 2**32)
few = settings(max_examples=6, deadline=None)  # a draw takes tens of milliseconds


@pytest.fixture(scope="module")
def published_size() -> list[SampledShape]:
    return sample_shapes(125, seed=0)


def on_grid(value: float, allowed: Range) -> bool:
    steps = (value - allowed.low) / allowed.step
    # 1e-4 of a step: grid values are rounded to 1e-9, the finest step is 1e-4.
    return allowed.low <= value <= allowed.high and abs(steps - round(steps)) < 1e-4


def test_the_scenarios_are_the_published_eleven() -> None:
    assert len(SCENARIOS) == len({scenario.name for scenario in SCENARIOS}) == 11
    assert [s.family for s in SCENARIOS[1:6]] == [s.family for s in SCENARIOS[6:]] == list(FAMILIES)
    assert [s.length_varies for s in SCENARIOS] == [True] + [False] * 5 + [True] * 5


def test_the_published_number_of_shapes(published_size: list[SampledShape]) -> None:
    assert len(published_size) == 1375
    assert [s.shape_id for s in published_size] == list(range(1375))
    assert np.bincount([s.scenario for s in published_size]).tolist() == [125] * 11


def test_every_shape_is_on_the_grid_of_table_ii(published_size: list[SampledShape]) -> None:
    for sampled in published_size:
        surface = sampled.shape.surface
        for name, allowed in ranges(type(surface)).items():
            assert all(on_grid(value, allowed) for value in np.atleast_1d(getattr(surface, name)))
        assert on_grid(sampled.shape.length, ranges(ExosuitShape)["length"])


def test_every_shape_fits_its_scenario(published_size: list[SampledShape]) -> None:
    for sampled in published_size:
        scenario = SCENARIOS[sampled.scenario]
        assert sampled.shape.surface.family == scenario.family
        assert (sampled.shape.surface == TABLE_I.surface) == (not scenario.surface_varies)
        if scenario.surface_varies:
            assert (sampled.shape.length != 0.10) == scenario.length_varies


def test_the_table_i_taper_is_left_to_the_scenario_of_lengths() -> None:
    # With seed 1209 the second draw of the scenario `linear` is the taper itself, one in 3721.
    assert all(s.shape.surface != TABLE_I.surface for s in sample_shapes(4, seed=1209) if s.scenario > 0)


def test_draws_reach_both_ends_of_the_grid(published_size: list[SampledShape]) -> None:
    lengths = [s.shape.length for s in published_size if SCENARIOS[s.scenario].length_varies]
    # 750 draws from 401 lengths: the outermost 10 % are missed with probability 0.9^750.
    assert min(lengths) < 0.074
    assert max(lengths) > 0.106


@few
@given(SEEDS)
def test_no_two_shapes_have_one_geometry(seed: int) -> None:
    stations = np.linspace(0, 1, 101)
    shapes = sample_shapes(25, seed)
    profiles = np.array([radius(s.shape.surface, stations) for s in shapes])
    lengths = np.array([s.shape.length for s in shapes])
    for i, j in itertools.combinations(range(len(shapes)), 2):
        if lengths[i] == lengths[j]:
            assert np.abs(profiles[i] - profiles[j]).max() > 0.4e-6  # [m], half the stated resolution of 1 µm


def test_only_the_linear_family_is_straight(published_size: list[SampledShape]) -> None:
    # Clipping turns half of the Legendre draws into plain cylinders of 1 cm; none may stay.
    stations = np.linspace(0, 1, 101)
    for sampled in published_size:
        bend = np.abs(np.diff(radius(sampled.shape.surface, stations), 2)).max()
        if sampled.shape.surface.family != "linear":
            assert bend > 1e-12  # [m]; round-off of a straight profile is 1e-18


@few
@given(SEEDS, st.integers(1, 6), st.integers(0, 6))
def test_a_larger_draw_only_adds_shapes(seed: int, few_shapes: int, more: int) -> None:
    small, large = sample_shapes(few_shapes, seed), sample_shapes(few_shapes + more, seed)
    for scenario in range(len(SCENARIOS)):
        first = [s.shape for s in small if s.scenario == scenario]
        assert [s.shape for s in large if s.scenario == scenario][:few_shapes] == first


def test_a_scenario_does_not_depend_on_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = sample_shapes(3, seed=7)
    monkeypatch.setattr("exosight.exosuit.scenarios.SCENARIOS", SCENARIOS[:4])
    assert sample_shapes(3, seed=7) == whole[:12]


def test_the_seed_decides() -> None:
    assert sample_shapes(2, seed=1) == sample_shapes(2, seed=1)
    assert sample_shapes(2, seed=1) != sample_shapes(2, seed=2)


def test_the_whole_grid_of_lengths_can_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("exosight.exosuit.scenarios.SCENARIOS", SCENARIOS[:1])  # the scenario `length`
    lengths = sorted(s.shape.length for s in sample_shapes(401, seed=0))
    np.testing.assert_allclose(lengths, np.linspace(0.07, 0.11, 401), atol=1e-9)  # rounded to 1e-9 m


@pytest.mark.parametrize("per_scenario", [402, 0, -1])
def test_more_shapes_than_the_grid_holds_are_refused(per_scenario: int) -> None:
    with pytest.raises(InputError, match=rf"1…401.*'length'.*got {per_scenario}"):
        sample_shapes(per_scenario, seed=0)


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(InputError, match=r"seed: .*got -1"):
        sample_shapes(1, seed=-1)


def test_sampled_shapes_survive_json() -> None:
    for sampled in sample_shapes(1, seed=3):
        assert sampled_from_dict(json.loads(json.dumps(sampled_to_dict(sampled)))) == sampled


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"scenario": "width"}, "unknown scenario 'width'"),
        ({"shape_id": -1}, "shape_id"),
        ({"shape_id": "0"}, "shape_id"),
        ({"family": "spline"}, "unknown family 'spline'"),
    ],
)
def test_a_damaged_description_is_refused(change: dict, part: str) -> None:
    with pytest.raises(InputError, match=part):
        sampled_from_dict(sampled_to_dict(sample_shapes(1, seed=0)[0]) | change)
