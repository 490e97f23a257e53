"""A dataset in memory, as the commands use it."""

from dataclasses import dataclass, field
from pathlib import Path

from exosight.dataset import (
    Columns,
    Frames,
    Manifest,
    Split,
    make_split,
    read_frames,
    read_manifest,
    read_variation,
)


@dataclass(frozen=True)
class Data:
    """A dataset in memory."""

    manifest: Manifest
    frames: Frames
    variation: Columns = field(default_factory=dict)
    """what was drawn for each frame, by name"""


def load(folder: Path) -> Data:
    """A dataset from disk; DataError if it is missing, incomplete or damaged."""
    return Data(read_manifest(folder), read_frames(folder), read_variation(folder))


def divided(data: Data, protocol: str, seed: int, held_out: str | None) -> Split:
    """Its frames for learning, validation and testing, see `exosight.dataset.make_split`."""
    return make_split(data.frames, protocol, seed, held_out, data.variation, data.manifest.families)
