"""The published dataset at full size: made, stored, read and drawn from, by `python -m benchmarks.dataset`.

Needs about 250 MB of disk for a while. Each part runs in a process of its own, so that its memory is its own.
"""

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from exosight.app.bench import cpu_name
from exosight.dataset import read_frames, read_manifest, take
from exosight.dataset.config import GenerateConfig

PER_SCENARIO = 125
BATCH, BATCHES = 64, 2000


def run(per_scenario: int = PER_SCENARIO) -> dict[str, str | int | float]:
    """Measure, and round for reading: times include starting, compiling and checksums."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "data"
        (seconds, busy), making_memory = _apart(_make, folder, per_scenario)
        size = sum(path.stat().st_size for path in folder.iterdir())
        manifest = read_manifest(folder)
        (reading, drawing), reading_memory = _apart(_read, folder)
    simulated = manifest.frames + sum(manifest.dropped.values())
    return {
        "name": "dataset",
        "cpu": cpu_name(),
        "frames simulated": simulated,
        "frames kept, rendered and stored": manifest.frames,
        "seconds to make": round(seconds, 1),
        "CPU seconds to make": round(busy, 1),
        "frames simulated a second": round(simulated / seconds),
        "MB on disk": round(size / 1e6, 1),
        "GiB of memory while making": round(making_memory, 2),
        "seconds to read all": round(reading, 1),
        "GiB of memory with all read": round(reading_memory, 2),
        f"frames a second in random batches of {BATCH}": float(f"{drawing:.3g}"),
    }


def _make(folder: Path, per_scenario: int) -> tuple[float, float]:
    """Seconds to make a dataset, and those of all cores together."""
    start = time.perf_counter()
    from exosight.dataset.generation import generate

    generate(GenerateConfig(per_scenario=per_scenario), folder)
    return time.perf_counter() - start, time.process_time()


def _read(folder: Path) -> tuple[float, float]:
    """Seconds to read a dataset, and frames a second drawn from it at random."""
    start = time.perf_counter()
    frames = read_frames(folder)
    reading = time.perf_counter() - start
    rng = np.random.default_rng(0)
    picks = rng.integers(len(frames), size=(BATCHES, BATCH))
    start = time.perf_counter()
    for index in picks:
        take(frames, index)
    return reading, BATCHES * BATCH / (time.perf_counter() - start)


def _measured(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    found = function(*arguments)
    return found, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # KiB on Linux


def _apart(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """What a function returns in a process of its own, and the most memory that process held [GiB]."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_measured, function, *arguments).result()


if __name__ == "__main__":
    for key, value in run().items():
        print(f"{key}: {value}")
