"""Sensors, commands and sequences of pictures, from a table."""

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64
from pydantic import ValidationError

from exosight.errors import InputError
from exosight.rig.matching import NO_ROW, PICTURE_COLUMNS, TIME_COLUMNS, Match, seconds_of
from exosight.rig.pictures import PictureSource, Size
from exosight.rig.table import ReadingTable, TableColumn
from exosight.rig.units import in_si
from exosight.system.design import Design
from exosight.system.schema import Channel, Schema, SensorSpec, ViewSpec
from exosight.validation import first_fault

SEQUENCE_COLUMNS = ("sequence", "run", "trial", "episode", "recording", "session")
"""Names of columns that say which sequence a row is of, in any case."""

LARGEST_READING = 1e9
"""In SI units; what is computed from such numbers in single precision stays finite."""


@dataclass(frozen=True)
class Readings:
    """What is known of each picture that is kept, sequence after sequence, in the order of each.

    pictures   place of each in its source
    sequences  all of them, with what identifies their readings
    time       [s]; None: unknown
    words      where the sequences come from, in a sentence for users
    """

    schema: Schema
    pictures: Int64[np.ndarray, " frames"]
    sensors: Float32[np.ndarray, "frames sensors"]
    commands: Float32[np.ndarray, "frames channels"]
    sequence: Int32[np.ndarray, " frames"]
    step: Int32[np.ndarray, " frames"]
    time: Float64[np.ndarray, " frames"] | None
    sequences: tuple[Design, ...]
    words: str

    def __len__(self) -> int:
        return len(self.pictures)

    @property
    def sha256(self) -> str:
        """Identifies sensors, commands and sequences."""
        digest = hashlib.sha256()
        for values in (self.sensors, self.commands, self.sequence):
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()


def collect_readings(
    pictures: PictureSource,
    table: ReadingTable,
    match: Match,
    size: Size,
    *,
    system: str,
    sensors: Sequence[str],
    commands: Sequence[str],
    unit: str | None,
    sequence: str | None,
    stretches: int,
    drop: bool,
) -> tuple[Readings, dict[str, int]]:
    """The readings of all pictures, and how many pictures were left out, by cause.

    size       of the pictures as they are stored
    system     what the system is called
    sensors    names of the columns that networks estimate; by default all that hold nothing else
    commands   names of the columns that say what actuators were commanded to do
    unit       of columns whose heading has none
    sequence   column that says which sequence a row is of; by default one with such a name, else the
               pictures' folders
    stretches  how many sequences there are where none are known: so many stretches of the whole
    drop       leave out pictures without a row, or with an empty cell in it, instead of refusing them

    Raises InputError naming the first column, row or picture that is at fault.
    """
    labels = None if sequence is None else table.column(sequence)
    labels = labels or table.find(SEQUENCE_COLUMNS)
    timed = table.find(TIME_COLUMNS)
    driven = [table.column(name) for name in commands]
    others = [column for column in (table.find(PICTURE_COLUMNS), labels, timed, *driven) if column]
    chosen = [table.column(name) for name in sensors] if sensors else _sensor_columns(table, others)
    values = [_si_values(column, unit, table.source) for column in (*chosen, *driven)]
    kept, dropped = _kept(pictures, match, [*chosen, *driven], table.source, drop)
    rows = match.rows[kept]
    if not len(kept):
        raise InputError(f"{table.source}: no picture has all its readings; complete the table")
    for column, (_, numbers) in zip(chosen, values, strict=False):
        if np.ptp(numbers[rows]) == 0:
            raise InputError(
                f"{table.source}: {column.heading} is {numbers[rows][0]:g} in every row, so nothing can be "
                "learned from it; choose the other columns with --sensors"
            )
    of, words = _sequences(pictures, labels, rows, kept, stretches)
    names = list(dict.fromkeys(of))
    number = {name: place for place, name in enumerate(names)}
    order = np.argsort([number[name] for name in of], kind="stable")
    own = np.array([number[name] for name in of], np.int32)[order]
    rows, kept = rows[order], kept[order]
    time = None if timed is None else _times(timed, rows, own, names)
    columns = [numbers[rows].astype(np.float32) for _, numbers in values]
    readings = np.stack(columns[: len(chosen)], axis=1)
    loads = np.stack(columns[len(chosen) :], axis=1) if driven else np.zeros((len(rows), 0), np.float32)
    units = [name for name, _ in values]
    schema = _schema(system, chosen, driven, units, loads, size)
    step = np.concatenate([np.arange(count) for count in np.bincount(own)]).astype(np.int32)
    sequences = tuple(
        Design(place, 0, 0, {"name": name, "sha256": _sha256(readings[own == place])})
        for place, name in enumerate(names)
    )
    return Readings(schema, kept, readings, loads, own, step, time, sequences, words), dropped


def _sensor_columns(table: ReadingTable, others: Sequence[TableColumn]) -> list[TableColumn]:
    """All columns that hold readings: those with a unit, and numbers that are nothing else."""
    known = {column.name for column in others}
    found = [
        column
        for column in table.columns
        if column.name not in known and (column.unit is not None or column.is_numeric)
    ]
    if not found:
        raise InputError(f"{table.source}: expected a column of readings like thumb [N], got none")
    return found


