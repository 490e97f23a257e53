"""Labelled images: in memory, on disk, and divided for training and testing."""

from exosight.dataset.frames import QUANTITIES, Columns, Frames, concatenate, direction, previous, take
from exosight.dataset.manifest import (
    ChunkEntry,
    Manifest,
    dataset_identity,
    new_manifest,
    read_manifest,
    write_manifest,
)
from exosight.dataset.splits import PROTOCOLS, Split, make_split
from exosight.dataset.store import read_frames, read_sensors, read_variation, write_chunk

__all__ = [
    "PROTOCOLS",
    "QUANTITIES",
    "ChunkEntry",
    "Columns",
    "Frames",
    "Manifest",
    "Split",
    "concatenate",
    "dataset_identity",
    "direction",
    "make_split",
    "new_manifest",
    "previous",
    "read_frames",
    "read_manifest",
    "read_sensors",
    "read_variation",
    "take",
    "write_chunk",
    "write_manifest",
]
