"""Centrelines and radii of the bodies in every frame of a dataset. This module needs JAX."""

from collections.abc import Callable

import numpy as np

from exosight.dataset.designs import config_of, design_set
from exosight.dataset.frames import Frames
from exosight.dataset.manifest import Manifest
from exosight.system.observation import body_axes, body_shapes


def poses(
    manifest: Manifest, frames: Frames, progress: Callable[[int, int], None] = lambda done, total: None
) -> dict[str, np.ndarray]:
    """Of each tube axis_NAME (frames, nodes, 3) and radius_NAME (frames, nodes) [m], float32.

    progress   called with the designs done and their total

    Raises DataError for a manifest with the configuration of another version, InputError for options that are
    not the system's.
    """
    designs = design_set(config_of(manifest), manifest.description)
    numbers, counts = np.unique(frames.design, return_counts=True)
    by_number = {design.number: design for design in manifest.designs}
    found: dict[str, np.ndarray] = {}
    for done, number in enumerate(numbers.tolist(), 1):
        system, rows = designs.build(by_number[number]), np.flatnonzero(frames.design == number)
        # As many for every design, the last again and again: one compilation for all.
        padded = np.pad(rows, (0, counts.max() - len(rows)), mode="edge")
        axes = body_axes(system, frames.pose[padded])
        for name, values in body_shapes(system, axes).items():
            if name not in found:
                found[name] = np.zeros((len(frames), *values.shape[1:]), np.float32)
            found[name][rows] = values[: len(rows)]
        progress(done, len(numbers))
    return found
