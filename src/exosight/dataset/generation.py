"""A dataset made by one restartable job: chunk after chunk, here or on many machines, the manifest last.

This module needs JAX; reading a dataset, or `GenerateConfig`, does not.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from math import prod
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import TypeAdapter

from exosight import __version__
from exosight.dataset.card import write_card
from exosight.dataset.config import GenerateConfig
from exosight.dataset.designs import design_set, draw_designs, resolved
from exosight.dataset.engine import on_cluster
from exosight.dataset.job import (
    ChunkRecord,
    GenerationJob,
    finished,
    identity,
    opened,
    stored_description,
    write_record,
)
from exosight.dataset.manifest import (
    LARGEST_FRAMES,
    MANIFEST,
    Manifest,
    new_manifest,
    read_manifest,
    write_manifest,
)
from exosight.dataset.simulation import Solved, causes, frames_of, solve_designs
from exosight.dataset.solved import SolvedDesigns
from exosight.dataset.store import write_chunk
from exosight.dataset.variation import shades_of, variation_columns
from exosight.errors import DataError, InputError
from exosight.system.design import Design
from exosight.system.designs import DesignSet

DESIGNS_PER_CHUNK = 64
"""Most designs that are simulated together and stored as one file."""

CHUNK_BYTES = 256 * 2**20
"""Most bytes of images in a chunk: with more frames or pixels it has fewer designs, so memory is bounded."""


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

    progress    called with the designs done and their total
    resume      go on with the dataset that the folder holds, stopped at any point: chunks that are whole
                stay, damaged ones are made again; otherwise the folder must not exist. The folder holds all
                that the system file says: it may be gone
    workers     processes on this machine; one (this process) uses up to eight cores
    scheduler   address of a running Dask cluster that shares the folder, instead of workers
    returns     the manifest, which also counts the frames dropped by cause

    Raises DataError if the folder is in use, holds something else or cannot be written, or if the system file
    cannot be read; InputError for options that are not the system's, if the dataset would be too large to be
    read again, or if no frame of it is worth keeping.
    """
    folder = folder.resolve()
    job = _job(config, folder if resume else None)
    designs, drawn = _designs(job)
    groups = job.groups(len(drawn))
    with opened(folder, job, resume=resume):
        records = {number: finished(folder, job, number, group) for number, group in enumerate(groups)}
        missing = [number for number, record in records.items() if record is None]
        done = sum(len(groups[number]) for number in records if number not in missing)
        progress(done, len(drawn))
        if not missing and (manifest := _complete(folder, list(records.values()))):
            return manifest

        def step(designs_done: int) -> None:
            nonlocal done
            done += designs_done
            progress(done, len(drawn))

        (folder / MANIFEST).unlink(missing_ok=True)  # until its chunks are whole, it is no dataset
        if workers == 1 and scheduler is None:
            for record in _make_chunks(folder, job, missing, step):
                records[record.number] = record
        else:
            task = partial(make_chunk, folder, job)
            for record in on_cluster(task, missing, workers, scheduler):
                records[record.number] = record
                step(len(groups[record.number]))
        return _finish(folder, job, designs, drawn, [record for record in records.values() if record])


def make_chunk(
    folder: Path, job: GenerationJob, number: int, done: Callable[[int], None] = lambda designs: None
) -> ChunkRecord:
    """Make one chunk of a job, unless the folder has it: any number of processes may, in any order.

    done   called with the number of designs finished, as they finish

    Raises InputError if this is another version of exosight than the job's, DataError if the chunk cannot be
    written.
    """
    if job.exosight_version != __version__:
        raise InputError(
            f"chunk {number}: the job is one of exosight {job.exosight_version}, this process runs "
            f"{__version__}; install the same version everywhere"
        )
    chunk = _chunk(folder, job, number)
    return finished(folder, job, number, chunk.group) or chunk.store(chunk.solve(done))


class _Chunk(NamedTuple):
    """The designs of one chunk, to be solved and stored."""

    folder: Path
    job: GenerationJob
    number: int
    group: range
    designs: DesignSet
    chosen: list[Design]

    @property
    def kept(self) -> SolvedDesigns:
        """Its designs that are solved, on disk until it is stored."""
        return SolvedDesigns(self.folder, self.number, identity(self.job))

    def solve(self, done: Callable[[int], None]) -> Solved:
        return solve_designs(self.job.config, self.designs, self.chosen, done, self.kept)

    def store(self, solved: Solved) -> ChunkRecord:
        config = self.job.config
        frames, dropped = frames_of(config, self.designs, self.chosen, solved)
        columns = variation_columns(config, self.designs, self.chosen, frames)
        record = ChunkRecord(
            job=identity(self.job),
            number=self.number,
            entry=None,
            dofs=frames.pose.shape[1],
            kept=tuple(np.bincount(frames.scenario, minlength=len(self.designs.scenarios)).tolist()),
            dropped=dropped,
        )
        if len(frames):
            record = replace(record, entry=write_chunk(self.folder, self.number, frames, columns))
        write_record(self.folder, record)  # after the frames: what has a record is whole
        self.kept.remove()
        return record


