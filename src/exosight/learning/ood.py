"""OOD scores: whether an image is like those that a network learned from, by a linear reconstruction.

A linear map reconstructs the image, at a quarter of its size, from the network's last features. For an image
unlike the training data the reconstruction is wrong. The score is its mean squared error, each
place in units of what is usual there and less what the image's noise explains: well below 1 for images like
those learned from, and more without limit for others.
"""

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor, nn

from exosight.learning.networks import SensorModel, Standardise
from exosight.vision.corruptions import add_noise

SHARE, NOISE = 0.99, 0.01
"""Share of images like those learned from, with noise of this variance [full scale²], the paper's medium,
whose score is under the limit."""

FEW = 512
"""Unseen frames below which the map is made of those learned from: four a feature."""

RIDGES = 1e-3, 1e-2, 1e-1, 1.0, 10.0
"""Ridges to choose from when a map is changed, in units of the features' mean variance times the pictures."""

_FAINT = 0.05
"""Least error that counts as usual [standard deviations of a picture]: much of it never changes at all."""
_RIDGE = 1e-3
_BATCH = 256


class OodDetector(nn.Module):
    """The map, and its usual error; `limit` is the score beyond which an image is out of distribution."""

    weight: Tensor
    bias: Tensor
    usual: Tensor
    diagonal: Tensor

    def __init__(self, weight: Tensor, bias: Tensor, usual: Tensor, limit: float):
        super().__init__()
        for name, tensor in (("weight", weight), ("bias", bias), ("usual", usual)):
            self.register_buffer(name, tensor)
        self.register_buffer("diagonal", torch.tensor([[[[0.5, -0.5], [-0.5, 0.5]]]]))
        self.limit = limit

    def forward(
        self, image: Float[Tensor, "batch images height width"], features: Float[Tensor, "batch features"]
    ) -> Float[Tensor, " batch"]:
        """The score of each image; those before it had theirs when they were new."""
        error = self.residual(image, features)
        # The diagonal details of 2×2 pixels: white noise has its full variance there, a picture next to none.
        # Averaged over 4×4 pixels, a sixteenth of it is left.
        details = nn.functional.conv2d(_newest(image), self.diagonal, stride=2)
        noise = (details**2).mean((1, 2, 3)) / 16
        return ((error**2 - noise[:, None]) / self.usual**2).mean(1)

    def residual(
        self, image: Float[Tensor, "batch images height width"], features: Float[Tensor, "batch features"]
    ) -> Float[Tensor, "batch places"]:
        """What the reconstruction leaves of each image at a quarter of its size, in one row."""
        return _shrunk(_newest(image)) - features @ self.weight - self.bias


Inputs = tuple[UInt8[np.ndarray, "_ stack height width"], Float32[np.ndarray, "_ channels"] | None]
"""Images, each with those before it, as many as are inputs of the network; commands if they are an input [the
channels' units]."""


def fit_ood_detector(model: SensorModel, unseen: Inputs, learned: Inputs | None = None) -> OodDetector:
    """From frames that the network has not learned from: the map on every other, its error on the rest.

    With few such frames, `learned` are those that it has learned from, for the map, and the error is that of
    all others. With 104 frames, half of them for a map of 128 features, 44 % of the test images were flagged;
    with the map from 372 that were learned from, 12 %, and the images of other things all the same.
    """
    images, commands = unseen
    map_part, rest = slice(None, None, 2), slice(1 if len(images) > 1 else 0, None, 2)
    if learned is not None:
        map_part = rest = slice(None)
    features, pictures = (part[map_part] for part in _seen(model, *(learned or unseen)))
    weight, bias = _ridge(features, pictures, _RIDGE)
    kept, loads = images[rest], None if commands is None else commands[rest]
    features, pictures = _seen(model, kept, loads)
    usual = ((pictures - features @ weight - bias) ** 2).mean(0).sqrt() + _FAINT
    found = OodDetector(weight.float(), bias.float(), usual.float(), limit=1.0)
    found.limit = _limit(_noisy_scores(model, found, (kept, loads)))
    return found


