from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from schemas import mixed_schema, published_schema

from exosight.errors import InputError
from exosight.learning.training_data import (
    TrainingData,
    balanced,
    check_training_data,
    epoch_batches,
    fingerprint,
    scale_of,
    stacks,
)


def test_good_frames_pass(blobs: TrainingData):
    check_training_data(blobs)


def broken(labels: np.ndarray, value: float) -> np.ndarray:
    labels = labels.copy()
    labels[11, 3] = value
    return labels


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: {"images": f.images.astype(np.float32)}, "images: expected uint8"),
        (lambda f: {"images": f.images[0]}, "images: expected uint8"),
        (lambda f: {"images": f.images[:, :-1]}, r"images: expected uint8 \(frames, 40, 40\)"),
        (lambda f: {"images": f.images[:-1]}, r"labels: expected float32 \(79, 7\), one row of C1, C2"),
        (lambda f: {"labels": f.labels.astype(np.float64)}, "labels: expected float32"),
        (lambda f: {"labels": f.labels[:, :6]}, "labels: expected float32"),
        (lambda f: {"labels": broken(f.labels, np.nan)}, "got nan for C4 in frame 11"),
        (lambda f: {"labels": broken(f.labels, np.inf)}, "got inf for C4 in frame 11"),
        (
            lambda f: {"labels": broken(f.labels, -1e-3)},
            "forces of at least 0, got -0.001 for C4 in frame 11",
        ),
        (lambda f: {"auxiliary": f.auxiliary[:-1]}, r"auxiliary: expected finite float32 \(80, 2\)"),
        (lambda f: {"auxiliary": np.full_like(f.auxiliary, np.nan)}, "auxiliary: expected finite"),
        (lambda f: {"commands": np.zeros((80, 1))}, r"commands: expected finite float32 \(80, 1\)"),
        (lambda f: {"commands": np.zeros(80, np.float32)}, r"commands: expected finite.*\(80,\)"),
        (lambda f: {"commands": np.full((80, 1), np.inf, np.float32)}, "commands: expected finite"),
        (lambda f: {"previous": np.arange(79)}, r"previous: expected 80 frame numbers.*\(79,\)"),
        (lambda f: {"previous": np.arange(1, 81)}, "previous: expected frame numbers from 0 to 79"),
        (lambda f: {"previous": np.arange(80.0)}, "previous: expected a list of integers"),
        (lambda f: {"train_index": f.train_index[:0]}, "train_index: expected at least 2"),
        (lambda f: {"train_index": f.train_index[:1]}, "train_index: expected at least 2"),
        (lambda f: {"validation_index": f.validation_index[:0]}, "validation_index: expected at least 1"),
        (lambda f: {"train_index": f.train_index.astype(float)}, "train_index: expected a list of integers"),
        (
            lambda f: {"validation_index": np.array([80])},
            "validation_index: expected frame numbers from 0 to 79",
        ),
        (lambda f: {"validation_index": np.array([-1])}, "validation_index: expected frame numbers"),
        (lambda f: {"validation_index": np.array([70, 3])}, "share 1 frames"),
    ],
)
def test_frames_that_cannot_be_learned_from_are_refused(blobs: TrainingData, change, message: str):
    with pytest.raises(InputError, match=message):
        check_training_data(replace(blobs, **change(blobs)))


def test_scale_is_the_standard_deviation_of_each_contact(blobs: TrainingData):
    scale = scale_of(blobs.labels, ["N"] * 7)
    varying = [0, 1, 2, 3, 4, 6]
    assert scale[varying] == pytest.approx(blobs.labels[:, varying].astype(float).std(axis=0))


def test_a_contact_that_never_varies_gets_a_small_scale_not_a_vanishing_one(blobs: TrainingData):
    scale = scale_of(blobs.labels, ["N"] * 7)
    assert scale[5] == pytest.approx(scale.max() / 100)


def test_units_have_smallest_scales_of_their_own():
    """In millinewtons, what hardly varies in radians would be drowned; the bound is within a unit."""
    values = np.zeros((4, 4), np.float32)
    values[:, 0], values[:, 2] = [0, 1000, 0, 1000], [0, 0.2, 0, 0.2]
    scale = scale_of(values, ["mN", "mN", "rad", "rad"])
    assert scale == pytest.approx([500, 5, 0.1, 0.001])


def test_an_angle_may_be_negative(blobs: TrainingData):
    schema = mixed_schema(40, 40)
    labels = blobs.labels[:, :4].copy()
    labels[:, 1] -= 1.0
    check_training_data(replace(blobs, schema=schema, labels=labels))
    with pytest.raises(InputError, match="for zone_1 in frame 0"):
        check_training_data(replace(blobs, schema=schema, labels=labels[:, [0, 2, 1, 3]]))


