"""The commands that a design of a dataset is driven by, from rest and back to rest.

One channel goes evenly to its peak and back. Several go in straight pieces between waypoints, each drawn
evenly over the ranges of all channels by the dataset's seed and the design's number.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.system.schema import Schema

WAYPOINTS = 4
"""Of several channels: five pieces, so that 50 frames are ten a piece."""

MAX_STEP = 1 / 40
"""Largest step between two equilibria of a path, as a share of the way from rest to its far end (of several
channels: of their ranges): with half of it 0.2 % of the frames of the published dataset end on another branch
of the hysteresis, and with any step some do (docs/log.md)."""

_STREAM = 0x70617468
"""Spawn key of the waypoints, apart from those of what varies."""


@dataclass(frozen=True)
class LoadPath:
    """Commands to solve in order, and which of them are frames.

    The frames are spread evenly over the path; the commands in between divide the way from frame to frame
    into equal steps, so that every frame is an equilibrium of its own and none is interpolated.
    """

    commands: Float[np.ndarray, "points channels"]
    """In the channels' units."""
    frames: slice
    """Of the points."""


def load_path(schema: Schema, frames: int, seed: int, number: int) -> LoadPath:
    """The path of a design; it depends on the schema, the frames, the seed and the design's number alone."""
    if len(schema.channels) == 1:
        return _there_and_back(schema.channels[0].peak, frames)
    low, high = schema.limits
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM, number)))
    rest = np.zeros((1, len(low)))
    corners = np.concatenate([rest, random.uniform(low, high, (WAYPOINTS, len(low))), rest])
    substeps = _substeps(len(corners) - 1, frames)
    place = np.linspace(0, len(corners) - 1, (frames - 1) * substeps + 1)
    columns = [np.interp(place, np.arange(len(corners)), values) for values in corners.T]
    return LoadPath(np.stack(columns, axis=1), slice(None, None, substeps))


def _there_and_back(peak: float, frames: int) -> LoadPath:
    substeps = _substeps(2, frames)
    substeps += (frames - 1) * substeps % 2  # the turning point is solved too
    rising = np.linspace(0, peak, (frames - 1) * substeps // 2 + 1)
    return LoadPath(np.concatenate([rising, rising[-2::-1]])[:, None], slice(None, None, substeps))


def _substeps(pieces: int, frames: int) -> int:
    """Steps from a frame to the next, where a piece may go from one end of a range to the other."""
    return int(np.ceil(pieces / (frames - 1) / MAX_STEP - 1e-9))
