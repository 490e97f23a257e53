"""A run of the loop in real time as one HDF5 file, and the same frames through network and guard once more.

It is written and flushed a second at a time, in HDF5's oldest layout, which keeps no mark of being open. So
it can be read after the writing process was killed, and then ends with the last whole second.
"""

import hashlib
import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Bool, Float, Float32, Int8, UInt8
from pydantic import TypeAdapter, ValidationError

from exosight import __version__
from exosight.control.estimator import Reading, read_one
from exosight.control.guard import GuardConfig, Guarded, Measurement, State
from exosight.control.paths import ControllerConfig, ForcePath
from exosight.control.realtime import STAGES, Step
from exosight.control.scheduled import Scheduled
from exosight.errors import DataError, InputError

FORMAT = "exosight recording 1"
STATES = tuple(State)
"""A state is stored as its place in here."""

_CAUSE = "S160"
_HEAD = 2**18  # bytes: more than the controller's paths take, or what HDF5 adds to a second of steps
_GUARD = TypeAdapter(GuardConfig)
_ARRAYS = ("u", "forces", "snapped")
_NUMBERS = ("rate", "period", "smallest_gain", "largest_gain")

COLUMNS = {
    "time": ("f8", (), "s", "since the first step began"),
    "target": ("f8", (), "N", "F_t"),
    "u": ("f8", (), "N", "actuation asked for"),
    "u_reported": ("f8", (), "N", "actuation that the plant reported with the frame; NaN: none"),
    "age": ("f8", (), "s", "of the frame when it was acted on"),
    "seen": ("?", (), "", "a frame came"),
    "estimated": ("?", (), "", "the network answered"),
    "forces": ("f4", (7,), "N", "estimate, C1 to C7"),
    "low": ("f4", (7,), "N", "lower ends of their intervals"),
    "high": ("f4", (7,), "N", "upper ends"),
    "contact": ("f4", (7,), "-", "probabilities of contact"),
    "ood_score": ("f4", (), "-", "score of an out-of-distribution image; trusted up to 1"),
    "forces_true": ("f8", (7,), "N", "true forces, C1 to C7; NaN: nobody knows"),
    "state": ("i1", (), "", "of the guard: " + ", ".join(f"{i} {s.value}" for i, s in enumerate(STATES))),
    "cause": (_CAUSE, (), "", "of a change of state in this step"),
    "seconds": ("f8", (len(STAGES),), "s", "that these took: " + ", ".join(STAGES)),
    "late": ("f8", (), "s", "how long after its time the step began"),
}
"""Name: type, shape of a row, unit, meaning. Beside them: `images`, gray 0…255, black where none came."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What a file holds: a row a step; see `COLUMNS` for units and meanings.

    model       SHA-256 of the network's file
    controller  what the law knew of the exosuit
    guard       what was trusted
    """

    model: str
    controller: ControllerConfig
    guard: GuardConfig
    images: UInt8[np.ndarray, "steps height width"]
    time: Float[np.ndarray, " steps"]
    target: Float[np.ndarray, " steps"]
    u: Float[np.ndarray, " steps"]
    u_reported: Float[np.ndarray, " steps"]
    age: Float[np.ndarray, " steps"]
    seen: Bool[np.ndarray, " steps"]
    estimated: Bool[np.ndarray, " steps"]
    forces: Float32[np.ndarray, "steps 7"]
    low: Float32[np.ndarray, "steps 7"]
    high: Float32[np.ndarray, "steps 7"]
    contact: Float32[np.ndarray, "steps 7"]
    ood_score: Float32[np.ndarray, " steps"]
    forces_true: Float[np.ndarray, "steps 7"]
    state: Int8[np.ndarray, " steps"]
    cause: np.ndarray
    seconds: Float[np.ndarray, "steps 4"]
    late: Float[np.ndarray, " steps"]

    def __len__(self) -> int:
        return len(self.time)