def refit_ood_detector(model: SensorModel, former: OodDetector, seen: Inputs) -> OodDetector:
    """The detector of a network that was adapted: the former map, changed as far as new pictures ask for it.

    The change is a ridge regression of what the former map leaves of the pictures. Its ridge, the usual error
    and the limit come from halves of the pictures, each with the map that was changed by the other half.

    seen   pictures of the new kind, four at least
    """
    images, commands = seen
    features, pictures = _seen(model, *seen)
    left = pictures - features @ former.weight.double() - former.bias.double()
    halves = [np.arange(len(images)) % 2 == half for half in (0, 1)]
    parts = [torch.from_numpy(np.flatnonzero(half)) for half in halves]

    def errors(ridge: float) -> list[Tensor]:
        found = []
        for own, other in (parts, parts[::-1]):
            change, shift = _ridge(features[other], left[other], ridge)
            found.append(left[own] - features[own] @ change - shift)
        return found

    ridge = min(RIDGES, key=lambda ridge: sum(float((part**2).sum()) for part in errors(ridge)))
    squares = torch.cat(errors(ridge)) ** 2
    usual = squares.mean(0).sqrt().float() + _FAINT

    def changed(rows: Tensor) -> OodDetector:
        change, shift = _ridge(features[rows], left[rows], ridge)
        return OodDetector(former.weight + change.float(), former.bias + shift.float(), usual, limit=1.0)

    scores = [
        _noisy_scores(model, changed(other), (images[half], None if commands is None else commands[half]))
        for half, other in zip(halves, parts[::-1], strict=True)
    ]
    found = changed(torch.arange(len(images)))
    found.limit = _limit(np.concatenate(scores))
    return found


def _ridge(
    features: Float[Tensor, "frames features"], target: Float[Tensor, "frames places"], ridge: float
) -> tuple[Float[Tensor, "features places"], Float[Tensor, " places"]]:
    """The linear map from features to a target, and what it adds."""
    mean, centre = features.mean(0), target.mean(0)
    centred = features - mean
    gram = centred.T @ centred
    gram += ridge * (gram.trace() / len(gram) + 1e-12) * torch.eye(len(gram), dtype=gram.dtype)
    weight = torch.linalg.solve(gram, centred.T @ (target - centre))
    return weight, centre - mean @ weight


def _noisy_scores(model: SensorModel, detector: OodDetector, seen: Inputs) -> Float32[np.ndarray, " frames"]:
    """Scores of pictures with noise."""
    images, commands = seen
    flat = images.reshape(-1, *images.shape[2:])
    noisy = add_noise(flat, NOISE, np.random.default_rng(0)).reshape(images.shape)
    scores = []
    with torch.inference_mode():
        for part, load in batches(noisy, commands):
            scores.append(detector(part, model.network.features(part, load)))
    return torch.cat(scores).numpy()


def _limit(scores: Float32[np.ndarray, " frames"]) -> float:
    """The score below which SHARE of them are.

    Of a handful of frames it may be below zero; the score of nothing but noise is.
    """
    return max(1.0, float(np.quantile(scores, SHARE)))


def batches(
    images: UInt8[np.ndarray, "frames stack height width"],
    commands: Float32[np.ndarray, "frames channels"] | None,
) -> Iterator[tuple[Float[Tensor, "batch stack height width"], Float[Tensor, "batch channels"] | None]]:
    """Images and commands as a network takes them, some at a time."""
    for start in range(0, len(images), _BATCH):
        part = slice(start, start + _BATCH)
        given = None if commands is None else torch.from_numpy(commands[part])
        yield torch.from_numpy(images[part]).float() / 255, given


def _newest(image: Float[Tensor, "batch images height width"]) -> Float[Tensor, "batch 1 height width"]:
    return Standardise()(image if image.shape[1] == 1 else image[:, :1])


def _shrunk(picture: Float[Tensor, "batch 1 height width"]) -> Float[Tensor, "batch places"]:
    """A picture at a quarter of its size, in one row."""
    return nn.functional.avg_pool2d(picture, 4).flatten(1)


def _seen(
    model: SensorModel,
    images: UInt8[np.ndarray, "frames stack height width"],
    commands: Float32[np.ndarray, "frames channels"] | None,
) -> tuple[Float[Tensor, "frames features"], Float[Tensor, "frames places"]]:
    """Features and small pictures, in double precision."""
    features, pictures = [], []
    with torch.inference_mode():
        for part, load in batches(images, commands):
            features.append(model.network.features(part, load).double())
            pictures.append(_shrunk(_newest(part)).double())
    return torch.cat(features), torch.cat(pictures)
