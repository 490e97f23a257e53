"""Which row of a table belongs to which picture: by name, by order or by time."""

from collections import Counter
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
from jaxtyping import Float64, Int64

from exosight.errors import InputError
from exosight.rig.pictures import PictureSource
from exosight.rig.table import ReadingTable, TableColumn
from exosight.rig.units import in_si

PICTURE_COLUMNS = ("picture", "image", "file", "filename", "file_name", "frame_file", "path", "name")
TIME_COLUMNS = ("time", "timestamp", "t", "stamp", "time_s", "elapsed")
"""Names of columns that say which picture a row is of, and when it was taken, in any case."""

NO_ROW = -1


@dataclass(frozen=True)
class Match:
    """Rows of a table, one a picture.

    rows   place of the row that belongs to each picture, or NO_ROW
    words  how they were found, in a sentence for users
    by_time  whether by time
    """

    rows: Int64[np.ndarray, " pictures"]
    words: str
    by_time: bool = False


def match_rows(
    pictures: PictureSource,
    table: ReadingTable,
    by: str,
    tolerance: float,
    times: ReadingTable | None = None,
) -> Match:
    """The row of each picture.

    by         name: a column of the table holds the pictures' names; order: the first row is of the first
               picture, and so on; time: the row nearest in time; auto: the first of these three that is
               possible
    tolerance  largest difference in time [s]
    times      another table that says when each picture was taken, by name

    Raises InputError if the rows cannot be found so, naming the first picture or row that is at fault.
    """
    named, timed = table.find(PICTURE_COLUMNS), table.find(TIME_COLUMNS)
    if by == "auto":
        if times is not None:
            by = "time"
        elif named is not None and not named.is_numeric:
            by = "name"
        elif len(table) == len(pictures.names):
            by = "order"
        elif timed is not None and pictures.times is not None:
            by = "time"
        else:
            raise InputError(
                f"{table.source}: {len(table)} rows for {len(pictures.names)} pictures; expected a row a "
                "picture in their order, a column picture with their names, or a column time beside pictures "
                "whose times are known (a video, file names that are numbers, or --times)"
            )
    if by == "order":
        if len(table) != len(pictures.names):
            raise InputError(
                f"{table.source}: expected {len(pictures.names)} rows, one a picture in their order, got "
                f"{len(table)}; name the picture of each row in a column picture"
            )
        return Match(np.arange(len(table)), "rows and pictures in the same order")
    if by == "name":
        if named is None:
            raise InputError(
                f"{table.source}: expected a column picture with the names of the pictures, got "
                f"{', '.join(column.heading for column in table.columns)}"
            )
        return Match(_rows_by_name(pictures, named, table.source), f"rows by the names in {named.heading}")
    if timed is None:
        raise InputError(
            f"{table.source}: expected a column time, got {', '.join(c.heading for c in table.columns)}"
        )
    at = _picture_times(pictures, times, timed)
    return _rows_by_time(at, seconds_of(timed), tolerance, table.source)


def seconds_of(column: TableColumn) -> Float64[np.ndarray, " rows"]:
    """The times in a column [s], which are seconds where it names no unit; InputError for another unit."""
    unit, factor = in_si(column.unit or "s")
    if unit != "s":
        raise InputError(f"column {column.heading}: expected a unit of time, got {column.unit}")
    return column.numbers * factor


def _rows_by_name(
    pictures: PictureSource, column: TableColumn, source: str
) -> Int64[np.ndarray, " pictures"]:
    """By whole names; where the table's lack folders or endings, by what is left of them."""
    cells = [cell.replace("\\", "/").removeprefix("./") for cell in column.cells]
    twice = next((cell for cell, count in Counter(cells).items() if count > 1), None)
    if twice is not None:
        raise InputError(f"{source}: {twice[:80]} stands in two rows; expected a row a picture")
    found = {cell: row for row, cell in enumerate(cells)}
    for spelled in (str, lambda name: PurePosixPath(name).name, lambda name: PurePosixPath(name).stem):
        names = [spelled(name) for name in pictures.names]
        rows = np.array([found.get(name, NO_ROW) for name in names])
        if (rows != NO_ROW).any():
            double = next((n for n, count in Counter(names).items() if count > 1 and n in found), None)
            if double is not None:
                raise InputError(
                    f"{source}: {double} is the name of several pictures; write it with its folder"
                )
            missing = sorted(set(range(len(cells))) - set(rows.tolist()))
            if missing:
                raise InputError(
                    f"{source}: row {missing[0] + 1} is of {cells[missing[0]][:80]}, which is not among the "
                    f"pictures ({len(missing)} such rows); add the picture, or remove the row"
                )
            return rows
    raise InputError(
        f"{source}: none of the names in {column.heading} is one of a picture; expected names like "
        f"{pictures.names[0]}, got {cells[0][:80]!r}"
    )


def _picture_times(
    pictures: PictureSource, times: ReadingTable | None, timed: TableColumn
) -> Float64[np.ndarray, " pictures"]:
    """When each picture was taken [s]; NaN where that is unknown."""
    if times is not None:
        rows = match_rows(pictures, times, "name", 0.0).rows
        column = times.find(TIME_COLUMNS)
        if column is None:
            raise InputError(f"{times.source}: expected a column time beside the names of the pictures")
        found = np.where(rows == NO_ROW, np.nan, seconds_of(column)[rows])
    elif pictures.times is not None:
        found = pictures.times * in_si(pictures.time_unit or timed.unit or "s")[1]
    else:
        raise InputError(
            "times: unknown for these pictures; expected a video, file names that are numbers, or --times "
            "with a table of columns picture and time"
        )
    return found


def _rows_by_time(
    pictures: Float64[np.ndarray, " pictures"],
    rows: Float64[np.ndarray, " rows"],
    tolerance: float,
    source: str,
) -> Match:
    if np.isnan(rows).any():
        raise InputError(f"{source}: row {int(np.isnan(rows).argmax()) + 1} has no time; expected one a row")
    check_rising(rows, source)
    after = np.clip(np.searchsorted(rows, pictures), 1, max(len(rows) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(rows) - 1)
    nearest = np.where(np.abs(pictures - rows[before]) <= np.abs(rows[after] - pictures), before, after)
    apart = np.abs(rows[nearest] - pictures)
    near = apart <= tolerance * (1 + 1e-9)  # NaN is far
    if not near.any():
        raise InputError(
            f"{source}: no row within {tolerance:g} s of a picture; pictures are from {_span(pictures)}, "
            f"rows from {_span(rows)}: correct their clocks or units, or allow more with --tolerance"
        )
    words = (
        f"rows by time, {1e3 * np.median(apart[near]):.3g} ms apart (median), "
        f"{1e3 * apart[near].max():.3g} ms at most; {int((~near).sum())} pictures without a "
        f"row within {1e3 * tolerance:g} ms"
    )
    return Match(np.where(near, nearest, NO_ROW), words, by_time=True)


def check_rising(times: Float64[np.ndarray, " rows"], source: str) -> None:
    """Raise InputError, naming the first row, unless times rise."""
    falls = np.flatnonzero(np.diff(times) < 0)
    if falls.size:
        row = int(falls[0]) + 1
        raise InputError(
            f"{source}: the time falls from {times[row - 1]:.10g} s to {times[row]:.10g} s in row {row + 1} "
            f"({falls.size} such rows); sort the rows by time, and give recordings that begin anew apart"
        )


def _span(times: np.ndarray) -> str:
    return f"{np.nanmin(times):.10g} s to {np.nanmax(times):.10g} s"
