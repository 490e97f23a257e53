"""What a network learns from: what is accepted, its scale, its order, its fingerprint."""

import hashlib
import json
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, Integer, UInt8

from exosight.errors import InputError
from exosight.learning.outputs import nonnegative
from exosight.system.schema import Schema, schema_to_dict

# A contact that (nearly) never carries load has a standard deviation of (nearly) zero. Dividing by that would
# make its round-off the loudest part of the loss; taking 1 N instead would let the network answer a contact
# that is always zero with errors as large as the true forces elsewhere. One hundredth of the largest scale
# keeps both small, and lies well under the ratio of the paper's own contacts (0.17 N to 3.7 N).
_SMALLEST_SCALE = 0.01


class FrameBlock(NamedTuple):
    """Frames that are learned from in one epoch only."""

    images: UInt8[np.ndarray, "frames height width"]
    labels: Float32[np.ndarray, "frames outputs"]
    """estimated sensors [their units]"""
    auxiliary: Float32[np.ndarray, "frames auxiliary"]
    commands: Float32[np.ndarray, "frames channels"]
    """[the channels' units]"""
    previous: Integer[np.ndarray, " frames"]
    """the frame before each, by its place in the block"""


FrameBlocks = Callable[[int], Generator[FrameBlock, None, None]]
"""From the number of an epoch, counted from 0, its block and those of the epochs after it."""


@dataclass(frozen=True)
class TrainingData:
    """What a network learns from, and what chooses its best epoch."""

    schema: Schema
    """names and units of what is estimated, and size of the images: those of its first camera"""
    images: np.ndarray
    """(frames, height, width) uint8 gray values"""
    labels: np.ndarray
    """(frames, outputs) float32, the estimated sensors [their units]"""
    train_index: np.ndarray
    """(n,) frames to learn from"""
    validation_index: np.ndarray
    """(m,) frames to validate on"""
    identity: Mapping[str, str | int | float]
    """what the frames are (camera, seed, versions …): kept with the network for its whole life"""
    auxiliary: np.ndarray | None = None
    """(frames, n) float32, what a light network learns beside, see `learning.outputs`; None: nothing"""
    auxiliary_units: tuple[str, ...] = ()
    """of its columns; columns of one unit are scaled alike"""
    commands: np.ndarray | None = None
    """(frames, channels) float32 [their units], for a network that has them as an input"""
    previous: np.ndarray | None = None
    """(frames,) the frame before each, or its own number, for a network with earlier images as an input"""
    online_blocks: FrameBlocks | None = field(default=None, compare=False)
    """frames simulated anew for each epoch, in place of as many of the others"""


def check_training_data(data: TrainingData) -> None:
    """Refuse frames that cannot be learned from.

    Raises InputError for a wrong type, shape or length, a label that is not finite or a negative force, an
    empty part, an index outside the frames, and a frame in both parts.
    """
    images, (height, width) = data.images, data.schema.image_size
    if images.ndim != 3 or images.dtype != np.uint8 or images.shape[1:] != (height, width):
        raise InputError(
            f"images: expected uint8 (frames, {height}, {width}), got {images.dtype} {images.shape}"
        )
    count = len(images)
    _check_labels(data, count)
    _check_rows("auxiliary", data.auxiliary, (count, len(data.auxiliary_units)))
    _check_rows("commands", data.commands, (count, len(data.schema.channels)))
    indices = {"train_index": (data.train_index, 2), "validation_index": (data.validation_index, 1)}
    if data.previous is not None:
        if data.previous.shape != (count,):
            raise InputError(
                f"previous: expected {count} frame numbers, one an image, got {data.previous.shape}"
            )
        indices["previous"] = (data.previous, 1)
    for name, (index, least) in indices.items():
        if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer):
            raise InputError(f"{name}: expected a list of integers, got {index.dtype} {index.shape}")
        if len(index) < least:
            raise InputError(f"{name}: expected at least {least} frames, got {len(index)}; use more designs")
        if index.min() < 0 or index.max() >= count:
            raise InputError(
                f"{name}: expected frame numbers from 0 to {count - 1}, got {index.min()}…{index.max()}"
            )
    shared = np.intersect1d(data.train_index, data.validation_index).size
    if shared:
        raise InputError(f"train_index and validation_index share {shared} frames; split them apart")


