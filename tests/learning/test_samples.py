from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.learning.samples import (
    Samples,
    balanced,
    check_samples,
    epoch_batches,
    fingerprint,
    scale_of,
    stacks,
)


def test_good_frames_pass(blobs: Samples):
    check_samples(blobs)


def broken(forces: np.ndarray, value: float) -> np.ndarray:
    forces = forces.copy()
    forces[11, 3] = value
    return forces


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: {"images": f.images.astype(np.float32)}, "images: expected uint8"),
        (lambda f: {"images": f.images[0]}, "images: expected uint8"),
        (lambda f: {"images": f.images[:-1]}, r"forces: expected float32 \(79, 7\)"),
        (lambda f: {"forces": f.forces.astype(np.float64)}, "forces: expected float32"),
        (lambda f: {"forces": f.forces[:, :6]}, "forces: expected float32"),
        (lambda f: {"forces": broken(f.forces, np.nan)}, "frame 11"),
        (lambda f: {"forces": broken(f.forces, np.inf)}, "frame 11"),
        (lambda f: {"forces": broken(f.forces, -1e-3)}, "at least 0 N.*frame 11"),
        (lambda f: {"auxiliary": f.auxiliary[:-1]}, r"auxiliary: expected float32 \(80, n\)"),
        (lambda f: {"auxiliary": np.full_like(f.auxiliary, np.nan)}, "auxiliary: expected finite"),
        (lambda f: {"u": np.zeros(80)}, r"u: expected 80 finite float32 newtons"),
        (lambda f: {"u": np.zeros(79, np.float32)}, r"u: expected 80 finite.*\(79,\)"),
        (lambda f: {"u": np.full(80, np.inf, np.float32)}, "u: expected 80 finite"),
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
def test_frames_that_cannot_be_learned_from_are_refused(blobs: Samples, change, message: str):
    with pytest.raises(InputError, match=message):
        check_samples(replace(blobs, **change(blobs)))


def test_scale_is_the_standard_deviation_of_each_contact(blobs: Samples):
    scale = scale_of(blobs.forces)
    varying = [0, 1, 2, 3, 4, 6]
    assert scale[varying] == pytest.approx(blobs.forces[:, varying].astype(float).std(axis=0))


def test_a_contact_that_never_varies_gets_a_small_scale_not_a_vanishing_one(blobs: Samples):
    scale = scale_of(blobs.forces)
    assert scale[5] == pytest.approx(scale.max() / 100)


def test_forces_that_never_vary_at_all_get_one_newton():
    assert scale_of(np.full((5, 7), 0.5, np.float32)).tolist() == [1.0] * 7


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
    shown = np.bincount(balanced(index, forces, seed=1, epoch=1), minlength=1300)
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
    first, again, next_one = (set(balanced(index, forces, 0, epoch).tolist()) for epoch in (1, 1, 2))
    assert first == again
    assert first != next_one
    assert set(range(20)) <= first & next_one


def test_frames_that_all_load_the_same_come_once_each():
    forces = np.ones((50, 7), np.float32)
    assert sorted(balanced(np.arange(50), forces, 3, 4)) == list(range(50))


def test_fingerprint_notices_one_gray_value_one_digit_and_the_split(blobs: Samples):
    images, forces = blobs.images.copy(), blobs.forces.copy()
    images[3, 2, 1] ^= 1
    forces[0, 0] = np.nextafter(forces[0, 0], np.float32(9))
    others = [
        replace(blobs, images=images),
        replace(blobs, forces=forces),
        replace(blobs, train_index=blobs.train_index[::-1]),
        replace(blobs, train_index=blobs.train_index[:-1]),
        replace(blobs, auxiliary=blobs.auxiliary[:, :1]),
        replace(blobs, u=blobs.forces[:, 0]),
        replace(blobs, previous=np.arange(80)),
    ]
    prints = {
        fingerprint(samples) for samples in [blobs, replace(blobs, images=blobs.images.copy()), *others]
    }
    assert len(prints) == 1 + len(others)


def test_the_fingerprint_of_frames_without_u_and_past_is_what_it_always_was():
    """Runs that were begun before networks could see more must go on."""
    grays = np.arange(48, dtype=np.uint8).reshape(3, 4, 4)
    forces = np.arange(21, dtype=np.float32).reshape(3, 7)
    samples = Samples(grays, forces, np.arange(2), np.arange(2, 3), forces[:, :2].copy())
    assert fingerprint(samples) == "72d75a749b1fd6b8a30307d40b2deabc5cd857b816a3ba303b1d8e4e89d0aa0e"


def test_a_stack_holds_a_frame_and_those_before_it_newest_first():
    previous = np.array([0, 0, 1, 2, 4, 4])
    assert stacks(previous, 2, 6).tolist() == [
        *([0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 2, 1], [4, 4, 4], [5, 4, 4])
    ]
    assert stacks(None, 0, 3).tolist() == [[0], [1], [2]]
