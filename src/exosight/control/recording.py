"""A run of the loop in real time as one HDF5 file.

It is written and flushed a second at a time, in the order that HDF5 keeps for readers beside a writer (SWMR):
at any moment the file is whole up to the last flushed second, and so it stays when the process is killed.
Only the mark of being open stays in its head, which other programs want to have removed (h5clear -s).
"""

import hashlib
import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from jaxtyping import Bool, Float, Float32, Int8, Int32, UInt8
from pydantic import TypeAdapter, ValidationError

from exosight import __version__
from exosight.control.adaptive import Adaptive, AdaptiveConfig
from exosight.control.guard import GuardConfig, Guarded, State
from exosight.control.paths import ControllerConfig, ForcePath
from exosight.control.realtime import STAGES, Step
from exosight.control.scheduled import Scheduled
from exosight.errors import DataError, InputError
from exosight.files import check_absent, check_format, open_file, unfinished, write_error
from exosight.hdf5 import array, as_closed, group, opened, stored_rows, text, whole_array
from exosight.system.schema import schema_from_dict, schema_to_dict
from exosight.validation import first_fault

FORMAT = 5
"""Version of recordings; a reader takes this one."""

_FORMAT_PREFIX = "exosight recording "
STATES = tuple(State)
"""A state is stored as its place in here."""

_CAUSE_LENGTH = 160  # bytes
_CAUSE = f"S{_CAUSE_LENGTH}"
_HEAD = 2**18  # bytes: more than the controller's paths take, or what HDF5 adds to a second of steps
_GUARD = TypeAdapter(GuardConfig)
_ADAPTIVE: TypeAdapter[AdaptiveConfig | None] = TypeAdapter(AdaptiveConfig | None)
_ARRAYS = ("u", "outputs", "controlled", "snapped")
_NAMES = ("sensor", "channel")
_NUMBERS = ("rate", "period", "smallest_gain", "largest_gain")
_LARGEST = 1e9  # of any number, in its unit; what is computed from such numbers stays finite
_LARGEST_IMAGE = 40_000_000  # pixels


class Column(NamedTuple):
    """Of a recording: one array, a row a step.

    kind      of its numbers, as NumPy writes it
    row       shape of a row
    unit      empty where it has none; where its row is one number a sensor, theirs, separated by commas
    meaning   in words
    value     of a step; None where it has none
    missing   is stored in the place of None; where it is a number, NaN is refused
    """

    kind: str
    row: tuple[int, ...]
    unit: str
    meaning: str
    value: Callable[[Step], Any]
    missing: float = 0.0


def columns(config: ControllerConfig) -> dict[str, Column]:
    """The arrays of a recording by name. Beside them: `images`, gray 0…255, black where none came."""
    schema, sensor, channel = config.schema, config.controlled, config.driven
    outputs, units = (len(schema.estimated),), ", ".join(spec.unit for spec in schema.estimated)
    names = ", ".join(schema.outputs)
    commands = (len(schema.channels),), ", ".join(each.unit for each in schema.channels)
    states = ", ".join(f"{i} {state.value}" for i, state in enumerate(STATES))

    def estimate(field: str, row: tuple[int, ...], unit: str, meaning: str) -> Column:
        def value(step: Step) -> Any:
            reading = step.measurement.reading
            return None if reading is None else getattr(reading, field)[0]

        return Column("f4", row, unit, meaning, value)

    return {
        "time": Column("f8", (), "s", "since the first step began", lambda s: s.time),
        "target": Column("f8", (), sensor.unit, f"of {sensor.name}", lambda s: s.target),
        "command": Column("f8", (), channel.unit, f"asked of {channel.name}", lambda s: s.command),
        "reported": Column(
            "f8",
            *commands,
            "commands that the plant reported with the frame; NaN: none",
            lambda s: s.measurement.commands,
            math.nan,
        ),
        "shown": Column(
            "f8", *commands, "the same, or those sent when the frame was taken", lambda s: s.shown, math.nan
        ),
        "age": Column(
            "f8", (), "s", "of the frame when it was acted on", lambda s: s.measurement.age, math.nan
        ),
        "has_frame": Column("?", (), "", "a frame came", lambda s: s.measurement.image is not None),
        "has_estimate": Column(
            "?", (), "", "the network gave finite estimates", lambda s: s.measurement.reading is not None
        ),
        "estimated": estimate("forces", outputs, units, f"estimates of {names}"),
        "low": estimate("low", outputs, units, "lower ends of their intervals"),
        "high": estimate("high", outputs, units, "upper ends"),
        "contact": estimate("contact", outputs, "-", "probabilities of contact"),
        "ood_score": estimate("ood_score", (), "-", "score of an out-of-distribution image; trusted up to 1"),
        "true": Column(
            "f8", outputs, units, f"true readings of {names}; NaN: unknown", lambda s: s.true, math.nan
        ),
        "state": Column("i1", (), "", f"of the guard: {states}", lambda s: STATES.index(s.state)),
        "cause": Column(
            _CAUSE, (), "", "of a change of state in this step", lambda s: s.cause.encode()[:_CAUSE_LENGTH]
        ),
        "seconds": Column(
            "f8", (len(STAGES),), "s", f"that these took: {', '.join(STAGES)}", lambda s: s.seconds
        ),
        "late": Column("f8", (), "s", "how long after its time the step began", lambda s: s.late),
        "missed": Column("i4", (), "", "periods without a step since the last one", lambda s: s.missed),
    }