def _check_labels(data: TrainingData, count: int) -> None:
    labels, names = data.labels, data.schema.outputs
    if not names:
        raise InputError(
            f"system {data.schema.system}: expected at least one sensor to estimate, got none; "
            "add estimated = true to a sensor"
        )
    if labels.shape != (count, len(names)) or labels.dtype != np.float32:
        raise InputError(
            f"labels: expected float32 {(count, len(names))}, one row of {', '.join(names)} an image, "
            f"got {labels.dtype} {labels.shape}"
        )
    wrong = ~np.isfinite(labels) | ((labels < 0) & nonnegative(data.schema))
    if wrong.any():
        frame, output = np.argwhere(wrong)[0]
        raise InputError(
            f"labels: expected finite numbers, and forces of at least 0, got {labels[frame, output]:g} for "
            f"{names[output]} in frame {frame} ({wrong.any(axis=1).sum()} such frames); drop frames that did "
            "not converge"
        )


def _check_rows(name: str, values: np.ndarray | None, shape: tuple[int, int]) -> None:
    if values is not None and not (
        values.shape == shape and values.dtype == np.float32 and np.isfinite(values).all()
    ):
        raise InputError(
            f"{name}: expected finite float32 {shape}, one row an image, got {values.dtype} {values.shape}"
        )


def stacks(
    previous: Integer[np.ndarray, " frames"] | None, history: int, frames: int
) -> Int64[np.ndarray, "frames stack"]:
    """The images that are inputs for each frame, by number: its own, then those before it, newest first.

    previous   the frame before each; its own number where there is none, which then stands in its place
    """
    rows = [np.arange(frames)]
    if previous is not None:
        for _ in range(history):
            rows.append(previous[rows[-1]])
    return np.stack(rows, axis=1)


def scale_of(values: Float32[np.ndarray, "frames n"], units: Sequence[str]) -> Float64[np.ndarray, " n"]:
    """Standard deviation of each column, at least 1/100 of the largest of its unit; 1 if none varies."""
    deviation = values.std(axis=0, dtype=np.float64)
    for unit in set(units):
        alike = np.array([other == unit for other in units])
        largest = deviation[alike].max()
        deviation[alike] = np.maximum(deviation[alike], _SMALLEST_SCALE * largest) if largest else 1.0
    return deviation


def offset_of(values: Float32[np.ndarray, "frames outputs"], schema: Schema) -> tuple[float, ...]:
    """Mean of each output that is a measurement and 0 for the others; empty if none is.

    What is simulated begins at 0; an instrument may read 101 kPa ± 1 kPa, a hundred scales from there, which
    is too far for the steps of an optimiser.
    """
    measured = [sensor.quantity == "measurement" for sensor in schema.estimated]
    means = np.where(measured, values.mean(axis=0, dtype=np.float64), 0.0)
    return tuple(means.tolist()) if any(measured) else ()


def epoch_batches(
    index: Integer[np.ndarray, " n"], batch: int, seed: int, epoch: int
) -> list[Int64[np.ndarray, " step"]]:
    """Every frame once, in an order that follows from seed and epoch alone, in steps of at most `batch`.

    The steps are equal to within one frame: a last step of a single image would upset batch normalisation.
    """
    order = np.random.default_rng([seed, epoch]).permutation(index.astype(np.int64))
    return np.array_split(order, -(-len(order) // batch))


def balanced(
    index: Integer[np.ndarray, " n"],
    loaded: Bool[np.ndarray, "frames forces"],
    seed: int,
    epoch: int,
) -> Int64[np.ndarray, " n"]:
    """As many frames, those that load a rarely loaded contact more often and the others less.

    A frame comes as often as one over the share of frames that load the rarest of its contacts, so that each
    contact has its turn; below a share of 1/50 no more often than that.

    loaded   whether each force is above 0
    """
    loaded = loaded[index]
    share = np.maximum(loaded.mean(axis=0), 1 / 50)
    weight = np.where(loaded, 1 / share, 1.0).max(axis=1, initial=1.0)
    # Each frame the number of times that its weight comes to, rounded up or down by one draw for all.
    random = np.random.default_rng([seed, epoch, 2])
    order = random.permutation(len(index))
    ends = np.cumsum(weight[order]) * (len(index) / weight.sum())
    ends[-1] = len(index)
    return index[order[np.searchsorted(ends, np.arange(len(index)) + random.random(), side="right")]]


def fingerprint(data: TrainingData) -> str:
    """SHA-256 over schema, types, shapes and contents: shows a resumed run whether the data are the same."""
    digest = hashlib.sha256(json.dumps(schema_to_dict(data.schema), sort_keys=True).encode())
    for array in (
        *(data.images, data.labels, data.train_index, data.validation_index),
        *(data.auxiliary, data.commands, data.previous),
    ):
        if array is None:
            continue
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()
