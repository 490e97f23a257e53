"""What a photograph has behind a device, as linear light: walls, desks, things that lie about, cables."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from exosight.vision.background import BACKGROUNDS, background

Plane = Float32[np.ndarray, "height width"]
Rng = np.random.Generator
MOST_THINGS = 14
"""Largest number of things on a cluttered desk."""


def backdrop(rng: Rng, shape: tuple[int, int]) -> Plane:
    """A plain wall, a textured desk, or a cluttered one, each as often: reflectance 0…1."""
    kind = rng.integers(3)
    level = np.float32(rng.uniform(0.04, 0.95))
    if kind == 0:
        slope = texture(rng, shape, ("flat", "gradient", "smooth"), 0.15)
        return np.clip(level * (1 + slope), 0, 1)
    surface = np.clip(level * (1 + desk(rng, shape)), 0, 1)
    if kind == 2:
        for _ in range(rng.integers(2, MOST_THINGS + 1)):
            _put_thing(rng, surface)
    return surface


def texture(rng: Rng, shape: tuple[int, int], kinds: tuple[str, ...], contrast: float) -> Plane:
    """A pattern within ± contrast, which is the largest one; coarse or fine, in any direction."""
    kind = kinds[rng.integers(len(kinds))]
    size, angle = np.exp(rng.uniform(np.log(0.03), np.log(0.6))), rng.uniform(0, 2 * np.pi)
    gray = background(kind, shape, 0.5, 0.5, float(size), float(angle), int(rng.integers(2**31)))
    return (gray.astype(np.float32) / np.float32(127.5) - 1) * np.float32(contrast * rng.random())


def desk(rng: Rng, shape: tuple[int, int]) -> Plane:
    """Relative differences of a surface: wood, fabric, stone, or a printed pattern."""
    height, width = shape
    if rng.random() < 0.5:
        return texture(rng, shape, BACKGROUNDS, 0.7) + texture(rng, shape, ("fractal",), 0.3)
    # Random values that go on along one direction longer than across it: grain; as long: stone.
    side = int(1.5 * max(height, width))
    across, along = np.exp(rng.uniform(np.log([1.0, 1.5]), np.log([6.0, 60.0])))
    values = rng.standard_normal((2 + int(side / across), 2 + int(side / along)), np.float32)
    turn = cv2.getRotationMatrix2D((side / 2, side / 2), rng.uniform(0, 360), 1.0)
    turn[:, 2] -= side / 2 - np.array([width, height]) / 2
    grain = cv2.warpAffine(
        cv2.resize(values, (side, side)), turn, (width, height), borderMode=cv2.BORDER_REFLECT
    )
    return np.asarray(grain, np.float32) * np.float32(rng.uniform(0.04, 0.35))


def polygon_mask(points: np.ndarray, shape: tuple[int, int]) -> UInt8[np.ndarray, "height width"]:
    """How much of each pixel a convex polygon of (column, row) covers, 0…255."""
    mask = np.zeros(shape, np.uint8)
    corners = np.clip(16 * (points - 0.5), -(2**20), 2**20)
    cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 255, cv2.LINE_AA, shift=4)
    return mask


def cable_mask(
    rng: Rng, shape: tuple[int, int], width: float
) -> tuple[UInt8[np.ndarray, "height width"], Plane]:
    """A bent cable through the picture: how much it covers, 0…255, and how light falls on it, 0…1.

    width   of the cable [pixels]
    """
    height, columns = shape
    ends = rng.uniform(-0.2, 1.2, (4, 2)) * [columns, height]
    side = rng.integers(4)  # it enters from outside
    ends[0, side // 2] = (-0.1 if side % 2 else 1.1) * (columns, height)[side // 2]
    t = np.linspace(0, 1, 40)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    line = np.rint(16 * (weights @ ends)).astype(np.int32)
    mask, core = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    cv2.polylines(mask, [line], False, 255, max(1, round(width)), cv2.LINE_AA, shift=4)
    cv2.polylines(core, [line - 8], False, 255, max(1, round(width / 3)), cv2.LINE_AA, shift=4)
    return mask, np.float32(0.6) + np.float32(0.4 / 255) * core


def cover_with(scene: Plane, mask: np.ndarray, above: np.ndarray | float) -> None:
    """Put a layer over a scene, in place; mask 0…255."""
    scene += mask.astype(np.float32) * np.float32(1 / 255) * (above - scene)


def moved(mask: np.ndarray, right: float, down: float, blur: float) -> np.ndarray:
    """A mask moved by some pixels and blurred: where the light is away."""
    height, width = mask.shape
    shifted = cv2.warpAffine(
        mask,
        np.array([[1.0, 0.0, right], [0.0, 1.0, down]]),
        (width, height),
        borderMode=cv2.BORDER_REPLICATE,
    )
    # A triangle of half width a has the standard deviation a/√6.
    size = 2 * round(np.sqrt(6) * blur) + 1
    return np.asarray(cv2.stackBlur(shifted, (size, size)) if size > 1 else shifted)


def _put_thing(rng: Rng, surface: Plane) -> None:
    """A sheet, a box, a disc or a cable on a desk, with its shadow."""
    shape, width = surface.shape, surface.shape[1]
    if rng.random() < 0.25:
        mask, light = cable_mask(rng, shape, rng.uniform(0.01, 0.04) * width)
    else:
        at, angle = rng.uniform(-0.1, 1.1, 2) * width, rng.uniform(0, 2 * np.pi)
        reach = np.exp(rng.uniform(np.log(0.03), np.log(0.4), 2)) * width
        corners = [4, 4, 24, 3, 6][rng.integers(5)]
        turns = 2 * np.pi * np.arange(corners) / corners
        own = np.stack([np.cos(turns), np.sin(turns)], axis=-1) * reach
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        mask = polygon_mask(own @ turn + at, shape)
        light = 1 + texture(rng, shape, BACKGROUNDS, 0.5)
    (right, down), blur = (rng.uniform(-0.03, 0.03, 2) * width).tolist(), rng.uniform(0.3, 3.0)
    surface *= 1 - np.float32(rng.uniform(0, 0.7) / 255) * moved(mask, right, down, blur)
    cover_with(surface, mask, np.clip(np.float32(rng.uniform(0.03, 0.95)) * light, 0, 1))
