"""What holds the bodies of a device at their bases: a hand with its fingers, sleeves, straps and blocks."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from exosight.system.camera import Camera, project
from exosight.vision.clutter import polygon_mask
from exosight.vision.occlusion import LINK_LENGTHS, LINK_RADII

Rng = np.random.Generator
Mask = UInt8[np.ndarray, "height width"]


class Piece(NamedTuple):
    """A tapered tube of one frame."""

    centres: Float[np.ndarray, "nodes 3"]
    """[m]"""
    radii: Float[np.ndarray, " nodes"]
    """[m]"""


def holders(rng: Rng, body: Piece, *, hand: bool) -> list[Piece]:
    """What goes on behind the first node of a body: a hand with other fingers, or a sleeve or strap."""
    base, ahead, radius = body.centres[0], _ahead(body), float(body.radii[0])
    kind = rng.random()
    if not hand:
        if kind < 0.35:  # a sleeve around the base, which goes on behind it
            steps = np.array([rng.uniform(-0.003, 0.008), -0.03, -0.08])
            size = radius * rng.uniform(1.0, 2.0) * np.array([1.0, 1.0, rng.uniform(0.8, 1.8)])
            return [Piece(base + steps[:, None] * ahead, size)]
        if kind < 0.55:  # a strap or post across it
            across = _turned(ahead, np.pi / 2 + rng.uniform(-0.4, 0.4))
            reach = rng.uniform((-0.08, 0.0), (0.0, 0.08))[:, None]
            back = np.array([0.0, rng.uniform(-0.012, 0.012), 0.0]) - rng.uniform(0.0, 0.012) * ahead
            return [Piece(base + back + reach * across, np.full(2, radius * rng.uniform(0.6, 1.6)))]
        return []
    if kind < 0.25:
        return []
    palm = np.array([-rng.uniform(0.0, 0.012), -0.03, -0.09])
    bend = np.array([0.0, rng.uniform(-0.012, 0.012), rng.uniform(-0.02, 0.01)])
    nodes = base + palm[:, None] * ahead + np.array([0.0, 0.5, 1.0])[:, None] * bend
    found = [Piece(nodes, radius * np.array([rng.uniform(0.9, 1.4), *rng.uniform((1.2, 1.4), (2.0, 2.8))]))]
    for _ in range(rng.integers(0, 4)):
        front = rng.random() < 0.25
        size = rng.uniform(0.8, 1.1)
        # A finger before the others is bent into the fist, so that it hides little.
        turns = rng.uniform((1.2, 1.0, 0.8), (2.2, 1.8, 1.5)) if front else rng.uniform(0.0, (1.2, 1.4, 1.2))
        place = np.array([0.0, rng.uniform(-0.03, -0.015) if front else rng.uniform(0.012, 0.06), 0.0])
        place += rng.uniform(-0.016, -0.002) * ahead + [0.0, 0.0, rng.uniform(-0.012, 0.01)]
        lengths = size * np.array(LINK_LENGTHS) * (0.6 if front else 1.0)
        steps = [
            length * _turned(ahead, -turn) for length, turn in zip(lengths, np.cumsum(turns), strict=True)
        ]
        found.append(
            Piece(
                base + place + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]), size * np.array(LINK_RADII)
            )
        )
    return found


def blocks(
    rng: Rng, bodies: list[Piece], camera: Camera
) -> tuple[list[tuple[Mask, np.ndarray]], list[tuple[Mask, np.ndarray]]]:
    """Flat-sided mounts behind the bodies and before them, each a mask and its reflectance."""
    behind: list[tuple[Mask, np.ndarray]] = []
    before: list[tuple[Mask, np.ndarray]] = []
    for number, body in enumerate(bodies):
        if rng.random() < (0.3 if number == 0 else 0.5):
            continue
        base, ahead, radius = body.centres[0], _ahead(body), float(body.radii[0])
        front = rng.random() < 0.5
        end = rng.uniform(-0.008, 0.005) if front else rng.uniform(-0.01, 0.02)
        start = end - np.exp(rng.uniform(np.log(0.006), np.log(0.08)))
        low, high = -radius * rng.uniform(0.3, 4.0), radius * rng.uniform(0.3, 3.0)
        up = _turned(ahead, np.pi / 2 + rng.uniform(-0.15, 0.15))
        depth = np.array([0.0, (-1 if front else 1) * radius, 0.0])
        corners = np.stack(
            [
                base + depth + a * ahead + b * up
                for a, b in ((start, low), (end, low), (end, high), (start, high))
            ]
        )
        mask = polygon_mask(project(camera, corners), (camera.height, camera.width))
        upper, lower = rng.uniform(0.6, 1.0, 2).tolist()
        slope = np.linspace(upper, lower, camera.height, dtype=np.float32)[:, None]
        shade = np.broadcast_to(np.float32(rng.uniform(0.03, 0.95)) * slope, mask.shape)
        (before if front else behind).append((mask, shade))
    return behind, before


def _ahead(body: Piece) -> Float[np.ndarray, "3"]:
    step = body.centres[1] - body.centres[0]
    return step / np.linalg.norm(step)


def _turned(ahead: Float[np.ndarray, "3"], angle: float) -> Float[np.ndarray, "3"]:
    """A direction turned about the y axis, from x towards z."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * ahead[0] - sin * ahead[2], ahead[1], sin * ahead[0] + cos * ahead[2]])
