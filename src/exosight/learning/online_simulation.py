"""Fresh frames in an epoch: learned from once, in place of as many of the stored ones."""

from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int64, Integer, UInt8

from exosight.errors import InputError
from exosight.learning.samples import CONTACTS, Samples, stacks


class FrameBlock(NamedTuple):
    """Frames that no epoch has seen before."""

    images: UInt8[np.ndarray, "frames height width"]
    forces: Float32[np.ndarray, "frames 7"]
    """C1…C7 [N]"""
    auxiliary: Float32[np.ndarray, "frames auxiliary"]
    u: Float32[np.ndarray, " frames"]
    """actuation [N]"""
    previous: Integer[np.ndarray, " frames"]
    """the frame before each, by its place in the block"""


FrameBlocks = Callable[[int], Generator[FrameBlock, None, None]]
"""From the number of an epoch, counted from 0, its block and those of the epochs after it."""


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
    forces: Float32[np.ndarray, "frames 7"]
    auxiliary: Float32[np.ndarray, "frames auxiliary"]
    rows: Integer[np.ndarray, " n"]
    """those to learn from"""
    stacks: Int64[np.ndarray, "frames stack"]
    """rows of the images that are seen of each, its own first"""
    u: Float32[np.ndarray, " frames"] | None
    """actuation [N], for a network that is told it"""


def epoch_data(samples: Samples, block: FrameBlock | None, history: int, seed: int, epoch: int) -> EpochData:
    """The frames of one epoch: those of the block, and stored ones drawn at random up to the usual number.

    Epochs keep their length, and with it the schedule. A block of more frames than an epoch is cut.

    history   earlier images that the network sees

    Raises InputError for a block of another image size.
    """
    size, stored = samples.images.shape[1:], len(samples.images)
    seen = stacks(samples.previous, history, stored)
    if block is None:
        return EpochData(
            samples.images, samples.forces, samples.auxiliary, samples.train_index, seen, samples.u
        )
    if block.images.shape[1:] != size or block.forces.shape[1:] != (len(CONTACTS),):
        raise InputError(f"simulated frames: expected images of {size} pixels, got {block.images.shape[1:]}")
    usual = len(samples.train_index)
    simulated = np.arange(stored, stored + min(len(block.images), usual))
    draw = np.random.default_rng([seed, epoch, 1])
    kept = draw.choice(samples.train_index, usual - len(simulated), replace=False)
    return EpochData(
        ConcatenatedImages(samples.images, block.images),
        np.concatenate([samples.forces, block.forces]),
        np.concatenate([samples.auxiliary, block.auxiliary[:, : samples.auxiliary.shape[1]]]),
        np.concatenate([kept, simulated]),
        np.concatenate([seen, stored + stacks(block.previous, history, len(block.images))]),
        None if samples.u is None else np.concatenate([samples.u, block.u]),
    )