class Recorder:
    """Writes steps to a new file; pass `append` to `run_live`, and close it at the end.

    path    of the new file
    shape   (height, width) of the pictures
    guarded the controller
    model   the network's file

    Raises DataError if the file exists or cannot be written.
    """

    def __init__(self, path: Path, shape: tuple[int, int], guarded: Guarded, model: Path) -> None:
        self._path, self._shape, self._rows = path, shape, []
        self._block = max(1, round(1 / guarded.config.period))
        with _told(path):
            try:
                path.open("xb").close()
            except FileExistsError as error:
                raise DataError(f"{path}: exists already; name a new file, nothing is overwritten") from error
            _reserve(path, 0, _HEAD)
            self._file = h5py.File(path, "w", libver=("earliest", "v110"))
            _reserve(path, 0, _HEAD)
            _write_head(self._file, guarded, model, shape, self._block)
            self._file.flush()

    def append(self, step: Step) -> None:
        """Take note of a step; once a second, all of them are written.

        Raises DataError if they cannot be, for instance because the disk is full.
        """
        self._rows.append(_row(step, self._shape))
        if len(self._rows) >= self._block:
            self._write()

    def close(self) -> None:
        """Write what is left, and close the file; DataError if that fails."""
        try:
            if self._rows:
                self._write()
        finally:
            with _told(self._path):
                self._file.close()

    def _write(self) -> None:
        rows, self._rows = self._rows, []  # what could not be written once is not tried again
        with _told(self._path):
            _reserve(self._path, self._file.id.get_filesize(), _HEAD + 2 * len(rows) * math.prod(self._shape))
            for name in ("images", *COLUMNS):
                data: Any = self._file[name]
                data.resize(len(data) + len(rows), axis=0)
                data[-len(rows) :] = np.stack([row[name] for row in rows])
            self._file.flush()


def _reserve(path: Path, start: int, room: int) -> None:
    """Fill the file with zeros beyond what HDF5 uses, which it will use next.

    HDF5 loses its head when a disk is full, and takes the process with it; plain writing fails in good order.
    """
    with path.open("r+b") as file:
        file.seek(start)
        file.write(bytes(room))


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Whatever HDF5 complains about, as one sentence."""
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, DataError):
            raise
        what = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise DataError(f"{path}: cannot be written ({what}); name a file where there is room") from error


def read_recording(path: Path) -> Recording:
    """A recording in memory; DataError if the file is missing, damaged or of another kind."""
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise DataError(f"{path}: not a recording of exosight; expected a file that it recorded")
            values = {name: _column(file, name) for name in ("images", *COLUMNS)}
            # A process killed while it wrote leaves some columns longer than others.
            steps = min(len(column) for column in values.values())
            head = str(file.attrs["model"]), *_controller(file)
    except FileNotFoundError as error:
        raise DataError(f"{path}: not found; expected a recording of exosight") from error
    except DataError:
        raise
    except (OSError, KeyError, RuntimeError, ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: damaged, or not a recording of exosight ({error})") from error
    if steps == 0:
        raise DataError(f"{path}: holds no step; it was stopped within its first second")
    return Recording(*head, **{name: column[:steps] for name, column in values.items()})


@dataclass(frozen=True, eq=False)
class Replay:
    """A recording's frames through network and guard once more.

    Rows without an estimate hold zeros, as those of the recording do.
    """

    forces: Float32[np.ndarray, "steps 7"]
    """of the network on C1…C7 [N]"""
    u: Float[np.ndarray, " steps"]
    """actuation that would be asked for [N], were the next frames the same"""
    state: Int8[np.ndarray, " steps"]
    """of the guard"""


def replay(recording: Recording, read: Callable[[UInt8[np.ndarray, "1 height width"]], Reading]) -> Replay:
    """What network and guard answer to the frames of a recording: with the same network, the same again.

    read   `OnnxEstimator.read` of the same network, or of another one to compare

    Raises InputError if the network takes pictures of another size.
    """
    guarded = Guarded(Scheduled(recording.controller), recording.guard)
    forces, u, state = np.zeros_like(recording.forces), np.zeros(len(recording)), recording.state.copy()
    for i in range(len(recording)):
        measurement = Measurement()
        if recording.seen[i]:
            reading = read_one(read, recording.images[i])
            if reading is not None:
                forces[i] = reading.forces[0]
            reported = float(recording.u_reported[i])
            measurement = Measurement(
                recording.images[i],
                reading,
                float(recording.age[i]),
                None if np.isnan(reported) else reported,
            )
        u[i] = guarded.step(float(recording.target[i]), measurement)
        state[i] = STATES.index(guarded.state)
    return Replay(forces, u, state)


def checksum(model: Path) -> str:
    """SHA-256 of a network's file, by which a recording knows it."""
    return hashlib.sha256(model.read_bytes()).hexdigest()


