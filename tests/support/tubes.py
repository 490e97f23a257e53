"""Tubes in pixels, and what pictures of them show."""

import numpy as np

from exosight.vision import BACKGROUND, Camera, Tube

# A power of two, so that shifts by whole pixels are exact in floating point.
SCALE = 2.0**-10
CAMERA = Camera(centre=(0.0, 0.0), metres_per_pixel=SCALE, width=64, height=48)


def tube(nodes, radii, shade=0.0) -> Tube:
    """One frame from nodes (x, z) and radii, both in pixels of CAMERA from its centre."""
    nodes = np.asarray(nodes, float) * SCALE
    centres = np.stack([nodes[:, 0], np.zeros(len(nodes)), nodes[:, 1]], axis=-1)
    return Tube(centres[None], np.asarray(radii, float)[None] * SCALE, shade)


def coverage(image: np.ndarray) -> np.ndarray:
    """Share of each pixel that a black tube covers."""
    return 1 - image / BACKGROUND


def assert_alike(a: np.ndarray, b: np.ndarray) -> None:
    """Equal to one gray: round-off may tip the rounding of a pixel."""
    assert np.abs(a.astype(int) - b).max() <= 1


def curl(nodes: int = 42) -> tuple[np.ndarray, np.ndarray]:
    """A tapered rod that curls over itself [pixels]."""
    s = np.linspace(0, 1, nodes)
    radius = 16 - 9 * s
    angle = 2.6 * np.pi * s
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1), 5 - 2 * s