@dataclass(frozen=True, eq=False)
class Recording:
    """What a file holds: a row a step; see `columns` for units and meanings.

    path        of the file, which holds the images: `images` reads them one by one
    model       SHA-256 of the network's file, see `checksum`
    controller  what the law knew of the plant, its schema and the names of sensor and channel among it
    guard       what was trusted
    adaptive    settings of the adaptive controller; None: it was the guarded one
    """

    path: Path
    model: str
    controller: ControllerConfig
    guard: GuardConfig
    adaptive: AdaptiveConfig | None
    time: Float[np.ndarray, " steps"]
    target: Float[np.ndarray, " steps"]
    command: Float[np.ndarray, " steps"]
    reported: Float[np.ndarray, "steps channels"]
    shown: Float[np.ndarray, "steps channels"]
    age: Float[np.ndarray, " steps"]
    has_frame: Bool[np.ndarray, " steps"]
    has_estimate: Bool[np.ndarray, " steps"]
    estimated: Float32[np.ndarray, "steps outputs"]
    low: Float32[np.ndarray, "steps outputs"]
    high: Float32[np.ndarray, "steps outputs"]
    contact: Float32[np.ndarray, "steps outputs"]
    ood_score: Float32[np.ndarray, " steps"]
    true: Float[np.ndarray, "steps outputs"]
    state: Int8[np.ndarray, " steps"]
    cause: np.ndarray
    seconds: Float[np.ndarray, "steps 4"]
    late: Float[np.ndarray, " steps"]
    missed: Int32[np.ndarray, " steps"]

    def __len__(self) -> int:
        return len(self.time)

    def guarded(self) -> Guarded | Adaptive:
        """A new controller as the one that was recorded."""
        if self.adaptive is None:
            return Guarded(Scheduled(self.controller), self.guard)
        return Adaptive(self.controller, self.adaptive, self.guard)

    def images(self) -> Iterator[UInt8[np.ndarray, "height width"]]:
        """The image of every step, gray 0…255; DataError if the file is damaged there, or gone."""
        with _opened(self.path) as file:
            images = _images(file)
            for i in range(len(self)):
                yield images[i]