def _write_head(file: h5py.File, guarded: Guarded, model: Path, shape: tuple[int, int], block: int) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["exosight_version"] = __version__
    file.attrs["model"] = checksum(model)
    file.attrs["guard"] = json.dumps(_GUARD.dump_python(guarded.guard))
    for name, (kind, row, unit, meaning) in COLUMNS.items():
        data = file.create_dataset(name, (0, *row), kind, chunks=(block, *row), maxshape=(None, *row))
        data.attrs["unit"], data.attrs["meaning"] = unit, meaning
    file.create_dataset(
        "images", (0, *shape), "u1", chunks=(1, *shape), maxshape=(None, *shape), compression=1
    )
    config = guarded.config
    group = file.create_group("controller")
    group["contact_limit"] = config.contact_limit
    for name in _NUMBERS:
        group[name] = getattr(config, name)
    for path in ("loading", "unloading"):
        for name in _ARRAYS:
            group[f"{path}/{name}"] = getattr(getattr(config, path), name)


def _controller(file: h5py.File) -> tuple[ControllerConfig, GuardConfig]:
    group: Any = file["controller"]

    def path(name: str) -> ForcePath:
        return ForcePath(**{part: np.asarray(group[f"{name}/{part}"][()]) for part in _ARRAYS})

    try:
        config = ControllerConfig(
            loading=path("loading"),
            unloading=path("unloading"),
            contact_limit=np.asarray(group["contact_limit"][()]),
            **{name: float(group[name][()]) for name in _NUMBERS},
        )
        guard = _GUARD.validate_python(json.loads(str(file.attrs["guard"])))
    except (InputError, ValidationError) as error:
        raise ValueError(str(error)) from error
    return config, guard


def _column(file: h5py.File, name: str) -> np.ndarray:
    data = file[name]
    if not isinstance(data, h5py.Dataset) or data.external or data.is_virtual:
        raise ValueError(f"{name} is not an array of this file")
    if name in COLUMNS:
        kind, row = COLUMNS[name][:2]
        if data.dtype != np.dtype(kind) or data.shape[1:] != row:
            raise ValueError(f"{name} expects {kind} {row}, got {data.dtype} {data.shape[1:]}")
    elif data.dtype != np.uint8 or data.ndim != 3:
        raise ValueError(f"{name} expects uint8 pictures, got {data.dtype} {data.shape}")
    return data[()]


def _row(step: Step, shape: tuple[int, int]) -> dict[str, Any]:
    measurement, reading = step.measurement, step.measurement.reading
    nothing = np.zeros(7, np.float32)
    unknown = np.full(7, np.nan)
    return {
        "images": np.zeros(shape, np.uint8) if measurement.image is None else measurement.image,
        "time": step.time,
        "target": step.target,
        "u": step.u,
        "u_reported": np.nan if measurement.u is None else measurement.u,
        "age": measurement.age,
        "seen": measurement.image is not None,
        "estimated": reading is not None,
        "forces": nothing if reading is None else reading.forces[0],
        "low": nothing if reading is None else reading.low[0],
        "high": nothing if reading is None else reading.high[0],
        "contact": nothing if reading is None else reading.contact[0],
        "ood_score": 0.0 if reading is None else reading.ood_score[0],
        "forces_true": unknown if step.forces is None else step.forces,
        "state": STATES.index(step.state),
        "cause": step.cause.encode()[:160],
        "seconds": step.seconds,
        "late": step.late,
    }
