"""How many pictures a second one core renders: `python -m benchmarks.renderer`."""

import time

import numpy as np

from exosight.app.bench import cpu_name
from exosight.system.camera import Visibility
from exosight.vision import Camera, Tube, render

FRAMES, REPEATS = 1000, 9


def scene(frames: int = FRAMES) -> list[Tube]:
    """A finger of four links and a rod of 42 nodes above it, both bending from frame to frame [m]."""
    bend = np.linspace(0, 1, frames)[:, None]
    angles = -np.cumsum(bend * [0.5, 0.6, 0.5, 0.0], axis=1)
    lengths = np.array([0.045, 0.0253, 0.0236, 0.001])
    finger = np.pad(np.cumsum(_ahead(angles) * lengths[:, None], axis=1), ((0, 0), (1, 0), (0, 0)))
    arc = np.linspace(0, 1, 42)
    rod = np.pad(np.cumsum(_ahead(-1.8 * bend * arc[1:]) * 0.1 / 41, axis=1), ((0, 0), (1, 0), (0, 0)))
    rod += [0, 0, 0.0108 + 0.0058]
    return [
        Tube(finger, np.tile([0.0108, 0.00695, 0.0051, 0.00435, 0.004], (frames, 1)), shade=0.7),
        Tube(rod, np.tile(0.0058 + (0.004 - 0.0058) * arc, (frames, 1)), shade=0.35),
    ]


def _ahead(angles: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angles), np.zeros_like(angles), np.sin(angles)], axis=-1)


def run() -> dict:
    """Frames a second on one core at the default camera, two bodies, median of several repeats.

    In depth order, and stacked, as `published` is drawn.
    """
    tubes, camera = scene(), Camera()
    seconds: dict[Visibility, list[float]] = {"depth": [], "stacked": []}
    for visibility in seconds:
        render(tubes, camera, visibility=visibility)  # compiles
    for _ in range(REPEATS):
        for visibility, own in seconds.items():
            start = time.perf_counter()
            render(tubes, camera, visibility=visibility)
            own.append(time.perf_counter() - start)
    rates = {visibility: round(FRAMES / float(np.median(own))) for visibility, own in seconds.items()}
    return {
        "name": "renderer",
        "cpu": cpu_name(),
        "image": f"{camera.width}×{camera.height}",
        "bodies": len(tubes),
        "frames_per_second": rates["depth"],
        "stacked: frames_per_second": rates["stacked"],
    }


if __name__ == "__main__":
    result = run()
    scene_text = f"{result['image']}, {result['bodies']} bodies, one core"
    print(f"{result['cpu']}: {result['frames_per_second']} frames/s ({scene_text})")
