"""The folder of a dataset while it is made: whose it is, who works on it, and which of its chunks are whole.

job.json          what is to be made, from the start; another configuration or version is refused
.lock             held by the process that works on the folder; the operating system frees it when that ends
chunk_0000.h5     frames, written whole and renamed into place
chunk_0000.json   the record of the chunk with its checksum, written after it
chunk_0000.npz    the designs of a chunk in the making that are solved already, see `solved`
"""

import fcntl
import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

from pydantic import Field, JsonValue, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from exosight import __version__
from exosight.dataset.config import GenerateConfig
from exosight.dataset.manifest import FORMAT, JOB, ChunkEntry, Count
from exosight.dataset.store import chunk_name
from exosight.errors import DataError, InputError
from exosight.files import open_file, read_file, replace_file, write_new_file
from exosight.validation import CONFIG, first_difference

LOCK = ".lock"
LARGEST_RECORD = 2**20  # [bytes]; a record takes under 1 KiB
LARGEST_JOB = 2**23  # [bytes]; that of the largest system file takes under 4 MiB


@runtime_checkable
class Job(Protocol):
    """What a folder is to hold: a pydantic dataclass of all that decides what its chunks hold."""

    @property
    def causes(self) -> tuple[str, ...]:
        """Why frames may be left out."""
        ...

    @property
    def exosight_version(self) -> str:
        """Version of the package that makes it."""
        ...


@dataclass(frozen=True, config=CONFIG)
class GenerationJob:
    """What is to be made; every chunk follows from this and its number."""

    config: GenerateConfig
    """What the dataset is made of."""
    description: dict[str, JsonValue] | None
    """Entries of the system file; None: a preset of this package."""
    causes: tuple[str, ...]
    """Why frames may be left out."""
    designs_per_chunk: Annotated[int, Field(ge=1)]
    """Designs stored as one file."""
    exosight_version: str = __version__
    """Version of the package that makes it."""
    format: int = FORMAT
    """Version of the layout on disk."""

    def groups(self, designs: int) -> list[range]:
        """Which designs each chunk holds, by their places in the list of designs."""
        starts = range(0, designs, self.designs_per_chunk)
        return [range(start, min(start + self.designs_per_chunk, designs)) for start in starts]


@dataclass(frozen=True, config=CONFIG)
class ChunkRecord:
    """What is known of a chunk that has been made."""

    job: str
    """Which job it is a chunk of, see `identity`."""
    number: Count
    """Place of the chunk in the dataset."""
    entry: ChunkEntry | None
    """Its file, or None if every frame was dropped."""
    dofs: Annotated[int, Field(ge=0, le=10_000)]
    """Generalised coordinates of a pose."""
    kept: tuple[Count, ...]
    """Frames kept of each scenario."""
    dropped: dict[str, Count]
    """Frames left out, by cause."""


_JOB, _RECORD = TypeAdapter(GenerationJob), TypeAdapter(ChunkRecord)


def identity(job: Job) -> str:
    """Identifies a job: the checksum of all that decides what its chunks hold."""
    return hashlib.sha256(_to_text(job)).hexdigest()


@contextmanager
def opened(folder: Path, job: Job, *, resume: bool) -> Iterator[None]:
    """The folder of this job, new or resumed, which no other process opens meanwhile.

    Raises DataError if the folder is in use, holds something else or cannot be made or written, InputError
    if it holds another job.
    """
    if folder.exists() and not resume:
        raise DataError(
            f"{folder}: exists already; name a new folder, or add --resume to go on with its dataset"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"{folder}: cannot be made ({error.strerror}); name another folder") from error
    if not (folder / JOB).exists() and any(not _is_ours(path) for path in folder.iterdir()):
        raise DataError(f"{folder}: holds no {JOB}, so no dataset to go on with; name a new folder")
    with _locked(folder):
        if (folder / JOB).exists():
            _check_same(folder / JOB, job)
        else:
            write_new_file(folder / JOB, _to_text(job))
        for part in folder.glob(".*.part"):  # what a killed process was writing
            part.unlink(missing_ok=True)
        yield


def finished(folder: Path, job: Job, number: int, designs: Iterable[int]) -> ChunkRecord | None:
    """The record of a chunk of this job if its file is whole, else None."""
    path = folder / _record_name(number)
    try:
        record = _RECORD.validate_json(read_file(path, LARGEST_RECORD, "expected the record of a chunk"))
        if (record.job, record.number, set(record.dropped)) != (identity(job), number, set(job.causes)):
            return None
        entry = record.entry
        if entry is None:
            return record
        if entry.file != chunk_name(number) or not set(entry.designs) <= set(designs):
            return None
        with open_file(folder / entry.file, "expected a chunk of the dataset") as file:
            whole = hashlib.file_digest(file, "sha256").hexdigest() == entry.sha256
    except (OSError, DataError, ValidationError):
        return None
    return record if whole else None


def stored_description(folder: Path, system: str) -> dict[str, JsonValue] | None:
    """The entries of the system file that a folder's job was begun with; None if with another, or none."""
    try:
        job = _JOB.validate_json(read_file(folder / JOB, LARGEST_JOB, "expected a dataset's job"))
    except (DataError, ValidationError):
        return None
    return job.description if job.config.system == system else None


def write_record(folder: Path, record: ChunkRecord) -> None:
    """Say that a chunk is whole, after its file."""
    replace_file(folder / _record_name(record.number), _to_text(record))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock, which the system frees whatever ends this process."""
    try:
        lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise DataError(f"{folder}: cannot be written ({error.strerror}); name another folder") from error
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DataError(
                f"{folder}: another process is working on it; wait until it is done, or stop it"
            ) from None
        except OSError as error:
            raise DataError(
                f"{folder}: cannot be locked ({error.strerror}); name a folder on a file system with locks"
            ) from error
        yield
    finally:
        os.close(lock)


def _check_same(path: Path, job: Job) -> None:
    """Raise unless a job's file says what this job is."""
    content = read_file(path, LARGEST_JOB, "it is not the file of a job; name a new folder")
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or "exosight_version" not in found:
        raise DataError(f"{path}: damaged, it is not the file of a job; name a new folder")
    wanted = json.loads(_to_text(job))
    for key in ("exosight_version", "format"):
        if found.get(key) != wanted[key]:
            raise InputError(
                f"{path.parent}: begun by exosight {found['exosight_version']!s:.20} with format "
                f"{found.get('format')!s:.20}, this is {__version__} with format {FORMAT}; go on with that "
                "version, or name a new folder"
            )
    if difference := first_difference(found, wanted):
        name, there, here = difference
        raise InputError(
            f"{path.parent}: holds the dataset of another configuration ({name:.40} {there!s:.40} there, "
            f"{here!s:.40} here); give the same options, or name a new folder"
        )


def _is_ours(path: Path) -> bool:
    """Whether a file is one that a process may leave which was killed before it wrote the job's."""
    return path.name == LOCK or path.match(".*.part")


def _record_name(number: int) -> str:
    return chunk_name(number).replace(".h5", ".json")


def _to_text(values: Any) -> bytes:
    return json.dumps(TypeAdapter(type(values)).dump_python(values, mode="json"), indent=1).encode() + b"\n"
