"""Several cameras on one plant: a network for each, and their estimates as one.

Pictures of one moment are stacked below each other, so that loop, guard, recording and replay work on them as
on those of one camera; a view that is black gave no picture. With the values fᵢ of the views and σᵢ, half the
width of their intervals as that of a normal error,

    f = Σ fᵢ/σᵢ² / Σ 1/σᵢ²,

and the ends of the interval likewise: where all intervals hold, so does theirs, whatever errors the views
share (the pose that a view does not show, the model), which intervals as for independent errors would not.

A view whose picture is out of distribution is left out as long as another one's is not. Views that are used
must agree: the OOD score is the largest of theirs, or of the disagreement of any two, see `agreement`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, UInt8

from exosight.control.agreement import LIMIT, MODEL_ERROR
from exosight.control.estimator import OnnxEstimator, Reading
from exosight.control.sources import Frame, FrameStream, Source
from exosight.errors import InputError
from exosight.system.schema import Schema, network_difference

Size = tuple[int, int]
"""Height and width of a picture [pixels]."""

_NO_WIDTH = 1e-9  # of an interval, so that weights are finite


@dataclass(frozen=True)
class Views:
    """Networks for the same sensors, each for the pictures of its camera.

    Raises InputError for fewer than two, or networks for other sensors than the first.
    """

    networks: tuple[OnnxEstimator, ...]

    def __post_init__(self) -> None:
        if len(self.networks) < 2:
            raise InputError(f"views: expected two networks or more, got {len(self.networks)}")
        first = self.networks[0].card.schema
        for number, network in enumerate(self.networks[1:], 2):
            own = replace(network.card.schema, cameras=first.cameras)
            if fault := network_difference(first, own):
                raise InputError(f"model {number}: it is for other sensors than the first one: {fault}")

    @property
    def sizes(self) -> tuple[Size, ...]:
        """Of the pictures of every view."""
        return tuple(network.card.schema.image_size for network in self.networks)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras that the networks learned from."""
        return tuple(network.card.schema.cameras[0].name for network in self.networks)

    def check_fits(self, schema: Schema, what: str) -> None:
        """Raise InputError if a network does not fit the camera of a system that has its camera's name."""
        for name, network in zip(self.cameras, self.networks, strict=True):
            own = [camera for camera in schema.cameras if camera.name == name]
            network.card.check_fits(replace(schema, cameras=tuple(own) or schema.cameras), what)

    def read(self, images: UInt8[np.ndarray, "frames height width"], level: float = 0.9) -> Reading:
        """Values, intervals, contact and OOD score of the views together.

        images   stacked views, of `stacked_size`; InputError for another size
        level    of the intervals
        """
        if images.ndim != 3 or images.shape[1:] != stacked_size(self.sizes):
            height, width = stacked_size(self.sizes)
            raise InputError(f"images: these views need (frames, {height}, {width}), got {images.shape}")
        views = list(split(images, self.sizes))
        shown = np.array([view.any(axis=(1, 2)) for view in views])
        return fused(
            [network.read(view, level) for network, view in zip(self.networks, views, strict=True)],
            shown,
            level,
        )


def open_network(paths: Sequence[Path], *, alone: bool = False) -> OnnxEstimator | Views:
    """The network of a camera, or those of several.

    alone   whether it will get pictures alone; several always do

    Raises what `OnnxEstimator.load` and `Views` raise.
    """
    if len(paths) == 1:
        return OnnxEstimator.load(paths[0], alone=alone, history=False)
    return Views(tuple(OnnxEstimator.load(path, alone=True) for path in paths))


def check_fits(network: OnnxEstimator | Views, schema: Schema, what: str) -> None:
    """Raise InputError if a network does not fit a system, see `ModelCard.check_fits`."""
    (network if isinstance(network, Views) else network.card).check_fits(schema, what)


def cameras_of(network: OnnxEstimator | Views) -> tuple[OnnxEstimator, ...]:
    """The network of every camera."""
    return network.networks if isinstance(network, Views) else (network,)


def fused(readings: Sequence[Reading], shown: Bool[np.ndarray, "views frames"], level: float) -> Reading:
    """What several views say together.

    shown   whether a view has a picture
    level   of the intervals
    """
    values, low, high, contact = (
        np.array([getattr(reading, name) for reading in readings], float)
        for name in ("forces", "low", "high", "contact")
    )  # (views, frames, outputs)
    scores = np.array([reading.ood_score for reading in readings], float)
    shown = shown | ~shown.any(axis=0)
    trusted = shown & (scores <= 1)
    used = np.where(trusted.any(axis=0), trusted, shown)
    # An interval that ends at 0 is narrower there.
    half = np.maximum(np.maximum(high - values, values - low), _NO_WIDTH)
    sigma = half / NormalDist().inv_cdf((1 + level) / 2)
    weight = used[..., None] / sigma**2
    weight /= weight.sum(axis=0)
    score = np.max(np.where(used, scores, 0), axis=0)
    for a, b in combinations(range(len(readings)), 2):
        floor = MODEL_ERROR * np.abs(values[[a, b]]).max(axis=(0, 2))
        spread = np.sqrt(sigma[a] ** 2 + sigma[b] ** 2 + floor[:, None] ** 2)
        apart = (np.abs(values[a] - values[b]) / spread).max(axis=1) / LIMIT
        score = np.where(used[a] & used[b], np.maximum(score, apart), score)
    means = [(weight * each).sum(axis=0).astype(np.float32) for each in (values, low, high)]
    touching = (used[..., None] * contact).sum(axis=0) / used.sum(axis=0)[:, None]
    return Reading(means[0], means[1], means[2], touching.astype(np.float32), np.asarray(score, np.float32))


def stacked_size(sizes: Sequence[Size]) -> Size:
    """Of pictures below each other."""
    return sum(height for height, _ in sizes), max(width for _, width in sizes)


def stacked(images: Sequence[UInt8[np.ndarray, "_ _"]]) -> UInt8[np.ndarray, "height width"]:
    """Views below each other, black beside narrower ones."""
    width = max(image.shape[1] for image in images)
    return np.concatenate([np.pad(image, ((0, 0), (0, width - image.shape[1]))) for image in images])


def split(
    images: UInt8[np.ndarray, "frames height width"], sizes: Sequence[Size]
) -> Iterator[UInt8[np.ndarray, "frames rows columns"]]:
    """The views of stacked pictures."""
    top = 0
    for height, width in sizes:
        yield images[:, top : top + height, :width]
        top += height


def joined(sources: Sequence[Source], sizes: Sequence[Size], frozen: int = 0) -> FrameStream:
    """Frames of several sources as one, until one of them ends; as old as the oldest picture in it.

    sizes    of each one's pictures
    frozen   same pictures in a row, bit by bit, from which a view counts as none; 0: it never does
    """
    last: list[np.ndarray | None] = [None] * len(sources)
    repeated = [0] * len(sources)
    while True:
        images, times = [], []
        for k, (source, size) in enumerate(zip(sources, sizes, strict=True)):
            try:
                frame = next(source)
            except StopIteration:
                return
            images.append(np.zeros(size, np.uint8))
            if frame is None:
                continue
            before, last[k] = last[k], frame.image
            repeated[k] = repeated[k] + 1 if before is not None and np.array_equal(frame.image, before) else 0
            if not frozen or repeated[k] < frozen:
                images[-1] = frame.image
                times.append(frame.time)
        yield Frame(stacked(images), min(times)) if times else None
