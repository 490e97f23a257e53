"""LeRobot datasets, versions 2.0 to 3.x: readings in Parquet files, pictures beside them or in videos.

`meta/info.json` describes the features of each frame. Version 2 has a Parquet file and a video an episode,
version 3 several episodes in each, and `meta/episodes` says from when on a video shows which
(huggingface.co/docs/lerobot, LeRobotDataset v3.0). The files' places are those of the format, whatever the
templates in `info.json` say.
"""

import hashlib
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float64, Int64

from exosight.errors import DataError, InputError
from exosight.files import open_file
from exosight.rig.lerobot_tables import (
    DatasetFrames,
    Info,
    finite,
    parquet_files,
    read_columns,
    read_frames_of,
    read_info,
    readable,
    reading_table,
    whole,
)
from exosight.rig.pictures import Gray, upper_bits
from exosight.rig.table import ReadingTable
from exosight.vision.pictures import LARGEST_PICTURE, decode

INFO = "meta/info.json"
"""What makes a folder a LeRobot dataset."""
_BATCH = 16  # pictures of a Parquet file that are in memory together

Decode = Callable[[], Gray]


def is_lerobot(source: Path) -> bool:
    """Whether a path is a LeRobot dataset."""
    return (source / INFO).is_file()


@contextmanager
def open_lerobot(
    root: Path, feature: str | None, *, own_table: bool = True
) -> Iterator[tuple["LeRobotPictures", ReadingTable | None]]:
    """The pictures of one feature, and a table with a row for each, unless another is given.

    feature   with the pictures, such as observation.images.side; None: the only one

    Raises DataError for a dataset that cannot be read or that lacks a file; InputError for another version,
    or several features with pictures of which none is named.
    """
    try:
        import av  # noqa: F401
        import pyarrow  # noqa: F401
    except ModuleNotFoundError as error:
        raise InputError(
            f"{root}: LeRobot datasets need {error.name}, which is not installed: pip install "
            "'exosight[lerobot]'"
        ) from error
    info = read_info(root / INFO)
    chosen = _picture_feature(root, info, feature)
    frames = read_frames_of(root, info)
    with closing(_pictures(root, info, chosen, frames)) as pictures:
        yield pictures, reading_table(root, info, frames) if own_table else None


def _picture_feature(root: Path, info: Info, asked: str | None) -> str:
    found = [name for name, feature in info.features.items() if feature.dtype in ("video", "image")]
    shown = ", ".join(found) or "none"
    if asked is not None and asked not in found:
        raise InputError(f"--images: expected a feature with pictures, {shown}, got {asked}")
    if asked is None and len(found) != 1:
        raise InputError(
            f"{root}: expected one feature with pictures, got {shown}"
            + ("; choose one with --images" if found else "")
        )
    return asked or found[0]


@dataclass
class LeRobotPictures:
    """The pictures of one feature, episode after episode.

    files   videos or Parquet files
    file    which of them holds each picture
    at      its time there [s], or its row
    near    how far from there it may be found
    stream  the pictures of a file, each with where it is, in rising order
    """

    names: tuple[str, ...]
    folders: tuple[str, ...]
    fingerprint: str
    files: Sequence[Path]
    file: Int64[np.ndarray, " pictures"]
    at: Float64[np.ndarray, " pictures"]
    near: float
    stream: Callable[[Path], Generator[tuple[float, Decode]]]
    notes: list[str] = field(default_factory=list)
    times = None
    time_unit = None

    def __post_init__(self) -> None:
        self._opened: int | None = None
        self._stream: Generator[tuple[float, Decode]] | None = None
        self._last: tuple[float, Decode] | None = None

    def picture(self, place: int) -> Gray:
        """A picture; those before it in its file are passed over."""
        file, at = int(self.file[place]), float(self.at[place])
        if self._stream is None or file != self._opened or (self._last and at < self._last[0] - self.near):
            self.close()
            self._opened, self._stream = file, self.stream(self.files[file])
        while self._last is None or self._last[0] < at - self.near:
            self._last = next(self._stream, None)
            if self._last is None:
                self.close()
                raise DataError(f"{self.names[place]}: not in {self.files[file]}, which ends before it")
        reached, decoded = self._last
        if reached > at + self.near:
            raise DataError(
                f"{self.names[place]}: expected it at {at:.6g} s in {self.files[file]}, the next picture is "
                f"at {reached:.6g} s"
            )
        return decoded()

    def close(self) -> None:
        """Release the file."""
        if self._stream is not None:
            self._stream.close()
        self._opened = self._stream = self._last = None


