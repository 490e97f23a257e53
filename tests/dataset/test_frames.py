"""Frames in memory: picking, joining, and what makes them unfit."""

import dataclasses

import numpy as np
import pytest

from exosight.dataset.frames import QUANTITIES, Frames, concatenate, find_fault, previous, take


def same(a: Frames, b: Frames) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in QUANTITIES)


def test_every_array_is_described() -> None:
    assert [field.name for field in dataclasses.fields(Frames)] == list(QUANTITIES)


def test_joining_undoes_picking(frames: Frames) -> None:
    halves = [take(frames, np.arange(5)), take(frames, np.arange(5, len(frames)))]
    assert [len(half) for half in halves] == [5, len(frames) - 5]
    assert same(concatenate(halves), frames)
    assert not same(concatenate(halves[::-1]), frames)


def test_picking_keeps_the_order_asked_for(frames: Frames) -> None:
    picked = take(frames, np.array([7, 2, 2]))
    assert np.array_equal(picked.forces, frames.forces[[7, 2, 2]])
    assert np.array_equal(picked.images, frames.images[[7, 2, 2]])


def driven(frames: Frames, u: list[float], loading: list[int], shape_id: list[int]) -> Frames:
    few = take(frames, np.arange(len(u)))
    return dataclasses.replace(
        few,
        u=np.array(u, np.float32),
        loading=np.array(loading, np.int8),
        shape_id=np.array(shape_id, np.int32),
    )


def test_the_frame_before_is_that_of_the_same_path_and_at_rest_its_own(frames: Frames) -> None:
    # Shape 3 to 2 N and back; shape 4, whose frame at 0 N was dropped, as was one in between.
    one = driven(frames, [0, 1, 2, 2, 1, 0, 1, 3], [1, 1, 1, -1, -1, -1, 1, 1], [3] * 6 + [4] * 2)
    assert previous(one).tolist() == [0, 0, 1, 2, 3, 5, 6, 6]


def test_the_path_of_another_dataset_goes_on_none_of_the_first(frames: Frames) -> None:
    """Numbers of shapes are those of their own dataset: the same one says nothing."""
    falling = driven(frames, [0, 2, 2, 1], [1, 1, -1, -1], [7] * 4)
    again = driven(frames, [0.5, 1], [1, 1], [7] * 2)
    cut = driven(frames, [0, 1], [1, 1], [7] * 2)
    assert previous(concatenate([falling, again])).tolist() == [0, 0, 1, 2, 4, 4]
    assert previous(concatenate([cut, again])).tolist() == [0, 0, 2, 2]


def test_good_frames_have_no_fault(frames: Frames) -> None:
    assert find_fault(frames) is None
    assert find_fault(frames, load_limit=4.0) is None


def test_a_load_limit_that_float32_cannot_hold_is_still_met(frames: Frames) -> None:
    largest = dataclasses.replace(frames, u=np.full(len(frames), 0.1, np.float32))  # 0.1 rounds upwards
    assert float(largest.u[0]) > 0.1
    assert find_fault(largest, load_limit=0.1) is None


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("forces", np.nan, ["forces", "finite"]),
        ("forces", -0.1, ["forces", "-0.1", "N"]),
        ("u", np.inf, ["u", "finite"]),
        ("u", 4.1, ["u", "-4…4 N", "4.1"]),
        ("u", -4.1, ["u", "-4.1"]),
        ("pose", -np.inf, ["pose", "finite"]),
        ("shape_id", -1, ["shape_id", "-1"]),
        ("family", 5, ["family", "0…4", "5"]),
        ("scenario", 11, ["scenario", "0…10", "11"]),
        ("loading", 0, ["loading", "+1 or −1"]),
    ],
)
def test_a_single_bad_value_is_found(frames: Frames, name: str, value: float, words: list[str]) -> None:
    getattr(frames, name)[3] = value
    fault = find_fault(frames, load_limit=4.0)
    assert fault is not None
    for word in words:
        assert word in fault


def test_arrays_of_unequal_length_are_found(frames: Frames) -> None:
    # Filled in past the type check, as a program without it would.
    object.__setattr__(frames, "pose", frames.pose[:-1])
    assert find_fault(frames) == f"pose has {len(frames) - 1} frames, u has {len(frames)}"


def test_a_wrong_type_is_found(frames: Frames) -> None:
    object.__setattr__(frames, "forces", frames.forces.astype(np.float64))
    assert find_fault(frames) == "forces expects float32, got float64"
