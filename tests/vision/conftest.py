"""Clean pictures of made-up bodies: a bent dark tube over a lighter straight one."""

import numpy as np
import pytest

from exosight.vision import Camera, Tube, render
from exosight.vision.augment import Appearance

SIDE = 128
CAMERA = Camera()


def bodies(frames: int) -> list[Tube]:
    """A finger-like and an exosuit-like tube, bent more from frame to frame."""
    s = np.linspace(0, 1, 30)
    bend = np.linspace(0, 1.5, frames)[:, None] * s**2
    upper = np.stack([0.1 * s * np.cos(bend), 0 * bend, 0.018 - 0.1 * s * np.sin(bend) * 0.4], axis=-1)
    lower = np.stack([0.09 * s, 0 * s, -0.3 * 0.09 * s * s], axis=-1)[None] * np.ones((frames, 1, 1))
    return [
        Tube(lower, np.tile(np.linspace(0.0105, 0.005, 30), (frames, 1)), 0.70),
        Tube(upper, np.tile(np.linspace(0.006, 0.004, 30), (frames, 1)), 0.35),
    ]


@pytest.fixture(scope="session")
def clean() -> np.ndarray:
    """Six clean pictures."""
    return render(bodies(6), CAMERA)


@pytest.fixture(scope="session")
def cover() -> np.ndarray:
    """How much of each of their pixels the bodies cover, from the renderer: black bodies."""
    black = render([Tube(tube.centres, tube.radii, 0.0) for tube in bodies(6)], CAMERA)
    return np.rint((1 - black / 235) * 255).astype(np.uint8)


@pytest.fixture(scope="session")
def plain():
    """Appearances that change nothing but what they are told: plain(frames, roll=0.1)."""
    return Appearance.neutral
