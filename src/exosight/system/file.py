"""System files: TOML text of unknown origin in, a checked description out."""

import copy
import csv
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from exosight.errors import DataError, InputError
from exosight.files import read_file
from exosight.system.description import Description
from exosight.system.faults import sentence

LARGEST_FILE = 256 * 2**10  # [bytes]; a hand of twenty bodies takes 10 KiB
DEEPEST = 32
LARGEST_INTEGER = 2**53
MOST_DOTS = 1000
"""Dots in one line: the time that tomllib takes for a key grows with the square of the dots in it."""

Values = dict[str, Any]

_START = "exosight system new makes a file to start from"

_ADAPTER = TypeAdapter(Description)


def read_system_file(path: Path) -> Values:
    """The entries of a system file, as it spells them; points of a CSV profile stand in place of its name.

    Raises DataError for a file that is missing, too large, no text or no TOML; InputError, with the place in
    the file, for entries that no system can be built of.
    """
    text = _read_text(path, _START)
    dotted = next((n for n, line in enumerate(text.split("\n"), 1) if line.count(".") > MOST_DOTS), None)
    if dotted is not None:
        raise DataError(f"{path}: more than {MOST_DOTS} dots at line {dotted}; break long lists into lines")
    try:
        values = tomllib.loads(text)
    except RecursionError:
        raise DataError(f"{path}: not TOML (nested too deeply)") from None
    except ValueError as error:  # a number of more than 4300 digits is none that tomllib catches
        raise DataError(f"{path}: not TOML ({error})") from None
    if not values:
        raise DataError(f"{path}: it has no entries; {_START}")
    _check_plain(path, values)
    for name, rod in _tables(values, "rods"):
        radius = rod.get("radius")
        if isinstance(radius, dict) and isinstance(radius.get("csv"), str):
            x, points = _read_profile(path, f"rods.{name}.radius.csv", radius["csv"])
            rod["radius"] = {key: value for key, value in radius.items() if key != "csv"}
            rod["radius"] |= {"x": x, "values": points}
    try:
        describe(values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return values


def describe(values: Values) -> Description:
    """The description that the entries of a system file make; InputError naming the first fault."""
    try:
        return _ADAPTER.validate_python(values)
    except ValidationError as error:
        raise InputError(sentence(error)) from None


def replaced(values: Values, entries: Mapping[str, Any]) -> Values:
    """The entries with other values at places such as "rods.sleeve.young" or "links.distal.radius.0".

    Raises InputError if there is no such entry, or it is a table or a list.
    """
    changed = copy.deepcopy(values)
    for entry, value in entries.items():
        at: Any = changed
        *steps, last = entry.split(".")
        for step in steps:
            at = _inside(at, step, entry)
        if isinstance(_inside(at, last, entry), dict | list):
            raise InputError(f"{entry}: expected a single value, got a table or a list")
        at[int(last) if isinstance(at, list) else last] = value
    return changed


def _inside(at: Any, step: str, entry: str) -> Any:
    if isinstance(at, list) and step.isdecimal() and int(step) < len(at):
        return at[int(step)]
    if isinstance(at, dict) and step in at:
        return at[step]
    raise InputError(f"{entry}: there is no such entry in the file; write it there first")


def _read_text(path: Path, remedy: str = "expected a text file") -> str:
    try:
        # Windows' editors and spreadsheets begin with a mark.
        return read_file(path, LARGEST_FILE, remedy).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise DataError(f"{path}: not UTF-8 text") from None


def _check_plain(path: Path, values: Any, place: str = "", depth: int = 0) -> None:
    """InputError for NaN, infinity, dates and deep nesting: JSON must be able to carry it all."""
    if depth > DEEPEST:
        raise InputError(f"{path}: {place[:60]}…: nested too deeply")
    if isinstance(values, dict | list):
        entries = values.items() if isinstance(values, dict) else enumerate(values)
        for key, value in entries:
            _check_plain(path, value, f"{place}.{key}" if place else str(key), depth + 1)
    elif isinstance(values, float) and not math.isfinite(values):
        raise InputError(f"{path}: {place}: expected a finite number, got {values}")
    elif isinstance(values, int) and abs(values) > LARGEST_INTEGER:
        raise InputError(f"{path}: {place}: expected a number below 2^53 in size, got a larger one")
    elif not isinstance(values, str | int | float):
        raise InputError(f"{path}: {place}: expected text or a number, got {values}")


def _tables(values: Values, kind: str) -> list[tuple[str, Values]]:
    tables = values.get(kind)
    if not isinstance(tables, dict):
        return []
    return [(name, table) for name, table in tables.items() if isinstance(table, dict)]


def _read_profile(path: Path, place: str, name: str) -> tuple[list[float], list[float]]:
    """Places and radii of a CSV file beside the system file; a first row of words is a heading."""
    where = f"{path}: {place}: {name}"
    folder = path.parent.resolve()
    try:
        inside = "\0" not in name and (folder / name).resolve().is_relative_to(folder)
    except (OSError, RuntimeError):  # a name that is too long, links in a circle
        inside = False
    if not inside:
        raise InputError(
            f"{path}: {place}: expected the name of a file in the system file's folder, got {name!r}"
        )
    try:
        rows = list(csv.reader(_read_text(path.parent / name).splitlines()))
    except csv.Error as error:
        raise DataError(f"{where}: not CSV ({error})") from None
    except DataError as error:
        raise DataError(f"{path}: {place}: {error}") from None
    points: list[tuple[float, float]] = []
    for number, row in enumerate(rows, 1):
        if not row or (number == 1 and not any(map(_is_number, row))):
            continue
        if len(row) != 2 or not all(map(_is_number, row)):
            raise InputError(
                f"{where}, row {number}: expected X and radius, two finite numbers with a comma between, "
                f"got {','.join(row)[:40]!r}"
            )
        x, radius = float(row[0]), float(row[1])
        if not (0 <= x <= 1 and radius > 0 and (x > points[-1][0] if points else x == 0)):
            raise InputError(
                f"{where}, row {number}: expected X that rises from 0 to 1 and a radius above 0, got {x:g} "
                f"and {radius:g}"
            )
        points.append((x, radius))
    if len(points) < 2 or points[-1][0] != 1:
        raise InputError(f"{where}: expected at least two rows, the last one at X = 1, got {len(points)}")
    return [x for x, _ in points], [radius for _, radius in points]


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
