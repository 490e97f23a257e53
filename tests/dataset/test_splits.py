"""Splits: disjoint, complete, reproducible, of the promised sizes, and never a shape on two sides."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.dataset.frames import Frames, take
from exosight.dataset.splits import PROTOCOLS, Split, make_split
from exosight.errors import InputError
from exosight.exosuit.scenarios import SCENARIOS, sample_shapes
from exosight.exosuit.shapes import FAMILIES

from .conftest import made_up

WHOLE = made_up(sample_shapes(10, seed=0), per_shape=4)  # the quick study's 110 shapes
SEEDS = st.integers(0, 2**32)
PARTS = ("train", "validation", "test")
unhurried = settings(max_examples=30, deadline=None)


def parts_of(split: Split) -> list[np.ndarray]:
    return [getattr(split, name) for name in PARTS]


def any_split(frames: Frames, protocol: str, seed: int) -> Split:
    held_out = {"family": "sine", "variation": "plant.young"}.get(protocol)
    return make_split(frames, protocol, seed, held_out, {"plant.young": by_shape(frames)})


def by_shape(frames: Frames) -> np.ndarray:
    """Something that varies from shape to shape, in no order."""
    return (frames.shape_id * 37 % 110) / 110.0


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
@given(thinned(), st.sampled_from(["shape", "family", "variation"]), SEEDS)
def test_no_shape_is_on_two_sides(frames: Frames, protocol: str, seed: int) -> None:
    shapes = [set(frames.shape_id[part]) for part in parts_of(any_split(frames, protocol, seed))]
    for one, other in itertools.combinations(shapes, 2):
        assert not one & other


def test_the_split_by_frame_does_put_shapes_on_two_sides() -> None:
    split = make_split(WHOLE, "frame", seed=0)
    assert set(WHOLE.shape_id[split.train]) & set(WHOLE.shape_id[split.test])


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
@given(st.lists(st.integers(0, 109), min_size=5, unique=True), SEEDS)
def test_sizes_by_shape(numbers: list[int], seed: int) -> None:
    frames = take(WHOLE, np.flatnonzero(np.isin(WHOLE.shape_id, numbers)))
    split = make_split(frames, "shape", seed)
    for part, share in zip(parts_of(split), (0.6, 0.2, 0.2), strict=True):
        assert abs(len(set(frames.shape_id[part])) - share * len(numbers)) <= 1  # whole shapes


def test_every_part_holds_every_scenario_evenly() -> None:
    split = make_split(WHOLE, "shape", seed=4)
    for scenario in range(len(SCENARIOS)):
        mine = WHOLE.scenario == scenario
        counts = [len(set(WHOLE.shape_id[part][mine[part]])) for part in parts_of(split)]
        assert counts == [6, 2, 2]


@pytest.mark.parametrize("held_out", list(FAMILIES))
def test_a_held_out_family_is_the_whole_test_part(held_out: str) -> None:
    split = make_split(WHOLE, "family", seed=1, held_out=held_out)
    family = list(FAMILIES).index(held_out)
    np.testing.assert_array_equal(split.test, np.flatnonzero(WHOLE.family == family))
    rest = [len(set(WHOLE.shape_id[part])) for part in (split.train, split.validation)]
    total = 80 if held_out == "linear" else 90  # linear has three scenarios of ten shapes, the others two
    assert abs(rest[0] - 0.75 * total) <= 1
    assert sum(rest) == total


@unhurried
@given(thinned(), SEEDS, st.integers(0, 2**32), st.booleans())
def test_the_largest_fifth_of_a_variation_is_the_whole_test_part(
    frames: Frames, seed: int, drawn: int, whole: bool
) -> None:
    """Whether it is the exosuit's (its modulus) or each frame's own (its camera)."""
    values = by_shape(frames) if whole else np.random.default_rng(drawn).uniform(-1, 1, len(frames))
    split = make_split(frames, "variation", seed, "it", {"other": -values, "it": values})
    assert split.edge == values[split.test].min()
    assert max(values[split.train].max(), values[split.validation].max()) < split.edge
    most = 4 if whole else 1  # frames that share the value at the edge
    assert abs(len(split.test) - 0.2 * len(frames)) <= most
    learned, chosen = set(frames.shape_id[split.train]), set(frames.shape_id[split.validation])
    assert not learned & chosen
    assert abs(len(learned) - 0.75 * len(learned | chosen)) <= 1


def test_the_split_remembers_how_it_was_made() -> None:
    split = make_split(WHOLE, "family", seed=9, held_out="legendre")
    assert (split.protocol, split.seed, split.held_out) == ("family", 9, "legendre")
    assert make_split(WHOLE, "shape", seed=9).held_out is None


@pytest.mark.parametrize(
    ("count", "protocol", "held_out", "part"),
    [
        (40, "colour", None, "expected one of frame, shape, family, variation, got 'colour'"),
        (40, "family", None, "split by family: name what is held out (linear, sine"),
        (40, "variation", None, "split by variation: name what is held out (rare)"),
        (40, "variation", "plant.gap", "expected what varies in the dataset (rare), got 'plant.gap'"),
        (40, "variation", "even", "expected what varies in the dataset (rare), got 'even'"),
        (40, "variation", "rare", "rare has its largest value, 0, in 90% of the frames"),
        (40, "family", "spline", "cosine_sum, sine_cosine, legendre, got 'spline'"),
        (40, "family", "sine", "no frames of 'sine'"),
        (40, "shape", "sine", "split by shape: holds nothing out, got 'sine'"),
        (4, "frame", None, "at least 5 frames, got 4"),
        (16, "shape", None, "at least 5 shapes to divide, got 4"),
        (0, "shape", None, "at least 5 shapes to divide, got 0"),
    ],
)
def test_what_cannot_be_split_is_said(count: int, protocol: str, held_out: str | None, part: str) -> None:
    few = take(WHOLE, np.arange(count))  # the first forty frames are linear
    varies = {"even": np.ones(count), "rare": np.where(np.arange(count) < 4, -1.0, 0.0)}
    with pytest.raises(InputError) as caught:
        make_split(few, protocol, 0, held_out, varies)
    assert part in str(caught.value)


def test_nothing_varies() -> None:
    with pytest.raises(InputError, match=r"in the dataset \(nothing does\), got 'plant\.young'"):
        make_split(WHOLE, "variation", 0, "plant.young")


def test_too_few_shapes_beside_a_held_out_family() -> None:
    few = take(WHOLE, np.flatnonzero(np.isin(WHOLE.shape_id, [0, 1, 2, 20])))
    with pytest.raises(InputError, match="at least 4 shapes to divide, got 3"):
        make_split(few, "family", 0, held_out="sine")