class Recorder:
    """Writes steps to a new file; pass `append` to `run_live`, and close it at the end.

    path    of the new file
    shape   (height, width) of the pictures
    guarded the controller
    model   the network's file, of several cameras one each

    The file takes its name with its first rows: what ends before leaves nothing that would stand in the way.
    Raises DataError if the file exists or cannot be written.
    """

    def __init__(self, path: Path, shape: tuple[int, int], guarded: Guarded | Adaptive, *model: Path) -> None:
        self._path, self._shape, self._rows = path, shape, []
        self._columns = columns(guarded.config)
        self._block = _block(guarded.config)
        with _told(path), ExitStack() as stack:
            check_absent(path)
            self._at = stack.enter_context(unfinished(path))
            self._at.open("xb").close()
            _reserve(self._at, 0, _HEAD)
            self._file = stack.enter_context(h5py.File(self._at, "w", libver="v110"))
            _reserve(self._at, 0, _HEAD)
            _write_head(self._file, guarded, checksum(*model), shape, self._block)
            self._file.swmr_mode = True
            self._open = stack.pop_all()

    def append(self, step: Step) -> None:
        """Take note of a step; once a second, all of them are written.

        Raises DataError if they cannot be, for instance because the disk is full.
        """
        image = step.measurement.image
        row: dict[str, Any] = {"images": np.zeros(self._shape, np.uint8) if image is None else image}
        for name, column in self._columns.items():
            value = column.value(step)
            row[name] = np.full(column.row, column.missing) if value is None else value
        self._rows.append(row)
        if len(self._rows) >= self._block:
            self._write()

    def close(self) -> None:
        """Write what is left, and close the file; DataError if that fails."""
        try:
            if self._rows:
                self._write()
        finally:
            with _told(self._path):
                self._open.close()

    def _write(self) -> None:
        rows, self._rows = self._rows, []  # what could not be written once is not tried again
        with _told(self._path):
            _reserve(self._at, self._file.id.get_filesize(), _HEAD + 2 * len(rows) * math.prod(self._shape))
            for name in ("images", *self._columns):
                data: Any = self._file[name]
                data.resize(len(data) + len(rows), axis=0)
                data[-len(rows) :] = np.stack([row[name] for row in rows])
            self._file.flush()
            if self._at != self._path:
                check_absent(self._path)
                os.replace(self._at, self._path)
                self._at = self._path


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
    except DataError:
        raise
    except (OSError, RuntimeError, ValueError) as error:
        kept = "; it keeps the steps before, so name another file" if path.exists() else ""
        raise DataError(f"{write_error(path, error)}{kept}") from error


def read_recording(path: Path) -> Recording:
    """A recording, but for its images, in memory.

    Raises DataError if the file is missing, damaged, of another kind, or holds what no run can have been.
    """
    with _opened(path) as file:
        version = text(file, "format").removeprefix(_FORMAT_PREFIX)
        found = int(version) if version.isascii() and version.isdecimal() and len(version) < 9 else None
        check_format(path, "recording", found, FORMAT, "record the run again with exosight live --record")
        model = text(file, "model")
        controller, guard, adaptive = _controller(file)
        wanted = columns(controller)
        stored = {
            name: array(file, name, column.kind, (None, *column.row)) for name, column in wanted.items()
        } | {"images": _images(file)}
        # A process killed while it wrote leaves some columns longer than others, by a second at most.
        steps = min(map(stored_rows, stored.values()))
        claimed = max(map(len, stored.values()))
        if claimed > steps + _block(controller) or steps * _step_bytes(wanted) > file.id.get_filesize():
            raise ValueError(f"it claims {claimed} steps, of which the file stores {steps}")
        values = {name: stored[name][:steps] for name in wanted}
        for name, column in wanted.items():
            _check_values(name, values[name], column)
    if steps == 0:
        raise DataError(f"{path}: holds no step; it was stopped within its first second")
    return Recording(path, model, controller, guard, adaptive, **values)


def checksum(*models: Path) -> str:
    """SHA-256 of a network's file, by which a recording names it; of several files, that of all of theirs."""
    found = [hashlib.sha256(model.read_bytes()).hexdigest() for model in models]
    return found[0] if len(found) == 1 else hashlib.sha256("".join(found).encode()).hexdigest()


