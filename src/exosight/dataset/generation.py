"""A dataset made by one restartable job: chunk after chunk, here or on many machines, the manifest last.

This module needs JAX; reading a dataset, or `GenerateConfig`, does not.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from exosight import __version__
from exosight.dataset.card import write_card
from exosight.dataset.config import GenerateConfig
from exosight.dataset.engine import on_cluster
from exosight.dataset.frames import CAUSES, Frames
from exosight.dataset.job import ChunkRecord, GenerationJob, finished, identity, opened, write_record
from exosight.dataset.manifest import (
    LARGEST_FRAMES,
    MANIFEST,
    Manifest,
    new_manifest,
    read_manifest,
    write_manifest,
)
from exosight.dataset.simulation import simulate_shapes
from exosight.dataset.store import write_chunk
from exosight.dataset.variation import variation_columns
from exosight.errors import DataError, InputError
from exosight.exosuit.assembly import MAX_FORCE
from exosight.exosuit.scenarios import SCENARIOS, SampledShape, sample_shapes

SHAPES_PER_CHUNK = 64
"""Most shapes that are simulated together and stored as one file."""

CHUNK_BYTES = 256 * 2**20
"""Most bytes of images in a chunk: with more frames or pixels it has fewer shapes, so memory is bounded."""


def generate(
    config: GenerateConfig,
    folder: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    resume: bool = False,
    workers: int = 1,
    scheduler: str | None = None,
) -> Manifest:
    """Simulate, render and store a dataset; on machines of one kind equal configurations give equal files.

    progress    called with the shapes done and their total
    resume      go on with the dataset that the folder holds, stopped at any point: chunks that are whole
                stay, damaged ones are made again; otherwise the folder must not exist
    workers     processes on this machine; one (this process) uses up to eight cores
    scheduler   address of a running Dask cluster that shares the folder, instead of workers
    returns     the manifest, which also counts the frames dropped by cause

    Raises DataError if the folder is in use, holds something else or cannot be written; InputError if the
    dataset would be too large to be read again, or if no frame of it is worth keeping.
    """
    shapes = _shapes(config.per_scenario, config.seed)
    _check_size(config, len(shapes))
    job = GenerationJob(config, _shapes_per_chunk(config))
    groups = job.groups(len(shapes))
    folder = folder.resolve()
    with opened(folder, job, resume=resume):
        records = {number: finished(folder, job, number, group) for number, group in enumerate(groups)}
        missing = [number for number, record in records.items() if record is None]
        done = sum(len(groups[number]) for number in records if number not in missing)
        progress(done, len(shapes))
        if not missing and (manifest := _complete(folder, list(records.values()))):
            return manifest

        def step(shapes_done: int) -> None:
            nonlocal done
            done += shapes_done
            progress(done, len(shapes))

        (folder / MANIFEST).unlink(missing_ok=True)  # until its chunks are whole, it is no dataset
        if workers == 1 and scheduler is None:
            for number in missing:
                records[number] = make_chunk(folder, job, number, step)
        else:
            task = partial(make_chunk, folder, job)
            for record in on_cluster(task, missing, workers, scheduler):
                records[record.number] = record
                step(len(groups[record.number]))
        return _finish(folder, config, shapes, [record for record in records.values() if record])


def make_chunk(
    folder: Path, job: GenerationJob, number: int, done: Callable[[int], None] = lambda shapes: None
) -> ChunkRecord:
    """Make one chunk of a job, unless the folder has it: any number of processes may, in any order.

    done   called with the number of shapes finished, as they finish

    Raises InputError if this is another version of exosight than the job's, DataError if the chunk cannot be
    written.
    """
    if job.exosight_version != __version__:
        raise InputError(
            f"chunk {number}: the job is one of exosight {job.exosight_version}, this process runs "
            f"{__version__}; install the same version everywhere"
        )
    shapes = _shapes(job.config.per_scenario, job.config.seed)
    group = job.groups(len(shapes))[number]
    record = finished(folder, job, number, group)
    if record is None:
        frames, dropped = simulate_shapes(job.config, [shapes[i] for i in group], done)
        record = _store(folder, job, number, frames, dropped)
    return record


def _store(
    folder: Path, job: GenerationJob, number: int, frames: Frames, dropped: dict[str, int]
) -> ChunkRecord:
    try:
        record = ChunkRecord(
            job=identity(job),
            number=number,
            entry=write_chunk(folder, number, frames, variation_columns(job.config, frames))
            if len(frames)
            else None,
            dofs=frames.pose.shape[1],
            kept=tuple(np.bincount(frames.scenario, minlength=len(SCENARIOS)).tolist()),
            dropped=dropped,
        )
        write_record(folder, record)  # after the frames: what has a record is whole
    except DataError as error:
        raise DataError(f"{error}; mend that and run the same command again with --resume") from error
    return record


def _complete(folder: Path, records: list[ChunkRecord | None]) -> Manifest | None:
    """The manifest of a folder whose chunks are whole, if it is there and is theirs."""
    try:
        manifest = read_manifest(folder)
    except DataError:
        return None
    entries = tuple(record.entry for record in records if record and record.entry)
    return manifest if manifest.chunks == entries else None


def _finish(
    folder: Path, config: GenerateConfig, shapes: tuple[SampledShape, ...], records: list[ChunkRecord]
) -> Manifest:
    """Card and manifest of a folder that has all its chunks."""
    dropped = {cause: sum(record.dropped[cause] for record in records) for cause in CAUSES}
    chunks = [record.entry for record in records if record.entry]
    if not chunks:
        reasons = ", ".join(f"{cause.replace('_', ' ')} {count}" for cause, count in dropped.items())
        raise InputError(
            f"dataset: no frame is worth keeping ({reasons}); change young, contact_stiffness or gap, and "
            "name a new folder"
        )
    manifest = new_manifest(
        config=TypeAdapter(GenerateConfig).dump_python(config, mode="json"),
        seed=config.seed,
        camera=config.camera,
        load_limit=MAX_FORCE,
        dofs=records[0].dofs,
        shapes=list(shapes),
        chunks=chunks,
        dropped=dropped,
    )
    kept = np.sum([record.kept for record in records], axis=0)
    write_card(folder, manifest, dict(zip(manifest.scenarios, kept.tolist(), strict=True)))
    write_manifest(folder, manifest)
    return manifest


@lru_cache(maxsize=2)
def _shapes(per_scenario: int, seed: int) -> tuple[SampledShape, ...]:
    """The shapes of a dataset; a process makes many chunks of the same."""
    return tuple(sample_shapes(per_scenario, seed))


def _shapes_per_chunk(config: GenerateConfig) -> int:
    shape_bytes = config.frames * config.camera.height * config.camera.width
    return max(1, min(SHAPES_PER_CHUNK, CHUNK_BYTES // shape_bytes))


def _check_size(config: GenerateConfig, shapes: int) -> None:
    camera = config.camera
    needed = shapes * config.frames * camera.height * camera.width
    if needed > LARGEST_FRAMES:
        raise InputError(
            f"dataset: {shapes} shapes with {config.frames} frames of {camera.width}×{camera.height} pixels "
            f"take {needed / 2**30:.0f} GiB, and at most {LARGEST_FRAMES >> 30} GiB can be read; "
            "choose fewer shapes or frames, or smaller images"
        )
