"""Tables of LeRobot datasets: the description of their features, and what Parquet files say of each frame."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float64, Int64
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from exosight.errors import DataError, InputError
from exosight.files import read_file
from exosight.rig.table import ReadingTable, column_of, short_heading
from exosight.validation import check_unique, first_fault
from exosight.vision.pictures import natural_order

PLACES = ("timestamp", "frame_index", "episode_index", "index", "task_index")
"""Features that say where a frame stands, and are no readings."""

_LARGEST_INFO = 16 * 2**20  # bytes
_MOST_FRAMES = 2_000_000
_MOST_VALUES = 64  # of one feature
_LARGEST_INDEX = 10**9


@checked(frozen=True)
class Feature:
    """What one entry of each frame is."""

    dtype: str
    shape: tuple[Annotated[int, Field(ge=0)], ...]
    names: Any = None

    @property
    def count(self) -> int:
        """Numbers a frame."""
        return math.prod(self.shape)

    @property
    def called(self) -> list[str]:
        """What each number is called: as the file says, else numbers from 0; nothing where there is one."""
        names = self.names
        if isinstance(names, dict) and len(names) == 1:
            (names,) = names.values()
        if self.count > 1 and isinstance(names, list) and len(names) == self.count:
            return [str(name) for name in names]
        return [""] if self.count == 1 else [str(k) for k in range(self.count)]


@checked(frozen=True)
class Info:
    """The description of a dataset, `meta/info.json`; of all else in it nothing is needed."""

    codebase_version: str
    fps: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    features: dict[str, Feature]
    chunks_size: Annotated[int, Field(ge=1)] = 1000

    @property
    def major(self) -> int:
        """2 or 3; 0 for other versions."""
        return next((k for k in (2, 3) if self.codebase_version.startswith(f"v{k}.")), 0)


def read_info(path: Path) -> Info:
    """The description of a dataset.

    Raises DataError if it is none; InputError for another version than 2 and 3.
    """
    try:
        info = TypeAdapter(Info).validate_json(read_file(path, _LARGEST_INFO, "expected info.json"))
    except ValidationError as error:
        raise DataError(f"{path}: no description of a LeRobot dataset: {first_fault(error)}") from None
    if not info.major:
        raise InputError(
            f"{path}: expected a LeRobot dataset of version 2 or 3, got {info.codebase_version[:16]!r}; "
            "convert it with lerobot"
        )
    return info


@dataclass(frozen=True)
class DatasetFrames:
    """Every frame, episode after episode.

    files     Parquet files
    file      which of them a frame is in
    row       its place there
    numbers   (frames, values) of each feature with readings
    """

    files: tuple[Path, ...]
    file: Int64[np.ndarray, " frames"]
    row: Int64[np.ndarray, " frames"]
    episode: Int64[np.ndarray, " frames"]
    frame: Int64[np.ndarray, " frames"]
    time: Float64[np.ndarray, " frames"]
    """since the episode began [s]"""
    numbers: dict[str, Float64[np.ndarray, "frames values"]]


def read_frames_of(root: Path, info: Info) -> DatasetFrames:
    """Every frame of a dataset; DataError for files that cannot be read or lack a feature."""
    files = parquet_files(root / "data")
    readings = [
        name
        for name, feature in info.features.items()
        if name not in PLACES
        and feature.dtype.startswith(("float", "int"))
        and 1 <= feature.count <= _MOST_VALUES
    ]
    counts = {"episode_index": 1, "frame_index": 1, "timestamp": 1}
    counts |= {name: info.features[name].count for name in readings}
    parts = read_columns(files, counts)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in counts}
    sizes = [len(part["timestamp"]) for part in parts]
    if not sum(sizes):
        raise DataError(f"{root / 'data'}: expected frames, got none")
    episode, frame = (whole(columns[name], files[0], name) for name in ("episode_index", "frame_index"))
    time = finite(columns["timestamp"], files[0], "timestamp")
    order = np.lexsort((frame, episode))
    return DatasetFrames(
        files,
        np.repeat(np.arange(len(files)), sizes)[order],
        np.concatenate([np.arange(size) for size in sizes])[order],
        episode[order],
        frame[order],
        time[order],
        {name: columns[name][order] for name in readings},
    )


def parquet_files(folder: Path) -> tuple[Path, ...]:
    """The Parquet files of all chunks in a folder by their names; DataError if there are none."""
    found = sorted(folder.glob("*/*.parquet"), key=lambda path: natural_order(path.as_posix()))
    if not found:
        raise DataError(f"{folder}: expected chunk-000 and others with Parquet files, got none")
    return tuple(found)


def read_columns(files: Sequence[Path], counts: dict[str, int]) -> list[dict[str, np.ndarray]]:
    """Some columns of each file, (rows, numbers a row); NaN where there is none."""
    import pyarrow.parquet as parquet

    parts, total = [], 0
    for path in files:
        with readable(path), parquet.ParquetFile(path) as file:
            total += file.metadata.num_rows
            if total > _MOST_FRAMES:
                raise InputError(f"{path}: more than {_MOST_FRAMES} frames; import fewer episodes at once")
            missing = [name for name in counts if name not in file.schema_arrow.names]
            if missing:
                raise DataError(f"{path}: expected a column {missing[0]}, as meta/ says, got none")
            table = file.read(columns=list(counts))
            parts.append({name: _numbers(table[name], count) for name, count in counts.items()})
    return parts


def _numbers(column: Any, count: int) -> np.ndarray:
    """The numbers of a column, (rows, numbers a row); ValueError for rows of another length."""
    rows, values = len(column), column.combine_chunks()
    while hasattr(values.type, "value_type"):  # a list of lists, for features of several dimensions
        # Lists of one length by their type have no offsets.
        lengths = np.diff(values.offsets.to_numpy()) if hasattr(values, "offsets") else np.zeros(1)
        if values.null_count or len(np.unique(lengths)) > 1:
            raise ValueError("rows of several lengths")
        values = values.flatten()
    return np.asarray(values.to_numpy(zero_copy_only=False), np.float64).reshape(rows, count)


def whole(column: np.ndarray, path: Path, name: str) -> Int64[np.ndarray, " rows"]:
    """Whole numbers from 0; DataError for others."""
    found = column[:, 0]
    if not np.all((found >= 0) & (found < _LARGEST_INDEX) & (found == np.rint(found))):
        raise DataError(f"{path}: expected whole numbers from 0 as {name}, got others")
    return found.astype(np.int64)


def finite(column: np.ndarray, path: Path, name: str) -> Float64[np.ndarray, " rows"]:
    """Numbers; DataError where there is none."""
    found = column[:, 0]
    if not np.isfinite(found).all():
        raise DataError(f"{path}: expected a number in each row as {name}, got none in some")
    return found


def reading_table(root: Path, info: Info, frames: DatasetFrames) -> ReadingTable:
    """A row a frame: its episode, its time, and the numbers of each feature."""
    episodes = (f"episode {episode}" for episode in frames.episode.tolist())
    columns = [column_of("episode", episodes), column_of("time [s]", map(repr, frames.time.tolist()))]
    for name, values in frames.numbers.items():
        parts = [part for part in name.removeprefix("observation.").split(".") if part]
        for called, cells in zip(info.features[name].called, values.T.tolist(), strict=True):
            columns.append(column_of(short_heading(parts, called), map(repr, cells)))
    check_unique("columns", (column.name for column in columns))
    return ReadingTable(str(root), tuple(columns))


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Whatever fails within is a DataError that names the file."""
    try:
        yield
    except (DataError, InputError, MemoryError):
        raise
    except Exception as error:  # the libraries fail in many ways on what is cut short
        raise DataError(
            f"{path}: cannot be read as part of a LeRobot dataset, or truncated ({type(error).__name__})"
        ) from error
