"""Pictures in a folder and a table of loads → `Measurements`."""

from collections.abc import Callable, Sequence
from pathlib import Path, PurePath

import numpy as np
from jaxtyping import Float, Int64, UInt8

from exosight.errors import DataError, InputError
from exosight.rig.folder import PictureFolder, open_folder
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.outlines import Outline, outline_of_mask, outline_of_picture
from exosight.rig.matching import NO_ROW, PICTURE_COLUMNS, TIME_COLUMNS, match_rows
from exosight.rig.table import ReadingTable, TableColumn
from exosight.rig.units import in_si
from exosight.system.schema import Schema
from exosight.system.system import System

MOST = 1000
"""Pictures; some tens tell all that there is to tell."""
APART = 0.02
"""Largest difference in time of a picture and its row [s]."""


def open_pictures(folder: Path) -> PictureFolder:
    """The pictures of a folder; DataError if there are none or too many."""
    found = open_folder(folder)
    if len(found.names) > MOST:
        raise DataError(f"{folder}: expected 2 to {MOST} pictures, got {len(found.names)}; take some of them")
    return found


def read_measurements(
    pictures: PictureFolder,
    table: ReadingTable,
    system: System,
    masks: bool,
    done: Callable[[int, int], None] = lambda k, n: None,
) -> Measurements:
    """The outlines, commands and readings of pictures and their table.

    The table has a row a picture, in the order in which commands were reached: a column for each channel, any
    columns of sensors, each with its unit as "u [N]". Rows belong to pictures as `match_rows` finds.

    system   whose channels, sensors, tubes and camera they are
    masks    whether the pictures are masks, see `outline_of_mask`
    done     called with how many of how many pictures are read

    Raises DataError and InputError, with one sentence, for what is missing or does not fit.
    """
    rows = _rows(table, pictures)
    places = np.argsort(rows)
    commands = _commands(table, system.schema)[rows[places]]
    readings = {name: column[rows[places]] for name, column in _readings(table, system.schema).items()}
    outlines = []
    for place in places:
        name = str(pictures.root / pictures.names[place])
        outlines.append(outline_of_system(pictures.picture(int(place)), system, masks, name))
        done(len(outlines), len(places))
    return Measurements(commands, tuple(outlines), readings)


def read_commands(
    table: ReadingTable, names: Sequence[str], schema: Schema
) -> Float[np.ndarray, "pictures channels"]:
    """The loads of pictures [the channels' units]; rows of other pictures may be in the table.

    names   of the picture files

    Raises InputError, with one sentence, for what is missing or does not fit.
    """
    named = table.find(PICTURE_COLUMNS)
    if named is not None and not named.is_numeric:
        stems = {PurePath(name).stem for name in names}
        table = table.rows([PurePath(cell).stem in stems for cell in named.cells])
        if not len(table):
            raise InputError(
                f"{table.source}: expected a row for every picture, got none for {names[0]}; column "
                f"{named.heading} names other pictures"
            )
    pictures = PictureFolder(Path(), tuple(PurePath(name).as_posix() for name in names))
    return _commands(table, schema)[_rows(table, pictures)]


def _rows(table: ReadingTable, pictures: PictureFolder) -> Int64[np.ndarray, " pictures"]:
    """The row of every picture."""
    rows = match_rows(pictures, table, "auto", APART).rows
    if (rows == NO_ROW).any():
        lost = pictures.names[int(np.argmax(rows == NO_ROW))]
        raise InputError(
            f"{table.source}: expected a row for every picture, got none for {lost}; add its load, or take "
            "the picture out"
        )
    return rows


def outline_of_system(
    gray: UInt8[np.ndarray, "height width"], system: System, masks: bool, name: str
) -> Outline:
    """The outline in a picture of a system, or in a mask, see `outline_of_picture` and `outline_of_mask`.

    Raises DataError, beginning with `name`, for another size than that of the system's camera, or a picture
    without the system.
    """
    camera = system.camera
    if gray.shape != (camera.height, camera.width):
        raise DataError(
            f"{name}: expected {camera.width}×{camera.height} pixels, as the first picture or the system "
            f"file's camera has, got {gray.shape[1]}×{gray.shape[0]}; take pictures of one size"
        )
    if masks:
        return outline_of_mask(gray, len(system.tubes), name)
    return outline_of_picture(gray, [tube.shade for tube in system.tubes], name)


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
    others = {*PICTURE_COLUMNS, *TIME_COLUMNS, *(channel.name.lower() for channel in schema.channels)}
    found = {}
    for column in table.columns:
        if column.name.lower() in others:
            continue
        sensor = names.get(column.name.lower())
        if sensor is None:
            raise InputError(
                f"{table.source}: column {column.heading} is no channel and no sensor of {schema.system} ("
                f"it has {', '.join(each.name for each in schema.sensors)}); rename it"
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
    (kind, size), (other, own) = in_si(column.unit), in_si(unit)
    if kind != other:
        raise InputError(
            f"{table.source}: column {column.heading}: expected its unit {unit}, got {column.unit}; for "
            f'loads in a unit of your own give --gain, what one of it does, like "0.05 N/{column.unit}"'
        )
    try:
        return size / own * column.numbers
    except InputError as error:
        raise InputError(f"{table.source}: {error}") from None
