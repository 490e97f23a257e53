"""What lies behind the bodies: patterns of many kinds, some kept for testing."""

from collections.abc import Callable
from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

SeenBackground = Literal["flat", "gradient", "smooth", "fractal", "stripes", "checks"]
HeldOutBackground = Literal["rings", "cells", "grid", "shapes"]
Background = Literal[SeenBackground, HeldOutBackground]
BACKGROUNDS: tuple[SeenBackground, ...] = get_args(SeenBackground)
"""Kinds of background to train with."""
HELD_OUT_BACKGROUNDS: tuple[HeldOutBackground, ...] = get_args(HeldOutBackground)
"""Kinds to keep for testing on what was never seen."""

Plane = Float32[np.ndarray, "height width"]


def background(
    kind: str, shape: tuple[int, int], level: float, contrast: float, size: float, angle: float, seed: int
) -> UInt8[np.ndarray, "height width"]:
    """A picture of a background alone: gray = 255 (level + contrast · pattern), clipped; pattern within ±1.

    shape      (height, width) [pixels]
    level      mean gray, 0…1
    contrast   half the range of grays, 0…1
    size       what repeats, or the largest feature, as a share of the picture's width
    angle      by which the pattern is turned [rad]
    seed       of what is random in it
    """
    if kind == "flat":
        return np.full(shape, round(255 * level), np.uint8)
    height, width = shape
    across = (np.arange(width, dtype=np.float32) + 0.5) / width - 0.5
    down = ((np.arange(height, dtype=np.float32) + 0.5) - height / 2) / width
    cos, sin = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    x = cos * across + sin * down[:, None]
    y = cos * down[:, None] - sin * across
    # A pattern in the plane of x and y, which are shares of the picture's width from its middle.
    pattern = _PATTERNS[kind](x, y, size, np.random.default_rng(seed))
    return np.clip(255 * level + 255 * contrast * pattern + 0.5, 0, 255).astype(np.uint8)


def _gradient(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    return x / np.float32(0.75)  # a corner lies at most 0.71 from the middle of a square picture


def _field(rng: np.random.Generator, nodes: int, shape: tuple[int, int]) -> Plane:
    """A smooth random field through random values at nodes × nodes places, mostly within ±1."""
    values = rng.uniform(-1.2, 1.2, (nodes, nodes)).astype(np.float32)
    return np.asarray(cv2.resize(values, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)


def _smooth(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    return _field(rng, 2 + round(1 / size), x.shape)


def _fractal(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    octaves = [np.float32(0.5**k) * _field(rng, round(2**k / size) + 2, x.shape) for k in range(4)]
    return np.asarray(sum(octaves), np.float32)


def _stripes(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    return np.sin(np.float32(2 * np.pi / size) * x + np.float32(2 * np.pi * rng.random()))


def _checks(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    u, v = x / np.float32(size) + np.float32(rng.random()), y / np.float32(size) + np.float32(rng.random())
    return np.sign(u % 1 - np.float32(0.5)) * np.sign(v % 1 - np.float32(0.5))


def _rings(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    u, v = x - np.float32(rng.uniform(-0.4, 0.4)), y - np.float32(rng.uniform(-0.4, 0.4))
    return np.sin(np.float32(2 * np.pi / size) * np.hypot(u, v))


def _cells(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    count = int(1 / size**2) + 2
    near, gray = np.full(x.shape, np.inf, np.float32), np.zeros(x.shape, np.float32)
    for u, v, shade in rng.uniform((-0.7, -0.7, -1), (0.7, 0.7, 1), (count, 3)).astype(np.float32):
        distance = (x - u) ** 2 + (y - v) ** 2
        gray = np.where(distance < near, shade, gray)
        near = np.minimum(near, distance)
    return gray


def _grid(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    u, v = x / np.float32(size) + np.float32(rng.random()), y / np.float32(size) + np.float32(rng.random())
    return np.where((u % 1 < 0.15) | (v % 1 < 0.15), np.float32(-1), np.float32(1))


def _shapes(x: Plane, y: Plane, size: float, rng: np.random.Generator) -> Plane:
    gray = np.zeros(x.shape, np.float32)
    places = rng.uniform((-0.6, -0.6, -1), (0.6, 0.6, 1), (12, 3)).astype(np.float32)
    sizes = size * rng.uniform(0.3, 1, (12, 2))
    for i, ((u, v, shade), (long, short)) in enumerate(zip(places, sizes.astype(np.float32), strict=True)):
        a, b = np.abs(x - u), np.abs(y - v)
        inside = (a < long) & (b < short) if i % 2 else a * a + b * b < long * short
        gray[inside] = shade
    return gray


_PATTERNS: dict[str, Callable[[Plane, Plane, float, np.random.Generator], Plane]] = {
    "gradient": _gradient,
    "smooth": _smooth,
    "fractal": _fractal,
    "stripes": _stripes,
    "checks": _checks,
    "rings": _rings,
    "cells": _cells,
    "grid": _grid,
    "shapes": _shapes,
}
