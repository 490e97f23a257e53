"""Made-up pictures and readings, and both steps of their import."""

from pathlib import Path

import numpy as np

from exosight.dataset import Manifest
from exosight.rig.importing import ImportConfig, prepare, store


def pictures_of(count: int, seed: int = 0, shape: tuple[int, ...] = (32, 36)) -> np.ndarray:
    """Random grays that no two pictures share."""
    return np.random.default_rng(seed).integers(0, 256, (count, *shape), np.uint8)


def readings_of(count: int) -> np.ndarray:
    """Two columns of numbers that differ from row to row."""
    return np.column_stack([np.arange(count) / 8, np.cos(np.arange(count))])


def imported(source: Path, out: Path, table: Path | None = None, **options: object) -> Manifest:
    """Both steps of an import."""
    drop = bool(options.pop("drop", False))
    resume = bool(options.pop("resume", False))
    times = options.pop("times", None)
    assert times is None or isinstance(times, Path)
    config = ImportConfig(**options)  # pyright: ignore[reportArgumentType]
    with prepare(source, config, table, times, drop=drop) as found:
        return store(found, out, resume=resume, drop=drop)
