"""Pictures in a folder and a table of loads → `Measurements`."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from exosight.errors import DataError, InputError
from exosight.files import read_file
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.outlines import Outline, outline_of_mask, outline_of_picture
from exosight.rig.table import ReadingTable, TableColumn, read_table
from exosight.system.schema import Schema
from exosight.system.system import System
from exosight.system.units import KINDS
from exosight.vision.pictures import LARGEST_FILE, decode_whole

PICTURE = ("picture", "image", "file", "filename")
"""Names of the column that names the pictures, in any case."""
ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
MOST = 1000
"""Pictures; some tens tell all that there is to tell."""


def read_measurements(
    folder: Path,
    loads: Path,
    system: System,
    masks: bool,
    done: Callable[[int, int], None] = lambda k, n: None,
) -> Measurements:
    """The outlines, commands and readings of a folder of pictures and its table.

    The table has a row a picture, in the order in which commands were reached: a column for each channel, any
    columns of sensors, each with its unit as "u [N]", and `picture`, the file's name in the folder; without
    it the rows are those of the pictures sorted by name.

    system   whose channels, sensors, tubes and camera they are
    masks    whether the pictures are masks, see `outline_of_mask`
    done     called with how many of how many pictures are read

    Raises DataError and InputError, with one sentence, for what is missing or does not fit.
    """
    table = read_table(loads)
    paths = _paths(folder, table)
    commands = _commands(table, system.schema)
    readings = _readings(table, system.schema)
    camera, outlines = system.camera, []
    for k, path in enumerate(paths):
        gray = read_picture(path)
        if gray.shape != (camera.height, camera.width):
            raise DataError(
                f"{path}: expected {camera.width}×{camera.height} pixels, got "
                f"{gray.shape[1]}×{gray.shape[0]}; pictures must be as large as the first one, and as the "
                "camera of a system file"
            )
        outlines.append(_outline(gray, system, masks, str(path)))
        done(k + 1, len(paths))
    return Measurements(commands, tuple(outlines), readings)


def read_picture(path: Path) -> UInt8[np.ndarray, "rows columns"]:
    """A picture file as gray values in its own size; DataError if it is none."""
    return decode_whole(read_file(path, LARGEST_FILE, "expected a picture"), str(path))


def picture_files(folder: Path) -> list[Path]:
    """The pictures of a folder, sorted by name; DataError if there are none or too many."""
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; expected one with pictures")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    if not 1 <= len(found) <= MOST:
        raise DataError(f"{folder}: expected 2 to {MOST} pictures ({', '.join(ENDINGS)}), got {len(found)}")
    return found


def _paths(folder: Path, table: ReadingTable) -> list[Path]:
    """The picture of each row."""
    files = picture_files(folder)
    column = table.find(PICTURE)
    if column is None:
        if len(files) != len(table):
            raise DataError(
                f"{table.source}: expected a row a picture, {len(files)}, got {len(table)}; or add a column "
                "picture with the names of the files"
            )
        return files
    known = {path.name: path for path in files}
    for row, name in enumerate(column.cells, 1):
        if name not in known:
            raise DataError(f"{table.source}: row {row}: there is no picture {name!r} in {folder}")
    return [known[name] for name in column.cells]


def _commands(table: ReadingTable, schema: Schema) -> Float[np.ndarray, "pictures channels"]:
    """A column a channel, in its unit."""
    found = []
    for channel in schema.channels:
        column = table.find([channel.name.lower()])
        if column is None:
            units = ", ".join(f"{each.name} [{each.unit}]" for each in schema.channels)
            raise InputError(
                f"{table.source}: expected the loads in columns {units}, got "
                f"{', '.join(each.heading for each in table.columns)}"
            )
        numbers = _in_unit(table, column, channel.unit)
        if not np.isfinite(numbers).all():
            row = int(np.argmin(np.isfinite(numbers))) + 1
            raise InputError(
                f"{table.source}: row {row} has no load in column {column.heading}; write it there"
            )
        if numbers.min() < channel.low or numbers.max() > channel.high:
            worst = numbers[np.argmax(np.maximum(channel.low - numbers, numbers - channel.high))]
            raise InputError(
                f"{table.source}: column {column.heading}: expected {channel.low:g} to {channel.high:g} "
                f"{channel.unit}, the range of the channel, got {worst:g}"
            )
        found.append(numbers)
    return np.stack(found, axis=1)


def _readings(table: ReadingTable, schema: Schema) -> dict[str, Float[np.ndarray, " pictures"]]:
    """Columns of sensors, in their units; others than channels and pictures are refused."""
    names = {sensor.name.lower(): sensor for sensor in schema.sensors}
    others = {*PICTURE, *(channel.name.lower() for channel in schema.channels)}
    found = {}
    for column in table.columns:
        if column.name.lower() in others:
            continue
        sensor = names.get(column.name.lower())
        if sensor is None:
            raise InputError(
                f"{table.source}: column {column.heading} is no channel and no sensor of {schema.system} "
                f"(sensors: {', '.join(each.name for each in schema.sensors)}); rename it or leave it out"
            )
        numbers = _in_unit(table, column, sensor.unit)
        if np.isfinite(numbers).any():
            found[sensor.name] = numbers
    return found


def _in_unit(table: ReadingTable, column: TableColumn, unit: str) -> Float[np.ndarray, " pictures"]:
    """The numbers of a column in a unit."""
    if column.unit is None:
        raise InputError(
            f"{table.source}: column {column.heading} has no unit; write it behind the name, like "
            f'"{column.name} [{unit}]"'
        )
    factor = 1.0
    if column.unit != unit:
        kind = next((kind for kind in KINDS if unit in kind.units and column.unit in kind.units), None)
        if kind is None:
            raise InputError(
                f"{table.source}: column {column.heading}: expected its unit {unit}, got {column.unit}; for "
                f'loads in a unit of your own give --gain, what one of it does, like "0.05 N/{column.unit}"'
            )
        factor = kind.units[column.unit] / kind.units[unit]
    try:
        return factor * column.numbers
    except InputError as error:
        raise InputError(f"{table.source}: {error}") from None


def _outline(gray: UInt8[np.ndarray, "height width"], system: System, masks: bool, name: str) -> Outline:
    if masks:
        return outline_of_mask(gray, len(system.tubes), name)
    return outline_of_picture(gray, [tube.shade for tube in system.tubes], name)
