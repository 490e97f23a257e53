"""The commands that a design of a dataset is driven by, from rest and back to rest.

One channel goes evenly to its peak and back. Several go in straight pieces between waypoints, each drawn
evenly over the ranges of all channels by the dataset's seed and the design's number.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from exosight.system.schema import Schema

WAYPOINTS = 4
"""Of several channels: five pieces, so that 50 frames are ten a piece."""

_STREAM = 0x70617468
"""Spawn key of the waypoints, apart from those of what varies."""


@dataclass(frozen=True)
class LoadPath:
    """Commands to solve in order, with straight ways between, and which of them are frames.

    The frames are spread evenly over the path; what is solved beside them are the points at which it turns.
    """

    commands: Float[np.ndarray, "points channels"]
    """In the channels' units."""
    frames: Int[np.ndarray, " frames"]
    """Places of the frames among the points."""


def load_path(schema: Schema, frames: int, seed: int, number: int) -> LoadPath:
    """The path of a design; it depends on the schema, the frames, the seed and the design's number alone."""
    if len(schema.channels) == 1:
        return _there_and_back(schema.channels[0].peak, frames)
    low, high = schema.limits
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM, number)))
    rest = np.zeros((1, len(low)))
    corners = np.concatenate([rest, random.uniform(low, high, (WAYPOINTS, len(low))), rest])
    turns = np.arange(len(corners))
    own = np.linspace(0, len(corners) - 1, frames)
    every = np.union1d(own, turns)
    columns = [np.interp(every, turns, values) for values in corners.T]
    return LoadPath(np.stack(columns, axis=1), np.searchsorted(every, own))


def _there_and_back(peak: float, frames: int) -> LoadPath:
    """As many frames rise as fall, to the last bit at the same commands."""
    place = np.arange(frames)
    own = peak * (2 * np.minimum(place, frames - 1 - place) / (frames - 1))
    if frames % 2:
        return LoadPath(own[:, None], place)
    half = frames // 2  # the turn is between two frames
    return LoadPath(np.insert(own, half, peak)[:, None], place + (place >= half))
