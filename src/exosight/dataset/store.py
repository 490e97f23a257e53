"""Frames on disk: a folder of HDF5 chunks, each written whole by one process, and a manifest written last."""

import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

import h5py
import numpy as np
from jaxtyping import Float32

from exosight import __version__
from exosight.dataset.frames import QUANTITIES, Columns, Frames, find_fault, row_shapes
from exosight.dataset.manifest import FORMAT, MANIFEST, ChunkEntry, check_size, read_manifest
from exosight.errors import DataError, InputError
from exosight.files import read_file, replace_file
from exosight.hdf5 import group, opened, whole_array
from exosight.system.design import Design

VARIATION = "variation"
"""Group of a chunk file with what was drawn for each frame, if anything varies."""

_MOST_VARIATIONS = 1000
_ANY = 127  # families or scenarios; the manifest, which is written last, says how many there are


def write_chunk(folder: Path, index: int, frames: Frames, variation: Columns | None = None) -> ChunkEntry:
    """Write the frames of some designs as one chunk file, and return its entry for the manifest.

    folder     an existing folder without a manifest
    index      number of the chunk in the dataset, 0, 1, 2 …
    variation  what was drawn for each frame

    With the same libraries, equal frames give an equal file, byte for byte. Any number of processes may write
    chunks; a chunk that is there, damaged or not, is replaced as a whole.

    Raises InputError if the frames are none or unfit for use, DataError if the dataset is complete or the
    file cannot be written.
    """
    fault = "there are none" if len(frames) == 0 else find_fault(frames, _ANY, _ANY)
    if fault:
        raise InputError(f"frames of chunk {index}: {fault}")
    if (folder / MANIFEST).exists():
        raise DataError(f"{folder}: this dataset is complete; write the chunk to a new folder")
    content = _encode(frames, variation or {})
    replace_file(folder / chunk_name(index), content)
    return ChunkEntry(
        file=chunk_name(index),
        sha256=hashlib.sha256(content).hexdigest(),
        bytes=len(content),
        frames=len(frames),
        designs=tuple(np.unique(frames.design).tolist()),
    )


def chunk_name(index: int) -> str:
    """File of a chunk within the folder."""
    return f"chunk_{index:04d}.h5"


def read_frames(folder: Path) -> Frames:
    """All frames of a complete dataset, in memory, in the order of its chunks.

    Raises DataError if the dataset is missing or incomplete, if a chunk is missing, truncated or altered, or
    if what it holds contradicts the manifest.
    """
    manifest = read_manifest(folder)
    rows = row_shapes(manifest.schema, manifest.dofs)
    # Pages are touched as they are filled: a chunk that holds less fails before it costs memory.
    frames = Frames(
        manifest.schema,
        **{
            name: np.empty((manifest.frames, *rows.get(name, ())), quantity.dtype)
            for name, quantity in QUANTITIES.items()
        },
    )
    designs = {design.number: design for design in manifest.designs}
    start = 0
    for chunk in manifest.chunks:
        stop = start + chunk.frames
        part = Frames(manifest.schema, **{name: getattr(frames, name)[start:stop] for name in QUANTITIES})
        _read_chunk(folder / chunk.file, chunk, part)
        fault = find_fault(part, len(manifest.families), len(manifest.scenarios))
        fault = fault or _find_mislabelled(part, chunk, designs)
        if fault:
            raise DataError(f"{folder / chunk.file}: {fault}")
        start = stop
    return frames