def _chunk(folder: Path, job: GenerationJob, number: int) -> _Chunk:
    designs, drawn = _designs(job)
    group = job.groups(len(drawn))[number]
    return _Chunk(folder, job, number, group, designs, [drawn[i] for i in group])


def _make_chunks(
    folder: Path, job: GenerationJob, numbers: Sequence[int], done: Callable[[int], None]
) -> Iterator[ChunkRecord]:
    """Chunks made one after the other: while one is solved, the one before it is drawn and stored."""
    with ThreadPoolExecutor(1) as behind:
        storing: Future[ChunkRecord] | None = None
        for number in numbers:
            chunk = _chunk(folder, job, number)
            solved = chunk.solve(done)
            if storing:
                yield storing.result()
            storing = behind.submit(chunk.store, solved)
        if storing:
            yield storing.result()


def _job(config: GenerateConfig, begun: Path | None) -> GenerationJob:
    """What is to be made; of a system file that is gone, as the folder says in which it was begun."""
    name = Path(config.system).name
    description = None
    if begun and not Path(config.system).exists():
        description = stored_description(begun, name)
    if description is None:
        config, description = resolved(config)
    else:
        config = replace(config, system=name)
    designs = design_set(config, description)
    drawn = draw_designs(config, designs)
    _check_size(config, designs, len(drawn))
    shades_of(config, designs.build(drawn[0]))
    per_chunk = CHUNK_BYTES // (config.frames * prod(designs.schema.image_size))
    return GenerationJob(config, description, causes(designs), max(1, min(DESIGNS_PER_CHUNK, per_chunk)))


def _designs(job: GenerationJob) -> tuple[DesignSet, tuple[Design, ...]]:
    designs = design_set(job.config, job.description)
    return designs, draw_designs(job.config, designs)


def _complete(folder: Path, records: list[ChunkRecord | None]) -> Manifest | None:
    """The manifest of a folder whose chunks are whole, if it is there and is theirs."""
    try:
        manifest = read_manifest(folder)
    except DataError:
        return None
    entries = tuple(record.entry for record in records if record and record.entry)
    return manifest if manifest.chunks == entries else None


def _finish(
    folder: Path,
    job: GenerationJob,
    designs: DesignSet,
    drawn: Sequence[Design],
    records: list[ChunkRecord],
) -> Manifest:
    """Card and manifest of a folder that has all its chunks."""
    dropped = {cause: sum(record.dropped[cause] for record in records) for cause in job.causes}
    chunks = [record.entry for record in records if record.entry]
    if not chunks:
        reasons = ", ".join(f"{cause.replace('_', ' ')} {count}" for cause, count in dropped.items())
        raise InputError(
            f"dataset: no frame is worth keeping ({reasons}); change stiffness, clearance or ranges, and "
            "name a new folder"
        )
    manifest = new_manifest(
        config=TypeAdapter(GenerateConfig).dump_python(job.config, mode="json"),
        seed=job.config.seed,
        system=designs.name,
        schema=designs.schema,
        description=job.description,
        camera=designs.camera,
        dofs=records[0].dofs,
        families=designs.families,
        scenarios=designs.scenarios,
        designs=tuple(drawn),
        chunks=tuple(chunks),
        dropped=dropped,
    )
    kept = np.sum([record.kept for record in records], axis=0)
    write_card(folder, manifest, dict(zip(manifest.scenarios, kept.tolist(), strict=True)))
    write_manifest(folder, manifest)
    return manifest


def _check_size(config: GenerateConfig, designs: DesignSet, count: int) -> None:
    height, width = designs.schema.image_size
    needed = count * config.frames * height * width
    if needed > LARGEST_FRAMES:
        raise InputError(
            f"dataset: {count} designs with {config.frames} frames of {width}×{height} pixels "
            f"take {needed / 2**30:.0f} GiB, and at most {LARGEST_FRAMES >> 30} GiB can be read; "
            "choose fewer designs or frames, or smaller images"
        )