def test_a_system_without_anything_to_estimate_is_refused(blobs: TrainingData):
    sensors = tuple(replace(sensor, estimated=False) for sensor in blobs.schema.sensors)
    with pytest.raises(InputError, match=r"at least one sensor to estimate.*add estimated = true"):
        check_training_data(replace(blobs, schema=replace(blobs.schema, sensors=sensors)))


def test_forces_that_never_vary_at_all_get_one_newton():
    assert scale_of(np.full((5, 7), 0.5, np.float32), ["N"] * 7).tolist() == [1.0] * 7


@given(
    count=st.integers(2, 300),
    batch=st.integers(4, 128),
    seed=st.integers(0, 2**63 - 1),
    epoch=st.integers(1, 10**6),
)
def test_an_epoch_shows_every_frame_once_in_steps_that_batch_normalisation_can_take(
    count: int, batch: int, seed: int, epoch: int
):
    index = np.arange(1000, 1000 + count)
    batches = epoch_batches(index, batch, seed, epoch)
    assert sorted(np.concatenate(batches)) == index.tolist()
    sizes = [len(part) for part in batches]
    assert 2 <= min(sizes) <= max(sizes) <= batch
    assert max(sizes) - min(sizes) <= 1


def test_order_follows_from_seed_and_epoch_alone():
    index = np.arange(50)
    pairs = [(1, 1), (1, 2), (2, 1), (1, 1)]
    order = [np.concatenate(epoch_batches(index, 8, seed, epoch)).tolist() for seed, epoch in pairs]
    assert order[0] == order[3]
    assert order[0] != order[1]
    assert order[0] != order[2]
    assert order[1] != order[2]


def test_frames_of_a_rare_contact_come_as_often_as_their_rarity_asks():
    """Of 1000 frames 900 load nothing, 80 C1 (weight 10) and 20 C1 and C7 (weight 50): 900 : 800 : 1000."""
    forces = np.zeros((1300, 7), np.float32)
    index = np.arange(300, 1300)
    forces[300:400, 0] = 0.1
    forces[300:320, 6] = 0.1
    shown = np.bincount(balanced(index, forces > 0, seed=1, epoch=1), minlength=1300)
    assert shown.sum() == len(index)
    assert shown[:300].sum() == 0
    for part, weight in ((slice(300, 320), 50), (slice(320, 400), 10), (slice(400, 1300), 1)):
        expected = 1000 * weight / (20 * 50 + 80 * 10 + 900)
        assert set(shown[part]) <= {int(expected), int(expected) + 1}
        # Rounded up or down by one draw for all: the sum of a part is off by no more than its ends.
        assert shown[part].mean() == pytest.approx(expected, abs=0.15)


def test_epochs_show_other_frames_of_a_common_kind():
    forces = np.zeros((1000, 7), np.float32)
    forces[:20, 6] = 0.1
    index = np.arange(1000)
    first, again, next_one = (set(balanced(index, forces > 0, 0, epoch).tolist()) for epoch in (1, 1, 2))
    assert first == again
    assert first != next_one
    assert set(range(20)) <= first & next_one


def test_frames_that_all_load_the_same_come_once_each():
    forces = np.ones((50, 7), np.float32)
    assert sorted(balanced(np.arange(50), forces > 0, 3, 4)) == list(range(50))


def test_fingerprint_notices_one_gray_value_one_digit_and_the_split(blobs: TrainingData):
    images, labels = blobs.images.copy(), blobs.labels.copy()
    images[3, 2, 1] ^= 1
    labels[0, 0] = np.nextafter(labels[0, 0], np.float32(9))
    others = [
        replace(blobs, images=images),
        replace(blobs, labels=labels),
        replace(blobs, train_index=blobs.train_index[::-1]),
        replace(blobs, train_index=blobs.train_index[:-1]),
        replace(blobs, auxiliary=blobs.auxiliary[:, :1]),
        replace(blobs, commands=blobs.labels[:, :1]),
        replace(blobs, schema=published_schema(40, 44)),
        replace(blobs, previous=np.arange(80)),
    ]
    prints = {
        fingerprint(samples) for samples in [blobs, replace(blobs, images=blobs.images.copy()), *others]
    }
    assert len(prints) == 1 + len(others)


def test_a_stack_holds_a_frame_and_those_before_it_newest_first():
    previous = np.array([0, 0, 1, 2, 4, 4])
    assert stacks(previous, 2, 6).tolist() == [
        *([0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 2, 1], [4, 4, 4], [5, 4, 4])
    ]
    assert stacks(None, 0, 3).tolist() == [[0], [1], [2]]
