"""The frames of a run: what is accepted, their scale, their order, their fingerprint."""

import hashlib
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float32, Float64, Int64, Integer

from exosight.errors import InputError

CONTACTS = ("C1", "C2", "C3", "C4", "C5", "C6", "C7")

# A contact that (nearly) never carries load has a standard deviation of (nearly) zero. Dividing by that would
# make its round-off the loudest part of the loss; taking 1 N instead would let the network answer a contact
# that is always zero with errors as large as the true forces elsewhere. One hundredth of the largest scale
# keeps both small, and lies well under the ratio of the paper's own contacts (0.17 N to 3.7 N).
_SMALLEST_SCALE = 0.01


@dataclass(frozen=True)
class Samples:
    """What a network learns from, and what chooses its best epoch."""

    images: np.ndarray
    """(frames, height, width) uint8 gray values"""
    forces: np.ndarray
    """(frames, 7) float32, C1…C7 [N]"""
    train_index: np.ndarray
    """(n,) frames to learn from"""
    validation_index: np.ndarray
    """(m,) frames to validate on"""
    auxiliary: np.ndarray
    """(frames, n) float32, what else a network may learn to tell, in any units; n may be 0"""
    u: np.ndarray | None = None
    """(frames,) float32, actuation [N], for a network that is told it"""
    previous: np.ndarray | None = None
    """(frames,) the frame before each, or its own number, for a network that sees earlier images"""


def check_samples(samples: Samples) -> None:
    """Refuse frames that cannot be learned from.

    Raises InputError for a wrong type, shape or length, a force that is negative or not finite, an empty
    part, an index outside the frames, and a frame in both parts.
    """
    images, forces = samples.images, samples.forces
    indices = {"train_index": (samples.train_index, 2), "validation_index": (samples.validation_index, 1)}
    if images.ndim != 3 or images.dtype != np.uint8:
        raise InputError(f"images: expected uint8 (frames, height, width), got {images.dtype} {images.shape}")
    expected = (len(images), len(CONTACTS))
    if forces.shape != expected or forces.dtype != np.float32:
        raise InputError(
            f"forces: expected float32 {expected}, one row of C1…C7 in newtons an image, "
            f"got {forces.dtype} {forces.shape}"
        )
    bad = np.flatnonzero(~np.isfinite(forces).all(axis=1) | (forces < 0).any(axis=1))
    if bad.size:
        raise InputError(
            f"forces: expected finite magnitudes of at least 0 N, got {forces[bad[0]].tolist()} in frame "
            f"{bad[0]} ({bad.size} such frames); drop frames that did not converge"
        )
    extra = samples.auxiliary
    if extra.ndim != 2 or len(extra) != len(images) or extra.dtype != np.float32:
        raise InputError(
            f"auxiliary: expected float32 ({len(images)}, n), one row an image, "
            f"got {extra.dtype} {extra.shape}"
        )
    if not np.isfinite(extra).all():
        raise InputError("auxiliary: expected finite numbers, got NaN or infinity among them")
    if samples.u is not None and not (
        samples.u.shape == (len(images),) and samples.u.dtype == np.float32 and np.isfinite(samples.u).all()
    ):
        raise InputError(
            f"u: expected {len(images)} finite float32 newtons, one an image, "
            f"got {samples.u.dtype} {samples.u.shape}"
        )
    if samples.previous is not None:
        if samples.previous.shape != (len(images),):
            raise InputError(
                f"previous: expected {len(images)} frame numbers, one an image, got {samples.previous.shape}"
            )
        indices["previous"] = (samples.previous, 1)
    for name, (index, least) in indices.items():
        if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer):
            raise InputError(f"{name}: expected a list of integers, got {index.dtype} {index.shape}")
        if len(index) < least:
            raise InputError(f"{name}: expected at least {least} frames, got {len(index)}; use more shapes")
        if index.min() < 0 or index.max() >= len(images):
            raise InputError(
                f"{name}: expected frame numbers from 0 to {len(images) - 1}, got {index.min()}…{index.max()}"
            )
    shared = np.intersect1d(samples.train_index, samples.validation_index).size
    if shared:
        raise InputError(f"train_index and validation_index share {shared} frames; split them apart")


def stacks(
    previous: Integer[np.ndarray, " frames"] | None, history: int, frames: int
) -> Int64[np.ndarray, "frames stack"]:
    """The images that a network sees of each frame, by number: its own, then those before it, newest first.

    previous   the frame before each; its own number where there is none, which is then seen again instead
    """
    rows = [np.arange(frames)]
    if previous is not None:
        for _ in range(history):
            rows.append(previous[rows[-1]])
    return np.stack(rows, axis=1)


def scale_of(values: Float32[np.ndarray, "frames n"]) -> Float64[np.ndarray, " n"]:
    """Standard deviation of each column, at least a hundredth of the largest; 1 if nothing varies."""
    deviation = values.std(axis=0, dtype=np.float64)
    if not deviation.any():
        return np.ones_like(deviation)
    return np.maximum(deviation, _SMALLEST_SCALE * deviation.max())


def epoch_batches(
    index: Integer[np.ndarray, " n"], batch: int, seed: int, epoch: int
) -> list[Int64[np.ndarray, " step"]]:
    """Every frame once, in an order that follows from seed and epoch alone, in steps of at most `batch`.

    The steps are equal to within one frame: a last step of a single image would upset batch normalisation.
    """
    order = np.random.default_rng([seed, epoch]).permutation(index.astype(np.int64))
    return np.array_split(order, -(-len(order) // batch))


def balanced(
    index: Integer[np.ndarray, " n"], forces: Float32[np.ndarray, "frames 7"], seed: int, epoch: int
) -> Int64[np.ndarray, " n"]:
    """As many frames, those that load a rarely loaded contact more often and the others less.

    A frame comes as often as one over the share of frames that load the rarest of its contacts, so that each
    contact has its turn; below a share of 1/50 no more often than that.
    """
    loaded = forces[index] > 0
    share = np.maximum(loaded.mean(axis=0), 1 / 50)
    weight = np.where(loaded, 1 / share, 1.0).max(axis=1)
    # Each frame the number of times that its weight comes to, rounded up or down by one draw for all.
    random = np.random.default_rng([seed, epoch, 2])
    order = random.permutation(len(index))
    ends = np.cumsum(weight[order]) * (len(index) / weight.sum())
    ends[-1] = len(index)
    return index[order[np.searchsorted(ends, np.arange(len(index)) + random.random(), side="right")]]


def fingerprint(samples: Samples) -> str:
    """SHA-256 over types, shapes and contents: tells a resumed run whether the data are the same."""
    digest = hashlib.sha256()
    for array in (getattr(samples, field.name) for field in fields(samples)):
        if array is None:
            continue
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()
