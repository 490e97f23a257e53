"""Frames simulated anew for an epoch: learned from once, in place of as many of the stored ones."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int64, Integer, UInt8

from exosight.errors import InputError
from exosight.learning.training_data import FrameBlock, TrainingData, stacks


class ConcatenatedImages:
    """The images of a dataset, then those of a block, picked by number without a copy of them all."""

    def __init__(self, stored: np.ndarray, simulated: np.ndarray) -> None:
        self._stored, self._simulated = stored, simulated

    def __getitem__(self, chosen: Integer[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n height width"]:
        picked = np.empty((*chosen.shape, *self._stored.shape[1:]), np.uint8)
        old = chosen < len(self._stored)
        picked[old] = self._stored[chosen[old]]
        picked[~old] = self._simulated[chosen[~old] - len(self._stored)]
        return picked


class EpochData(NamedTuple):
    """What one epoch learns from, a row a frame."""

    images: UInt8[np.ndarray, "frames height width"] | ConcatenatedImages
    labels: Float32[np.ndarray, "frames outputs"]
    auxiliary: Float32[np.ndarray, "frames auxiliary"]
    rows: Integer[np.ndarray, " n"]
    """those to learn from"""
    stacks: Int64[np.ndarray, "frames stack"]
    """rows of the images that are inputs for each, its own first"""
    commands: Float32[np.ndarray, "frames channels"] | None
    """for a network that has them as an input [the channels' units]"""


def epoch_data(
    data: TrainingData, block: FrameBlock | None, history: int, seed: int, epoch: int
) -> EpochData:
    """The frames of one epoch: those of the block, and stored ones drawn at random up to the usual number.

    Epochs keep their length, and with it the schedule. A block of more frames than an epoch is cut.

    history   earlier images that are inputs of the network

    Raises InputError for a block of another image size or other labels.
    """
    size, stored = data.images.shape[1:], len(data.images)
    auxiliary = np.empty((stored, 0), np.float32) if data.auxiliary is None else data.auxiliary
    seen = stacks(data.previous, history, stored)
    if block is None:
        return EpochData(data.images, data.labels, auxiliary, data.train_index, seen, data.commands)
    if block.images.shape[1:] != size or block.labels.shape[1:] != data.labels.shape[1:]:
        raise InputError(
            f"simulated frames: expected images of {size} pixels and {data.labels.shape[1]} labels, got "
            f"{block.images.shape[1:]} and {block.labels.shape[1]}"
        )
    usual = len(data.train_index)
    simulated = np.arange(stored, stored + min(len(block.images), usual))
    draw = np.random.default_rng([seed, epoch, 1])
    kept = draw.choice(data.train_index, usual - len(simulated), replace=False)
    return EpochData(
        ConcatenatedImages(data.images, block.images),
        np.concatenate([data.labels, block.labels]),
        np.concatenate([auxiliary, block.auxiliary[:, : auxiliary.shape[1]]]),
        np.concatenate([kept, simulated]),
        np.concatenate([seen, stored + stacks(block.previous, history, len(block.images))]),
        None if data.commands is None else np.concatenate([data.commands, block.commands]),
    )
