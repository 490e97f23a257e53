"""The published robustness tests: Gaussian noise and lowered contrast on finished pictures.

Both follow the MATLAB functions that the paper names: gray is taken to [0, 1], changed, clipped, and
rounded back to 0…255.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count, repeat

import numpy as np
from jaxtyping import UInt8

from exosight.errors import InputError
from exosight.validation import check_name

NOISE_MEAN = 0.01  # of full scale, as printed in the paper


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of this variance [full scale²]."""

    variance: float


@dataclass(frozen=True)
class Contrast:
    """Black becomes `low` and white becomes `high` [full scale]."""

    low: float
    high: float


CORRUPTIONS: dict[str, Noise | Contrast] = {
    "noise-low": Noise(0.001),
    "noise-medium": Noise(0.01),
    "noise-high": Noise(0.1),
    "contrast-low": Contrast(26 / 255, 200 / 255),
    "contrast-high": Contrast(174 / 255, 240 / 255),
}
"""The paper's cases. Its names grade the damage: contrast-high leaves the narrower range of grays."""


def corrupt(
    images: UInt8[np.ndarray, "frames height width"], name: str, seed: int, first: int = 0
) -> UInt8[np.ndarray, "frames height width"]:
    """One of the paper's CORRUPTIONS, by name.

    The noise on a frame depends on its size, the seed and its number alone, so a set that is corrupted in
    batches, each with the number of its `first` frame, comes out as it does in one call. It repeats
    exactly on any machine with the same release of NumPy.

    images   (frames, height, width)  gray 0…255
    returns  (frames, height, width)  gray 0…255
    Raises InputError for an unknown name, a negative seed or first, or images of another kind.
    """
    _check_images(images)
    check_name("corruption", name, CORRUPTIONS)
    if seed < 0 or first < 0:
        raise InputError(
            f"seed and first: expected 0 or more, got {seed} and {first}; use other whole numbers"
        )
    match CORRUPTIONS[name]:
        case Noise(variance):
            return _noisy(images, variance, (np.random.default_rng([seed, i]) for i in count(first)))
        case Contrast(low, high):
            return set_contrast(images, low, high)


def add_noise(
    images: UInt8[np.ndarray, "frames height width"], variance: float, rng: np.random.Generator
) -> UInt8[np.ndarray, "frames height width"]:
    """Gaussian noise, MATLAB imnoise(I, "gaussian", 0.01, variance): clip(I + N(0.01, variance)) on [0, 1].

    Frames draw from `rng` in order.

    images    (frames, height, width)  gray 0…255
    variance  of full scale, at least 0
    returns   (frames, height, width)  gray 0…255
    Raises InputError for a negative variance or images of another kind.
    """
    _check_images(images)
    if not 0 <= variance < np.inf:
        raise InputError(
            f"noise variance: expected a finite number of at least 0, got {variance}; "
            f"the paper uses 0.001 to 0.1"
        )
    return _noisy(images, variance, repeat(rng))


def set_contrast(
    images: UInt8[np.ndarray, "frames height width"], low: float, high: float
) -> UInt8[np.ndarray, "frames height width"]:
    """Lowered contrast, MATLAB imadjust(I, [0 1], [low high]): low + (high − low) I on [0, 1].

    images     (frames, height, width)  gray 0…255
    low, high  what black and white become, 0 ≤ low < high ≤ 1
    returns    (frames, height, width)  gray 0…255
    Raises InputError for another range or images of another kind.
    """
    _check_images(images)
    if not 0 <= low < high <= 1:
        raise InputError(
            f"contrast range: expected 0 ≤ low < high ≤ 1, got {low} and {high}; "
            f"give grays as shares of white"
        )
    return _as_gray(np.linspace(255 * low, 255 * high, 256))[images]


def _noisy(images: np.ndarray, variance: float, generators: Iterable[np.random.Generator]) -> np.ndarray:
    noisy = np.empty_like(images)
    # Frame by frame: the noise of a whole data set at once would need four times its memory.
    for image, result, rng in zip(images, noisy, generators, strict=False):
        noise = rng.standard_normal(image.shape, dtype=np.float32)
        noise *= np.float32(255 * np.sqrt(variance))
        noise += np.float32(255 * NOISE_MEAN)
        noise += image
        result[:] = _as_gray(noise)
    return noisy


def _as_gray(values: np.ndarray) -> np.ndarray:
    return (np.clip(values, 0, 255) + 0.5).astype(np.uint8)


def _check_images(images: np.ndarray) -> None:
    if images.dtype != np.uint8 or images.ndim != 3:
        raise InputError(
            f"images: expected (frames, height, width) of type uint8, got {images.shape} of "
            f"type {images.dtype}; add a frame axis for a single image"
        )
