"""Frames in memory: picking, joining, and what makes them unfit."""

import dataclasses

import numpy as np
import pytest

from exosight.dataset.frames import (
    QUANTITIES,
    Frames,
    concatenate,
    direction,
    find_fault,
    previous,
    take,
)
from exosight.errors import InputError
from exosight.system.schema import Schema

from .conftest import DESIGNS, FAMILIES, SCENARIOS, SCHEMA, made_up

KINDS = (len(FAMILIES), len(SCENARIOS))


def same(a: Frames, b: Frames) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in QUANTITIES)


def test_joining_undoes_picking(frames: Frames) -> None:
    halves = [take(frames, np.arange(5)), take(frames, np.arange(5, len(frames)))]
    assert [len(half) for half in halves] == [5, len(frames) - 5]
    assert same(concatenate(halves), frames)
    assert not same(concatenate(halves[::-1]), frames)


def test_picking_keeps_the_order_asked_for(frames: Frames) -> None:
    picked = take(frames, np.array([7, 2, 2]))
    for name in QUANTITIES:
        np.testing.assert_array_equal(getattr(picked, name), getattr(frames, name)[[7, 2, 2]])


def test_labels_are_the_estimated_sensors_by_name(frames: Frames) -> None:
    np.testing.assert_array_equal(
        frames.labels, np.stack([frames.reading(name) for name in ("P1", "P2", "P3")], axis=1)
    )
    np.testing.assert_array_equal(frames.reading("knuckle"), frames.sensors[:, 4])
    with pytest.raises(InputError, match="expected one of P1, P2, P3, F_net, knuckle, got 'C1'"):
        frames.reading("C1")


def changed(**change) -> Schema:
    return dataclasses.replace(SCHEMA, **change)


@pytest.mark.parametrize(
    ("schema", "words"),
    [
        (changed(sensors=SCHEMA.sensors[:3]), "sensors P1, P2, P3, F_net, knuckle, got P1, P2, P3"),
        (changed(channels=SCHEMA.channels[:1]), "channels push, pull, got push"),
        (
            changed(channels=(dataclasses.replace(SCHEMA.channels[0], unit="kN"), SCHEMA.channels[1])),
            "channel push: expected unit N, got kN",
        ),
        (
            changed(cameras=(dataclasses.replace(SCHEMA.cameras[0], width=8),)),
            "camera side: expected width 6, got 8",
        ),
    ],
)
def test_frames_of_different_systems_are_not_joined(frames: Frames, schema: Schema, words: str) -> None:
    with pytest.raises(InputError, match=f"expected one kind of system; .*{words}"):
        concatenate([frames, made_up(DESIGNS, schema=schema)])


def test_frames_of_other_coordinates_are_not_joined(frames: Frames) -> None:
    with pytest.raises(InputError, match="expected 25 coordinates, got 24"):
        concatenate([frames, dataclasses.replace(frames, pose=frames.pose[:, 1:])])


def driven(frames: Frames, push: list[float], step: list[int], design: list[int]) -> Frames:
    few = take(frames, np.arange(len(push)))
    commands = np.column_stack([push, np.zeros(len(push))]).astype(np.float32)
    return dataclasses.replace(
        few, commands=commands, step=np.array(step, np.int32), design=np.array(design, np.int32)
    )


def test_the_frame_before_is_that_of_the_same_path_and_at_rest_its_own(frames: Frames) -> None:
    # Design 3 to 2 N and back; design 4, whose frame at rest was dropped, as was one in between.
    one = driven(frames, [0, 1, 2, 2, 1, 0, 1, 3], [0, 1, 2, 3, 4, 5, 1, 3], [3] * 6 + [4] * 2)
    assert previous(one).tolist() == [0, 0, 1, 2, 3, 5, 6, 6]
    assert direction(one).tolist() == [1, 1, 1, -1, -1, -1, 1, 1]


def test_a_frame_at_rest_is_one_without_any_command(frames: Frames) -> None:
    one = driven(frames, [0, 0, 0], [0, 1, 2], [3] * 3)
    one.commands[1, 1] = 5.0
    assert previous(one).tolist() == [0, 0, 2]
    assert direction(one, 1).tolist() == [1, 1, -1]


def test_the_path_of_another_dataset_goes_on_none_of_the_first(frames: Frames) -> None:
    """Numbers of designs are those of their own dataset: the same one says nothing."""
    first = driven(frames, [0, 2, 2, 1], [0, 2, 3, 4], [7] * 4)
    again = driven(frames, [0.5, 1], [1, 2], [7] * 2)
    assert previous(concatenate([first, again])).tolist() == [0, 0, 1, 2, 4, 4]


def test_good_frames_have_no_fault(frames: Frames) -> None:
    assert find_fault(frames, *KINDS) is None


def test_a_limit_that_float32_cannot_hold_is_still_met() -> None:
    tight = changed(channels=(dataclasses.replace(SCHEMA.channels[0], high=0.1), SCHEMA.channels[1]))
    largest = made_up(DESIGNS, schema=tight)
    largest.commands[:, 0] = 0.1  # rounds upwards
    assert float(largest.commands[0, 0]) > 0.1
    assert find_fault(largest, *KINDS) is None


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("sensors", np.nan, ["sensors", "finite"]),
        ("sensors", -0.1, ["sensors", "P1", "at least 0", "-0.1"]),
        ("commands", np.inf, ["commands", "finite"]),
        ("commands", 4.1, ["push", "-1…4 N", "4.1"]),
        ("commands", -1.1, ["push", "-1.1"]),
        ("pose", -np.inf, ["pose", "finite"]),
        ("design", -1, ["design", "at least 0", "-1"]),
        ("family", 5, ["family", "0…4", "5"]),
        ("scenario", 6, ["scenario", "0…5", "6"]),
        ("step", -1, ["step", "at least 0"]),
    ],
)
def test_a_single_bad_value_is_found(frames: Frames, name: str, value: float, words: list[str]) -> None:
    getattr(frames, name)[(3, 0) if getattr(frames, name).ndim == 2 else 3] = value
    fault = find_fault(frames, *KINDS)
    assert fault is not None
    for word in words:
        assert word in fault


@pytest.mark.parametrize(
    ("name", "change", "fault"),
    [
        # Filled in past the type check, as a program without it would.
        ("pose", lambda values: values[:-1], "pose has 32 frames, step has 33"),
        ("sensors", lambda values: values.astype(float), "sensors expects float32, got float64"),
        ("sensors", lambda values: values[:, 1:], "sensors expects (5,) a frame, got (4,)"),
        ("images", lambda values: values[:, :, 1:], "images expects (4, 6) a frame, got (4, 5)"),
    ],
)
def test_arrays_that_do_not_fit_are_found(frames: Frames, name: str, change, fault: str) -> None:
    object.__setattr__(frames, name, change(getattr(frames, name)))
    assert find_fault(frames, *KINDS) == fault
