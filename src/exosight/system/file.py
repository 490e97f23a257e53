"""System files: TOML text of unknown origin in, a checked description out."""

import copy
import csv
import math
import tomllib
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from exosight.errors import DataError, InputError
from exosight.system.description import Description
from exosight.validation import first_fault

LARGEST_FILE = 2**20  # [bytes]; a hand of twenty bodies takes 10 KiB
DEEPEST = 32

Values = dict[str, Any]

_ADAPTER = TypeAdapter(Description)


def read_system_file(path: Path) -> Values:
    """The entries of a system file, as it spells them; the points of a CSV profile stand in the place of its name.

    Raises DataError for a file that is missing, too large, no text or no TOML; InputError, with the place in the
    file, for entries that no system can be built of.
    """
    text = _read_text(path)
    try:
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"{path}: not TOML ({error or 'nested too deeply'})") from None
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
    """The description that the entries of a system file make; InputError with the place of the first fault."""
    try:
        return _ADAPTER.validate_python(values)
    except ValidationError as error:
        raise InputError(_plain(first_fault(error))) from None


def replaced(values: Values, entry: str, value: Any) -> Values:
    """The entries with another value at a place such as "rods.sleeve.young" or "links.distal.radius.0".

    Raises InputError if there is no such entry, or it is a table or a list.
    """
    changed = copy.deepcopy(values)
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


def _read_text(path: Path) -> str:
    try:
        if not path.is_file():
            raise DataError(f"{path}: no such file; expected a system file (exosight system new makes one)")
        if path.stat().st_size > LARGEST_FILE:
            raise DataError(f"{path}: more than {LARGEST_FILE >> 20} MiB; expected a system file")
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        raise DataError(f"{path}: not UTF-8 text; expected a system file in TOML") from None
    except (OSError, ValueError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(f"{path}: cannot be read ({error})") from None


def _check_plain(path: Path, values: Any, place: str = "", depth: int = 0) -> None:
    """InputError for NaN, infinity, dates, and tables nested without end: JSON must be able to carry it all."""
    if depth > DEEPEST:
        raise InputError(f"{path}: {place[:60]}…: nested too deeply")
    if isinstance(values, dict | list):
        entries = values.items() if isinstance(values, dict) else enumerate(values)
        for key, value in entries:
            _check_plain(path, value, f"{place}.{key}" if place else str(key), depth + 1)
    elif isinstance(values, float) and not math.isfinite(values):
        raise InputError(f"{path}: {place}: expected a finite number, got {values}")
    elif not isinstance(values, str | int | float):
        raise InputError(f"{path}: {place}: expected text or a number, got {values}")


def _tables(values: Values, kind: str) -> list[tuple[str, Values]]:
    tables = values.get(kind)
    if not isinstance(tables, dict):
        return []
    return [(name, table) for name, table in tables.items() if isinstance(table, dict)]


def _read_profile(path: Path, place: str, name: str) -> tuple[list[float], list[float]]:
    """Places and radii of a CSV file beside the system file; a first row of words is a heading."""
    parts = Path(name).parts
    if not name or "\0" in name or Path(name).is_absolute() or ".." in parts:
        raise InputError(f"{path}: {place}: expected the name of a file beside the system file, got {name!r}")
    try:
        rows = [row for row in csv.reader(_read_text(path.parent / name).splitlines()) if row]
    except csv.Error as error:
        raise DataError(f"{path.parent / name}: not CSV ({error})") from None
    points: list[tuple[float, float]] = []
    for number, row in enumerate(rows):
        try:
            x, radius = (float(cell) for cell in row)
        except ValueError:
            if number == 0:
                continue
            raise InputError(
                f"{path.parent / name}, row {number + 1}: expected two numbers, X and radius, got {','.join(row)[:40]!r}"
            ) from None
        if not (math.isfinite(x) and math.isfinite(radius)):
            raise InputError(
                f"{path.parent / name}, row {number + 1}: expected finite numbers, got {','.join(row)[:40]!r}"
            )
        points.append((x, radius))
    return [x for x, _ in points], [radius for _, radius in points]


def _plain(fault: str) -> str:
    """pydantic's words for what a file cannot hold → ours, on one line."""
    text = " ".join(fault.split())
    for theirs, ours in (
        ("Unexpected keyword argument", "there is no such entry"),
        ("Extra inputs are not permitted", "there is no such entry"),
        ("Field required", "expected a value, got none"),
        ("Input should be", "expected"),
        (
            "String should match pattern '^[A-Za-z][A-Za-z0-9_]{0,31}$'",
            "expected a name of at most 32 letters, digits and underscores, a letter first",
        ),
    ):
        text = text.replace(theirs, ours)
    return text.replace(".[key]", "")