def read_variation(folder: Path) -> Columns:
    """What was drawn for each frame of a complete dataset, by name, in the order of `read_frames`.

    Empty for a dataset in which nothing varies; `exosight.dataset.variation` says what the names mean.

    Raises DataError as `read_frames`, or if its chunks hold different names.
    """
    parts: list[Columns] = []
    for chunk in read_manifest(folder).chunks:
        path = folder / chunk.file
        with _opened(path, chunk) as file:
            names = sorted(map(str, group(file, VARIATION))) if file.get(VARIATION, getlink=True) else []
            if len(names) > _MOST_VARIATIONS:
                raise DataError(
                    f"{path}: {len(names)} quantities vary in it, up to {_MOST_VARIATIONS} are read"
                )
            part = {name: np.empty(chunk.frames) for name in names}
            for name, values in part.items():
                _fill(values, f"{VARIATION}/{name}", file)
        if parts and part.keys() != parts[0].keys():
            raise DataError(f"{path}: other quantities vary in it than in the chunks before")
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def read_sensors(folder: Path) -> Float32[np.ndarray, "frames sensors"]:
    """What every sensor reads in each frame of a complete dataset, without its images.

    Raises DataError as `read_frames`.
    """
    manifest = read_manifest(folder)
    readings = np.empty((manifest.frames, *row_shapes(manifest.schema, manifest.dofs)["sensors"]), np.float32)
    start = 0
    for chunk in manifest.chunks:
        with _opened(folder / chunk.file, chunk) as file:
            _fill(readings[start : start + chunk.frames], "sensors", file)
        start += chunk.frames
    return readings


def _encode(frames: Frames, variation: Columns) -> bytes:
    """The frames as the bytes of an HDF5 file: made in memory, so a full disk meets plain file writing.

    Where HDF5 puts an array depends on when those before it are flushed: unasked, when they are closed, which
    is late if another thread (the profiler of a Dask worker) holds on to them. So each is flushed when made.
    """
    unique = f"chunk {uuid4()}"  # HDF5 takes files of one name for one, in memory too
    with h5py.File(unique, "w", driver="core", backing_store=False) as file:
        file.attrs["format"] = FORMAT
        file.attrs["exosight_version"] = __version__
        for name, quantity in QUANTITIES.items():
            values = getattr(frames, name)
            # One image a block: a random frame costs one small read. Level 4 is 5 % smaller, 40 % slower.
            options = {"chunks": (1, *values.shape[1:]), "compression": 1} if name == "images" else {}
            data = file.create_dataset(name, data=values, track_times=False, **options)
            data.attrs["unit"] = quantity.unit
            data.attrs["meaning"] = quantity.meaning
            file.flush()
        for name, values in variation.items():
            file.create_dataset(f"{VARIATION}/{name}", data=values, track_times=False, compression=1)
            file.flush()
        return file.id.get_file_image()


def _read_chunk(path: Path, chunk: ChunkEntry, rows: Frames) -> None:
    """Fill the rows with the frames of one chunk file."""
    with _opened(path, chunk) as file:
        for name in QUANTITIES:
            _fill(getattr(rows, name), name, file)


@contextmanager
def _opened(path: Path, chunk: ChunkEntry) -> Iterator[h5py.File]:
    """A chunk file, whose checksum must be right, and whatever goes wrong with what it holds as DataError."""
    check_size(path, chunk)
    content = read_file(path, chunk.bytes, "expected a chunk of frames")
    if hashlib.sha256(content).hexdigest() != chunk.sha256:
        raise DataError(f"{path}: altered, its checksum is not that of the manifest")
    with opened(io.BytesIO(content), path, "a chunk of frames") as file:
        yield file


def _fill(rows: np.ndarray, name: str, file: h5py.File) -> None:
    whole_array(file, name, rows.dtype, rows.shape).read_direct(rows)


def _find_mislabelled(frames: Frames, chunk: ChunkEntry, designs: dict[int, Design]) -> str | None:
    """The first design whose frames disagree with the manifest, in words, or None."""
    if tuple(np.unique(frames.design).tolist()) != chunk.designs:
        return "it holds other designs than the manifest says"
    for number in chunk.designs:
        if number not in designs:
            return f"the manifest lists no design {number}"
        mine, listed = frames.design == number, designs[number]
        if np.any(frames.family[mine] != listed.family) or np.any(frames.scenario[mine] != listed.scenario):
            return f"frames of design {number} carry another family or scenario than the manifest gives it"
    return None
