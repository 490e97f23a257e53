"""Augmentation of training images, for invariance to position, contrast and noise.

The moves, grays and noise of a step follow from seed, epoch and step alone, so that a resumed run sees the
same images.
"""

import numpy as np
from jaxtyping import Float32, UInt8

NOISY = 0.2
"""Share of the images with noise; its standard deviation is drawn between the two below, evenly in its
logarithm [full scale]. The paper tests with 0.03, 0.1 and 0.32."""
NOISE = 0.01, 0.35
NOISE_MEAN = 0.01
"""What the noise adds on average, as MATLAB's imnoise by default [full scale]."""
FADED = 0.4
"""Share of the images whose grays are mapped linearly to a range that begins within the lowest 70 % and
takes a quarter to all of what is left above. The paper tests with two such ranges."""


def augment_batch(
    images: UInt8[np.ndarray, "batch stack height width"], seed: int, epoch: int, step: int, part: int = 0
) -> Float32[np.ndarray, "batch stack height width"]:
    """Training images as the network gets them, in [0, 1]; each part of a step has draws of its own.

    The images of a stack come from one camera: they are moved and faded alike, and as noisy, but each has
    noise of its own.
    """
    key = (step, part) if part else (step,)
    rng = np.random.default_rng(np.random.SeedSequence([seed, epoch], spawn_key=key))
    count = len(images)
    found = shifted(images, rng).astype(np.float32)
    found *= np.float32(1 / 255)
    low, share = rng.uniform(0, [[0.7], [1.0]], (2, count))
    high = low + (1 - low) * (0.25 + 0.75 * share)
    faded = rng.random(count) < FADED
    low, high = np.where(faded, low, 0.0), np.where(faded, high, 1.0)
    found *= (high - low).astype(np.float32)[:, None, None, None]
    found += low.astype(np.float32)[:, None, None, None]
    noisy = np.flatnonzero(rng.random(count) < NOISY)
    noise = rng.standard_normal((len(noisy), *images.shape[1:]), dtype=np.float32)
    weakest, strongest = np.log(NOISE)
    noise *= np.exp(rng.uniform(weakest, strongest, len(noisy))).astype(np.float32)[:, None, None, None]
    noise += np.float32(NOISE_MEAN)
    found[noisy] = np.clip(found[noisy] + noise, 0, 1)
    return found


def shifted(
    images: UInt8[np.ndarray, "batch stack height width"], rng: np.random.Generator
) -> UInt8[np.ndarray, "batch stack height width"]:
    """Each stack by its own whole pixels, up to 1/40 of its side; the border repeats into the gap."""
    *_, height, width = images.shape
    down, right = height // 40, width // 40
    padded = np.pad(images, ((0, 0), (0, 0), (down, down), (right, right)), mode="edge")
    moves = rng.integers(0, [2 * down + 1, 2 * right + 1], (len(images), 2))
    return np.stack(
        [stack[:, y : y + height, x : x + width] for stack, (y, x) in zip(padded, moves, strict=True)]
    )