def _si_values(
    column: TableColumn, unit: str | None, source: str
) -> tuple[str, Float64[np.ndarray, " rows"]]:
    """Unit and numbers of a column in SI units."""
    if column.unit is None and unit is None:
        raise InputError(
            f"{source}: {column.heading} has no unit; write it behind the name, like {column.name} [N], or "
            "give --unit for all such columns"
        )
    name, factor = in_si(column.unit or unit or "")
    numbers = column.numbers * factor
    if np.any(np.abs(numbers) > LARGEST_READING):
        row = int(np.argmax(np.abs(numbers) > LARGEST_READING))
        raise InputError(
            f"{source}: {column.heading} is {column.cells[row]} in row {row + 1}; expected numbers up to "
            f"{LARGEST_READING:g} {name}: correct it, or choose a larger unit"
        )
    return name, numbers


def _kept(
    pictures: PictureSource, match: Match, columns: Sequence[TableColumn], source: str, drop: bool
) -> tuple[Int64[np.ndarray, " kept"], dict[str, int]]:
    """Places of the pictures with all their readings, and the causes of the others."""
    lacking = match.rows == NO_ROW
    remedy = "complete the table, or leave such pictures out with --drop-incomplete"
    if lacking.any() and not (drop or match.by_time):
        first = pictures.names[int(lacking.argmax())]
        raise InputError(
            f"{source}: no row for the picture {first} ({int(lacking.sum())} such pictures); {remedy}"
        )
    empty = np.zeros(len(match.rows), bool)
    for column in columns:
        own = np.isnan(np.where(lacking, 0.0, column.numbers[match.rows])) & ~lacking
        if own.any() and not drop:
            row = int(match.rows[int(own.argmax())])
            raise InputError(
                f"{source}: {column.heading} is empty in row {row + 1} ({int(own.sum())} such rows); {remedy}"
            )
        empty |= own
    dropped = {"no_reading": int(lacking.sum()), "empty_cell": int(empty.sum())}
    return np.flatnonzero(~lacking & ~empty), dropped


def _sequences(
    pictures: PictureSource,
    labels: TableColumn | None,
    rows: Int64[np.ndarray, " kept"],
    kept: Int64[np.ndarray, " kept"],
    stretches: int,
) -> tuple[list[str], str]:
    """Name of the sequence of each picture, and where they come from."""
    if labels is not None:
        found = [labels.cells[row] for row in rows.tolist()]
        if "" in found:
            row = int(rows[found.index("")])
            raise InputError(f"column {labels.heading}: empty in row {row + 1}; expected a sequence in each")
        return found, f"sequences by the column {labels.heading}"
    found = [pictures.folders[place] for place in kept.tolist()]
    if len(set(found)) > 1:
        return found, "sequences by folder"
    count = max(1, min(stretches, len(kept) // 2))
    places = np.arange(len(kept)) * count // len(kept)
    words = (
        f"no sequences are known, so {count} stretches of the whole count as such, neighbours of which are "
        "alike: name a column sequence, or put each into a folder of its own"
    )
    return [f"stretch {place + 1}" for place in places.tolist()], words


def _times(
    timed: TableColumn,
    rows: Int64[np.ndarray, " kept"],
    own: Int32[np.ndarray, " kept"],
    names: Sequence[str],
) -> Float64[np.ndarray, " kept"]:
    """Times that rise within each sequence [s]."""
    found = seconds_of(timed)[rows]
    if np.isnan(found).any():
        row = int(rows[int(np.isnan(found).argmax())])
        raise InputError(f"column {timed.heading}: empty in row {row + 1}; expected a time in each")
    falls = np.flatnonzero((np.diff(found) < 0) & (np.diff(own) == 0))
    if falls.size:
        at = int(falls[0])
        raise InputError(
            f"column {timed.heading}: it falls from {found[at]:.10g} s to {found[at + 1]:.10g} s in row "
            f"{int(rows[at + 1]) + 1} of the sequence {names[own[at]]} ({falls.size} such rows); bring rows "
            "and pictures into the order of time, or say with --sequence where each sequence begins"
        )
    return found


def _schema(
    system: str,
    chosen: Sequence[TableColumn],
    driven: Sequence[TableColumn],
    units: Sequence[str],
    loads: Float32[np.ndarray, "frames channels"],
    size: Size,
) -> Schema:
    twice = [name for name, count in Counter(c.name for c in (*chosen, *driven)).items() if count > 1]
    if twice:
        raise InputError(f"columns: {twice[0]} is asked for twice; expected each once")
    try:
        sensors = tuple(
            SensorSpec(column.name, "measurement", unit, estimated=True)
            for column, unit in zip(chosen, units, strict=False)
        )
        channels = []
        for column, unit, values in zip(driven, units[len(chosen) :], loads.T, strict=True):
            low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
            if low == high:
                raise InputError(f"column {column.heading}: 0 in every row; leave it out of --commands")
            channels.append(Channel(column.name, unit, low, high))
        return Schema(system, tuple(channels), sensors, (ViewSpec("camera", *size, visibility="depth"),))
    except ValidationError as error:
        raise InputError(f"columns: {first_fault(error)}; rename them, or their units") from None


def _sha256(values: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()