def _pictures(root: Path, info: Info, key: str, frames: DatasetFrames) -> LeRobotPictures:
    numbers = zip(frames.episode.tolist(), frames.frame.tolist(), strict=True)
    names = tuple(f"episode {episode}, frame {frame}" for episode, frame in numbers)
    if info.features[key].dtype == "image":
        files, file, at, near = frames.files, frames.file, frames.row.astype(float), 0.5
        stream = _stored(key)
    else:
        files, file, at = _shown(root, info, key, frames)
        near, stream = 0.5 / info.fps, _video
    digest = hashlib.sha256(key.encode())
    for values in (frames.episode, frames.frame, frames.time):
        digest.update(values.tobytes())
    for path in files:
        if not path.is_file():
            raise DataError(f"{path}: not there; expected the pictures {key}, as {root / INFO} says")
        digest.update(f"{path.relative_to(root)} {path.stat().st_size}".encode())
    folders = tuple(f"episode {episode}" for episode in frames.episode.tolist())
    return LeRobotPictures(names, folders, digest.hexdigest(), files, file, at, near, stream)


def _shown(
    root: Path, info: Info, key: str, frames: DatasetFrames
) -> tuple[list[Path], Int64[np.ndarray, " frames"], Float64[np.ndarray, " frames"]]:
    """Videos, which of them shows each frame, and when [s]."""
    if not key or key in (".", "..") or set(key) & {"/", "\\", "\0"}:
        raise DataError(f"{root / INFO}: expected a name of a folder in videos, got {key[:64]!r}")
    episodes, own = np.unique(frames.episode, return_inverse=True)
    if info.major == 2:
        chunks = episodes // info.chunks_size
        pairs = zip(chunks.tolist(), episodes.tolist(), strict=True)
        places = [f"chunk-{chunk:03d}/{key}/episode_{episode:06d}.mp4" for chunk, episode in pairs]
        start = np.zeros(len(episodes))
    else:
        fields = [f"videos/{key}/{name}" for name in ("chunk_index", "file_index", "from_timestamp")]
        said = _episodes(root, ["episode_index", *fields])
        missing = np.setdiff1d(episodes, said[0])
        if len(missing):
            raise DataError(f"{root / 'meta' / 'episodes'}: expected episode {missing[0]}, got none of that")
        _, first = np.unique(said[0], return_index=True)
        _, chunk, number, start = (values[first][np.isin(said[0][first], episodes)] for values in said)
        pairs = zip(chunk.tolist(), number.tolist(), strict=True)
        places = [f"{key}/chunk-{chunk:03d}/file-{file:03d}.mp4" for chunk, file in pairs]
    files = list(dict.fromkeys(places))
    of = {place: k for k, place in enumerate(files)}
    number = np.array([of[place] for place in places])
    return [root / "videos" / place for place in files], number[own], start[own] + frames.time


def _episodes(root: Path, fields: list[str]) -> list[np.ndarray]:
    """Columns of `meta/episodes`: whole numbers, the last one times [s]."""
    files = parquet_files(root / "meta" / "episodes")
    parts = read_columns(files, dict.fromkeys(fields, 1))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in fields}
    *numbers, times = fields
    return [
        *(whole(columns[name], files[0], name) for name in numbers),
        finite(columns[times], files[0], times),
    ]


def _stored(key: str) -> Callable[[Path], Generator[tuple[float, Decode]]]:
    """The pictures in a column of a Parquet file, by row."""
    import pyarrow.parquet as parquet

    def stream(path: Path) -> Generator[tuple[float, Decode]]:
        row = 0
        with readable(path), parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(_BATCH, columns=[key]):
                for entry in batch.column(0):
                    data = entry["bytes"].as_py()
                    if data is None:
                        raise DataError(f"{path}: row {row + 1} holds no picture of {key}, but a path")
                    yield float(row), partial(_decoded, data, f"{path}, row {row + 1}")
                    row += 1

    return stream


def _decoded(data: bytes, name: str) -> Gray:
    found = decode(data, name)
    return upper_bits(found.gray, name) if found.deep else found.gray


def _video(path: Path) -> Generator[tuple[float, Decode]]:
    """The frames of a video by time [s]; most are in AV1, which OpenCV's FFmpeg does not decode."""
    import av

    # MP4 alone, from an open file: FFmpeg also takes playlists, which lead to other files and hosts.
    with (
        readable(path),
        open_file(path, "expected a video") as file,
        av.open(file, "r", format="mp4") as video,
    ):
        (shown, *_) = video.streams.video
        if shown.width * shown.height > LARGEST_PICTURE:
            raise DataError(
                f"{path}: {shown.width}×{shown.height} pixels, up to {LARGEST_PICTURE // 10**6} million "
                "are read"
            )
        for frame in video.decode(shown):
            if frame.time is None:
                raise DataError(f"{path}: expected a time with each frame, got none")
            yield frame.time, partial(_gray, frame)


def _gray(frame: Any) -> Gray:
    return cv2.cvtColor(frame.to_ndarray(format="bgr24"), cv2.COLOR_BGR2GRAY)
