"""What hides a part of the bodies: objects in front of them, and other fingers."""

from collections.abc import Callable
from typing import Literal, get_args

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from exosight.system.camera import Camera, resized
from exosight.vision.renderer import BACKGROUND, Tube, draw

SeenOcclusion = Literal["ellipse", "polygon", "bar"]
HeldOutOcclusion = Literal["blob", "edge", "mesh"]
Occlusion = Literal[SeenOcclusion, HeldOutOcclusion]
OCCLUSIONS: tuple[SeenOcclusion, ...] = get_args(SeenOcclusion)
"""Kinds of object in front of the bodies to train with."""
HELD_OUT_OCCLUSIONS: tuple[HeldOutOcclusion, ...] = get_args(HeldOutOcclusion)
"""Kinds to keep for testing on what was never seen."""

LINK_LENGTHS = (0.045, 0.025, 0.024)
"""Lengths of the links of another finger before it is scaled [m]: about those of an index finger."""
LINK_RADII = (0.0105, 0.0075, 0.006, 0.0045)
"""Its radii at the joints and at the tip [m]."""

Picture = UInt8[np.ndarray, "height width"]
Plane = Float32[np.ndarray, "height width"]


def occluder(
    kind: str, picture: Picture, share: float, at: float, angle: float, seed: int
) -> UInt8[np.ndarray, "height width"]:
    """How much of each pixel an object covers, 0…255.

    Whatever its kind, it covers the stated share of the picture: of all pixels those that are nearest to it,
    as its kind measures distance. It is centred on a pixel of the bodies, if they are seen at all.

    picture  a picture without background, which tells where the bodies are
    share    of the picture that is covered, 0…1
    at       which of the bodies' pixels it is centred on, 0 (the first, at the top) … 1 (the last)
    angle    by which the object is turned [rad]
    seed     of what is random in it
    """
    height, width = picture.shape
    bodies = np.flatnonzero(picture != BACKGROUND)
    row, column = (height // 2, width // 2)
    if len(bodies):
        row, column = divmod(int(bodies[min(int(at * len(bodies)), len(bodies) - 1)]), width)
    cos, sin = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    across = (np.arange(width, dtype=np.float32) - column) / width
    down = (np.arange(height, dtype=np.float32)[:, None] - row) / width
    distance = _DISTANCES[kind](
        cos * across + sin * down, cos * down - sin * across, np.random.default_rng(seed)
    )
    covered = min(round(share * picture.size), picture.size)
    mask = np.zeros(picture.size, np.uint8)
    mask[np.argpartition(distance, covered - 1, axis=None)[:covered]] = 255
    return cv2.blur(mask.reshape(picture.shape), (3, 3))  # a soft edge; a mean leaves the share as it is


def overlay(picture: Picture, mask: Picture, shade: float) -> Picture:
    """The picture behind a flat object of this gray, 0…1."""
    weight = mask.astype(np.float32) / 255
    return (picture + weight * (255 * np.float32(shade) - picture) + 0.5).astype(np.uint8)


def draw_fingers(picture: Picture, count: int, seed: int) -> None:
    """Draw other fingers over a picture, in place: the same hand's, each bent in its own way.

    They are as large in the picture as fingers are in a field of view of 14 cm, whatever its size in pixels.
    """
    height, width = picture.shape
    camera = resized(Camera(), width, height)
    rng = np.random.default_rng(seed)
    for _ in range(count):
        size, shade = rng.uniform((0.85, 0.45), (1.15, 0.8))
        heading = np.cumsum(rng.uniform((-0.3, 0.0, 0.0), (0.9, 1.2, 1.0)))
        steps = (
            size * np.array(LINK_LENGTHS)[:, None] * np.stack([np.cos(heading), -np.sin(heading)], axis=-1)
        )
        nodes = np.zeros((1, 4, 3))
        nodes[0, :, ::2] = rng.uniform((-0.01, -0.02), (0.01, 0.015))
        nodes[0, 1:, ::2] += np.cumsum(steps, axis=0)
        draw(picture[None], Tube(nodes, size * np.array([LINK_RADII]), float(shade)), camera)


def _ellipse(x: Plane, y: Plane, rng: np.random.Generator) -> Plane:
    return np.hypot(x, np.float32(rng.uniform(1.0, 2.5)) * y)


def _polygon(x: Plane, y: Plane, rng: np.random.Generator) -> Plane:
    sides = rng.integers(3, 8)
    angles = 2 * np.pi * (np.arange(sides) + rng.uniform(-0.3, 0.3, sides)) / sides
    reach = rng.uniform(0.6, 1.0, sides)
    sides_of = [
        (x * np.float32(np.cos(angle)) + y * np.float32(np.sin(angle))) / np.float32(far)
        for angle, far in zip(angles, reach, strict=True)
    ]
    return np.max(sides_of, axis=0)


def _bar(x: Plane, y: Plane, rng: np.random.Generator) -> Plane:
    return np.abs(x)


def _blob(x: Plane, y: Plane, rng: np.random.Generator) -> Plane:
    around = np.arctan2(y, x)
    waves = [
        np.float32(amount) * np.sin(k * around + np.float32(phase))
        for k, amount, phase in zip((2, 3, 5), rng.uniform(0.1, 0.3, 3), rng.uniform(0, 6.28, 3), strict=True)
    ]
    return np.hypot(x, y) * (1 + np.sum(waves, axis=0, dtype=np.float32))


def _edge(x: Plane, y: Plane, rng: np.random.Generator) -> Plane:
    return x


def _mesh(x: Plane, y: Plane, rng: np.random.Generator) -> Plane:
    period = np.float32(rng.uniform(0.08, 0.25))
    return np.minimum(np.abs((x / period) % 1 - np.float32(0.5)), np.abs((y / period) % 1 - np.float32(0.5)))


_DISTANCES: dict[str, Callable[[Plane, Plane, np.random.Generator], Plane]] = {
    "ellipse": _ellipse,
    "polygon": _polygon,
    "bar": _bar,
    "blob": _blob,
    "edge": _edge,
    "mesh": _mesh,
}
