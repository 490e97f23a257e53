"""Tables of readings: CSV files of unknown origin, their columns with names and units."""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from exosight.errors import DataError, InputError
from exosight.files import read_file
from exosight.validation import check_unique

LARGEST_TABLE = 256 * 2**20
"""[bytes]; a million rows of ten readings take 100 MB."""

LONGEST_NAME = 32
"""Letters of a column's name."""

_HEADING = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<unit>[^\]]*)\]|\((?P<other>[^)]*)\))?\s*")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_MISSING = ("", "nan", "na", "n/a", "null", "none", "-")
"""What stands in cells without a reading, in lower case."""


@dataclass(frozen=True)
class TableColumn:
    """One column of a table.

    heading   as it is written: "thumb [N]"
    name      without its unit, in the characters of names
    unit      as it is written; None: the heading has none
    cells     its texts, a row a picture or reading
    """

    heading: str
    name: str
    unit: str | None
    cells: tuple[str, ...]

    @cached_property
    def is_numeric(self) -> bool:
        """Whether every cell that is not empty is a number, and one is."""
        return not self._bad and not np.isnan(self._values).all()

    @cached_property
    def numbers(self) -> Float64[np.ndarray, " rows"]:
        """The readings, NaN where a cell is empty; InputError naming the first cell that is no number."""
        if self._bad:
            row = self._bad[0]
            raise InputError(
                f"column {self.heading}: expected numbers, got {self.cells[row][:40]!r} in row {row + 1}; "
                "correct it, or leave the column out by naming the others with --sensors"
            )
        return self._values

    @cached_property
    def _parsed(self) -> tuple[np.ndarray, list[int]]:
        values, bad = np.empty(len(self.cells)), []
        for row, cell in enumerate(self.cells):
            try:
                values[row] = np.nan if cell.lower() in _MISSING else float(cell)
            except ValueError:
                values[row] = np.nan
                bad.append(row)
        return values, bad

    @property
    def _values(self) -> np.ndarray:
        return self._parsed[0]

    @property
    def _bad(self) -> list[int]:
        return self._parsed[1]


@dataclass(frozen=True)
class ReadingTable:
    """A table of readings; `source` names it in messages."""

    source: str
    columns: tuple[TableColumn, ...]

    def __len__(self) -> int:
        return len(self.columns[0].cells) if self.columns else 0

    def rows(self, keep: Sequence[bool]) -> "ReadingTable":
        """The rows that are to be kept."""
        columns = (replace(column, cells=tuple(compress(column.cells, keep))) for column in self.columns)
        return replace(self, columns=tuple(columns))

    def column(self, name: str) -> TableColumn:
        """A column by its heading or name; InputError if there is none."""
        for column in self.columns:
            if name in (column.heading, column.name):
                return column
        raise InputError(
            f"{self.source}: expected a column {name}, got {', '.join(c.heading for c in self.columns)}"
        )

    def find(self, names: Iterable[str]) -> TableColumn | None:
        """The first column with one of these names, whatever their case."""
        wanted = set(names)
        return next((column for column in self.columns if column.name.lower() in wanted), None)


def column_of(heading: str, cells: Iterable[str]) -> TableColumn:
    """A column from its heading, "thumb [N]" or "thumb (N)"; InputError if that holds no name."""
    found = _HEADING.fullmatch(heading)
    assert found is not None  # it matches any text
    unit = (found["unit"] or found["other"] or "").strip() or None
    name = re.sub(r"[^A-Za-z0-9_]+", "_", found["name"].strip()).strip("_")
    if not name or not name[0].isalpha() or len(name) > LONGEST_NAME:
        raise InputError(
            f"column {heading[:60]!r}: expected a name of 1 to {LONGEST_NAME} letters and digits, a letter "
            "first, with its unit behind it in brackets, like thumb [N]; rename it"
        )
    return TableColumn(heading, name, unit, tuple(cells))


def short_heading(parts: Sequence[str], name: str) -> str:
    """A heading from parts of a topic or feature, without the first ones where it would be too long."""
    parts = [*parts, *([name] if name else [])]
    while len("_".join(parts)) > LONGEST_NAME and len(parts) > (2 if name else 1):
        parts = parts[1:]
    return "_".join(parts)


def read_table(path: Path) -> ReadingTable:
    """A CSV file: headings in the first row, cells apart by comma, semicolon or tab, UTF-8.

    Between semicolons or tabs, numbers may have decimal commas.

    Raises DataError if the file is missing, too large, no text, empty, or has rows of other lengths (the last
    one of a truncated file); InputError for headings that are no names or stand there twice.
    """
    content = read_file(path, LARGEST_TABLE, "expected a table (CSV)")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: no text in UTF-8 ({error.reason}); save the table as CSV, UTF-8") from None
    if "\0" in text:
        raise DataError(f"{path}: no text; save the table as CSV, UTF-8")
    first = text.lstrip().split("\n", 1)[0]
    delimiter = max(",;\t", key=first.count)
    try:
        rows = [row for row in csv.reader(io.StringIO(text), delimiter=delimiter) if any(map(str.strip, row))]
    except csv.Error as error:
        raise DataError(f"{path}: not CSV ({error}); save the table as CSV, UTF-8") from error
    if len(rows) < 2:
        raise DataError(f"{path}: expected headings and at least one row, got {len(rows)} rows")
    headings, *rows = rows
    for number, row in enumerate(rows, 1):
        if len(row) != len(headings):
            raise DataError(
                f"{path}: row {number} has {len(row)} cells, the headings have {len(headings)}; is the file "
                "truncated?"
            )
    decimal_comma = delimiter != ","
    try:
        columns = tuple(
            column_of(heading.strip(), (_cell(cell, decimal_comma) for cell in cells))
            for heading, *cells in zip(headings, *rows, strict=True)
        )
        check_unique("columns", (column.name for column in columns))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return ReadingTable(str(path), columns)


def _cell(text: str, decimal_comma: bool) -> str:
    text = text.strip()
    return text.replace(",", ".") if decimal_comma and _DECIMAL_COMMA.fullmatch(text) else text