def _write_head(
    file: h5py.File, guarded: Guarded | Adaptive, model: str, shape: tuple[int, int], block: int
) -> None:
    file.attrs["format"] = f"{_FORMAT_PREFIX}{FORMAT}"
    file.attrs["exosight_version"] = __version__
    file.attrs["model"] = model
    file.attrs["guard"] = json.dumps(_GUARD.dump_python(guarded.guard))
    adaptive = guarded.adaptive if isinstance(guarded, Adaptive) else None
    file.attrs["adaptive"] = json.dumps(_ADAPTIVE.dump_python(adaptive))
    for name, column in columns(guarded.config).items():
        row = column.row
        data = file.create_dataset(name, (0, *row), column.kind, chunks=(block, *row), maxshape=(None, *row))
        data.attrs["unit"], data.attrs["meaning"] = column.unit, column.meaning
    file.create_dataset(
        "images", (0, *shape), "u1", chunks=(1, *shape), maxshape=(None, *shape), compression=1
    )
    config = guarded.config
    group = file.create_group("controller")
    group["output_limits"] = config.output_limits
    file.attrs["schema"] = json.dumps(schema_to_dict(config.schema))
    for name in _NAMES:
        file.attrs[name] = getattr(config, name)
    for name in _NUMBERS:
        group[name] = getattr(config, name)
    for path in ("loading", "unloading"):
        for name in _ARRAYS:
            group[f"{path}/{name}"] = getattr(getattr(config, path), name)


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    expected = "expected a recording of exosight"
    with (
        as_closed(open_file(path, expected)) as content,
        opened(content, path, "a recording of exosight") as file,
    ):
        yield file


def _block(config: ControllerConfig) -> int:
    """Steps that are written at once: those of a second."""
    return max(1, round(1 / config.period))


def _step_bytes(wanted: dict[str, Column]) -> int:
    """What a step takes in the file, without its image."""
    return sum(np.dtype(column.kind).itemsize * math.prod(column.row) for column in wanted.values())


def _controller(file: h5py.File) -> tuple[ControllerConfig, GuardConfig, AdaptiveConfig | None]:
    inside = group(file, "controller")

    def numbers(name: str, kind: str, shape: tuple[int | None, ...]) -> np.ndarray:
        values = np.asarray(whole_array(inside, name, kind, shape)[()])
        if kind == "f8" and np.any(np.abs(values) > _LARGEST):
            raise ValueError(f"{name} holds a number beyond {_LARGEST:g} in size")
        return values

    def path(name: str) -> ForcePath:
        return ForcePath(
            u=numbers(f"{name}/u", "f8", (None,)),
            outputs=numbers(f"{name}/outputs", "f8", (None, None)),
            controlled=numbers(f"{name}/controlled", "f8", (None,)),
            snapped=numbers(f"{name}/snapped", "?", (None,)),
        )

    try:
        values: dict[str, Any] = {name: text(file, name) for name in _NAMES}
        values |= {name: float(numbers(name, "f8", ())) for name in _NUMBERS}
        config = ControllerConfig(
            loading=path("loading"),
            unloading=path("unloading"),
            output_limits=whole_array(inside, "output_limits", "f8", (None,))[()],
            schema=schema_from_dict(json.loads(text(file, "schema"))),
            **values,
        )
        guard = _GUARD.validate_python(json.loads(text(file, "guard")))
        adaptive = _ADAPTIVE.validate_python(json.loads(text(file, "adaptive")))
    except (InputError, ValidationError, RecursionError) as error:
        fault = first_fault(error) if isinstance(error, ValidationError) else error
        raise ValueError(str(fault)) from error
    return config, guard, adaptive


def _images(file: h5py.File) -> h5py.Dataset:
    images = array(file, "images", "u1", (None, None, None))
    if not 0 < math.prod(images.shape[1:]) <= _LARGEST_IMAGE:
        raise ValueError(
            f"images expects up to {_LARGEST_IMAGE // 10**6} million pixels, got {images.shape[1:]}"
        )
    return images


def _check_values(name: str, values: np.ndarray, column: Column) -> None:
    """ValueError for what no run leaves in a column."""
    if values.dtype.kind == "f":
        known = np.abs(values) <= _LARGEST
        if not (known | np.isnan(values) if math.isnan(column.missing) else known).all():
            raise ValueError(f"{name} holds something else than numbers up to {_LARGEST:g} in size")
    if name == "time" and np.any(np.diff(values) < 0):
        raise ValueError("its times do not rise")
    if name == "missed" and np.any(values < 0):
        raise ValueError(f"missed expects at least 0, got {values.min()}")
    if name == "state" and not np.all((values >= 0) & (values < len(STATES))):
        raise ValueError(f"state expects 0…{len(STATES) - 1}, got {values.min()}…{values.max()}")
