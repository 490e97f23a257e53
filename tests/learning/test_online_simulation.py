"""Epochs with fresh frames among them."""

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from schemas import published_schema

from exosight.errors import InputError
from exosight.learning import FrameBlock, TrainConfig, TrainingData, train
from exosight.learning.checkpoint import load_checkpoint
from exosight.learning.online_simulation import epoch_data


def block(samples: TrainingData, count: int, gray: int = 0) -> FrameBlock:
    images = np.full((count, *samples.images.shape[1:]), gray, np.uint8)
    halves = np.full((count, 7), 0.5, np.float32)
    return FrameBlock(
        images, halves, halves[:, :2], 10 + np.arange(count, dtype=np.float32)[:, None], before(count)
    )


def numbered(train_index: np.ndarray, validation_index: np.ndarray) -> TrainingData:
    """80 frames of 2×2 pixels whose grays are their numbers."""
    labels = np.zeros((80, 7), np.float32)
    images = np.arange(80, dtype=np.uint8)[:, None, None] * np.ones((1, 2, 2), np.uint8)
    return TrainingData(
        *(published_schema(2, 2), images, labels, train_index, validation_index, {}),
        auxiliary=labels[:, :2],
        auxiliary_units=("N", "N"),
    )


def before(count: int) -> np.ndarray:
    """The frame before each, in paths of four."""
    places = np.arange(count)
    return np.where(places % 4 == 0, places, places - 1)


@given(st.integers(0, 100), st.integers(0, 2**31), st.integers(1, 1000))
def test_an_epoch_keeps_its_length_and_shows_every_frame_once(count: int, seed: int, epoch: int) -> None:
    samples = numbered(np.arange(10, 74), np.arange(74, 80))
    epoch_frames = epoch_data(samples, block(samples, count, gray=255), 0, seed, epoch)
    assert len(set(epoch_frames.rows)) == 64
    grays = epoch_frames.images[epoch_frames.rows][:, 0, 0]
    assert np.sum(grays == 255) == min(count, 64)  # all of the block that fits
    old = epoch_frames.rows[grays != 255]
    np.testing.assert_array_equal(grays[grays != 255], old)  # a number still names its own image
    assert set(old) <= set(range(10, 74))
    np.testing.assert_array_equal(epoch_frames.labels[epoch_frames.rows[grays == 255]], 0.5)


def test_a_block_of_another_size_is_refused(blobs: TrainingData) -> None:
    wrong = block(blobs, 3)._replace(images=np.zeros((3, 8, 8), np.uint8))
    with pytest.raises(InputError, match="expected images of"):
        epoch_data(blobs, wrong, 0, 0, 1)


def test_a_fresh_frame_is_seen_with_those_before_it_in_its_block() -> None:
    samples = replace(
        numbered(np.arange(64), np.arange(64, 80)),
        commands=np.arange(80, dtype=np.float32)[:, None],
        previous=before(80),
    )
    more = block(samples, 6)._replace(images=100 + samples.images[:6])
    found = epoch_data(samples, more, 2, 0, 1)
    assert found.commands is not None
    for row in found.rows:
        number, own = (row - 80, 100) if row >= 80 else (row, 0)
        start = number - number % 4
        grays = found.images[found.stacks[row]][:, 0, 0].astype(int) - own
        assert grays.tolist() == [max(number - i, start) for i in range(3)]
        assert found.commands[row, 0] == (10 + number if own else number)
    assert np.count_nonzero(found.rows >= 80) == 6


def test_a_stopped_run_resumes_with_the_block_of_its_epoch(
    tmp_path: Path, blobs: TrainingData, small: TrainConfig
) -> None:
    asked: list[int] = []

    def blocks(first: int) -> Generator[FrameBlock, None, None]:
        asked.append(first)
        for epoch in range(first, 100):
            yield block(blobs, 16, gray=epoch)

    def stop(at: object) -> None:
        if getattr(at, "step", 0) == 10:  # within the third epoch of four steps
            raise KeyboardInterrupt

    data = replace(blobs, online_blocks=blocks)
    train(small, data, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(small, data, tmp_path / "stopped", progress=stop)
    train(small, data, tmp_path / "stopped", resume=True)
    assert asked == [0, 0, 2]
    whole, stopped = (load_checkpoint(tmp_path / name).tensors for name in ("whole", "stopped"))
    assert all(torch.equal(tensor, stopped[name]) for name, tensor in whole.items())
