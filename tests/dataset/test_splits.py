"""Splits: disjoint, complete, reproducible, of the promised sizes, and never a design on two sides."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.dataset.frames import Frames, take
from exosight.dataset.splits import PROTOCOLS, Split, make_split
from exosight.errors import InputError

from .conftest import FAMILIES, SCENARIOS, designs_of, made_up

WHOLE = made_up(designs_of(20), per_design=4)
TOTAL = 120
SEEDS = st.integers(0, 2**32)
PARTS = ("train", "validation", "test")
unhurried = settings(max_examples=30, deadline=None)


def parts_of(split: Split) -> list[np.ndarray]:
    return [getattr(split, name) for name in PARTS]


def any_split(frames: Frames, protocol: str, seed: int) -> Split:
    held_out = {"family": "waved", "variation": "plant.young"}.get(protocol)
    return make_split(frames, protocol, seed, held_out, {"plant.young": by_design(frames)}, FAMILIES)


def by_design(frames: Frames) -> np.ndarray:
    """Something that varies from design to design, in no order."""
    return (frames.design * 37 % TOTAL) / float(TOTAL)


@st.composite
def thinned(draw) -> Frames:
    """The frames left when some were dropped, as filters do, in any order."""
    kept = draw(st.lists(st.integers(0, len(WHOLE) - 1), min_size=200, max_size=len(WHOLE), unique=True))
    return take(WHOLE, np.array(kept))


@unhurried
@given(thinned(), st.sampled_from(PROTOCOLS), SEEDS)
def test_every_frame_is_in_exactly_one_part(frames: Frames, protocol: str, seed: int) -> None:
    parts = parts_of(any_split(frames, protocol, seed))
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(len(frames)))
    assert all(len(part) > 0 for part in parts)
    assert all(np.all(np.diff(part) > 0) for part in parts)


@unhurried
@given(thinned(), st.sampled_from(["design", "family", "variation"]), SEEDS)
def test_no_design_is_on_two_sides(frames: Frames, protocol: str, seed: int) -> None:
    sides = [set(frames.design[part]) for part in parts_of(any_split(frames, protocol, seed))]
    for one, other in itertools.combinations(sides, 2):
        assert not one & other


def test_the_split_by_frame_does_put_designs_on_two_sides() -> None:
    split = make_split(WHOLE, "frame", seed=0)
    assert set(WHOLE.design[split.train]) & set(WHOLE.design[split.test])


@unhurried
@given(st.sampled_from(PROTOCOLS), SEEDS)
def test_the_seed_decides(protocol: str, seed: int) -> None:
    first, again, other = (any_split(WHOLE, protocol, each) for each in (seed, seed, seed + 1))
    for one, two in zip(parts_of(first), parts_of(again), strict=True):
        np.testing.assert_array_equal(one, two)
    assert not np.array_equal(first.train, other.train)


@unhurried
@given(st.integers(5, len(WHOLE)), SEEDS)
def test_sizes_by_frame(count: int, seed: int) -> None:
    split = make_split(take(WHOLE, np.arange(count)), "frame", seed)
    for part, share in zip(parts_of(split), (0.6, 0.2, 0.2), strict=True):
        assert abs(len(part) - share * count) <= 1  # two roundings of at most a half


@unhurried
@given(st.lists(st.integers(0, TOTAL - 1), min_size=5, unique=True), SEEDS)
def test_sizes_by_design(numbers: list[int], seed: int) -> None:
    frames = take(WHOLE, np.flatnonzero(np.isin(WHOLE.design, numbers)))
    split = make_split(frames, "design", seed)
    for part, share in zip(parts_of(split), (0.6, 0.2, 0.2), strict=True):
        assert abs(len(set(frames.design[part])) - share * len(numbers)) <= 1  # whole designs


def test_every_part_holds_every_scenario_evenly() -> None:
    split = make_split(WHOLE, "design", seed=4)
    for scenario in range(len(SCENARIOS)):
        mine = WHOLE.scenario == scenario
        counts = [len(set(WHOLE.design[part][mine[part]])) for part in parts_of(split)]
        assert counts == [12, 4, 4]


@pytest.mark.parametrize("held_out", FAMILIES)
def test_a_held_out_family_is_the_whole_test_part(held_out: str) -> None:
    split = make_split(WHOLE, "family", seed=1, held_out=held_out, families=FAMILIES)
    family = FAMILIES.index(held_out)
    np.testing.assert_array_equal(split.test, np.flatnonzero(WHOLE.family == family))
    rest = [len(set(WHOLE.design[part])) for part in (split.train, split.validation)]
    total = TOTAL - (40 if held_out == "plain" else 20)  # plain has two scenarios of 20 designs
    assert abs(rest[0] - 0.75 * total) <= 1
    assert sum(rest) == total


@unhurried
@given(thinned(), SEEDS, st.integers(0, 2**32), st.booleans())
def test_the_largest_fifth_of_a_variation_is_the_whole_test_part(
    frames: Frames, seed: int, drawn: int, whole: bool
) -> None:
    """Whether it is the design's (its modulus) or each frame's own (its camera)."""
    values = by_design(frames) if whole else np.random.default_rng(drawn).uniform(-1, 1, len(frames))
    split = make_split(frames, "variation", seed, "it", {"other": -values, "it": values})
    assert split.edge == values[split.test].min()
    assert max(values[split.train].max(), values[split.validation].max()) < split.edge
    most = 4 if whole else 1  # frames that share the value at the edge
    assert abs(len(split.test) - 0.2 * len(frames)) <= most
    learned, chosen = set(frames.design[split.train]), set(frames.design[split.validation])
    assert not learned & chosen
    assert abs(len(learned) - 0.75 * len(learned | chosen)) <= 1


def test_the_split_remembers_how_it_was_made() -> None:
    split = make_split(WHOLE, "family", seed=9, held_out="odd", families=FAMILIES)
    assert (split.protocol, split.seed, split.held_out) == ("family", 9, "odd")
    assert make_split(WHOLE, "design", seed=9).held_out is None


@pytest.mark.parametrize(
    ("count", "protocol", "held_out", "part"),
    [
        (40, "colour", None, "expected one of frame, design, family, variation, got 'colour'"),
        (40, "family", None, "split by family: name what is held out (plain, waved"),
        (40, "variation", None, "split by variation: name what is held out (rare)"),
        (40, "variation", "plant.gap", "expected one of rare, got 'plant.gap'"),
        (40, "variation", "even", "expected one of rare, got 'even'"),
        (40, "variation", "rare", "90% of the frames have rare at its largest value, 0"),
        (40, "family", "spline", "plain, waved, tapered, rare, odd, got 'spline'"),
        (40, "family", "waved", "0% of the frames have waved"),
        (80, "design", "waved", "split by design: holds nothing out, got 'waved'"),
        (4, "frame", None, "at least 5 frames, got 4"),
        (16, "design", None, "at least 5 designs to divide, got 4"),
        (0, "design", None, "at least 5 designs to divide, got 0"),
    ],
)
def test_what_cannot_be_split_is_said(count: int, protocol: str, held_out: str | None, part: str) -> None:
    few = take(WHOLE, np.arange(count))  # the first forty frames are plain
    varies = {"even": np.ones(count), "rare": np.where(np.arange(count) < 4, -1.0, 0.0)}
    with pytest.raises(InputError) as caught:
        make_split(few, protocol, 0, held_out, varies, FAMILIES)
    assert part in str(caught.value)


def test_nothing_varies() -> None:
    with pytest.raises(InputError, match=r"nothing to choose from, got 'plant\.young'"):
        make_split(WHOLE, "variation", 0, "plant.young")


def test_too_few_designs_beside_a_held_out_family() -> None:
    few = take(WHOLE, np.flatnonzero(np.isin(WHOLE.design, [0, 1, 2, 40])))
    with pytest.raises(InputError, match="at least 4 designs to divide, got 3"):
        make_split(few, "family", 0, held_out="waved", families=FAMILIES)
