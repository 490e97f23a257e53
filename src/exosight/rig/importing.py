"""A dataset made of pictures and readings: chunk after chunk, the manifest last.

What is wrong with table, names and times is found before the first picture is stored; a picture that cannot
be read stops the import where it is, and what is stored stays for `resume`.
"""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, JsonValue, TypeAdapter
from pydantic.dataclasses import dataclass as checked

from exosight import __version__
from exosight.dataset.frames import Frames
from exosight.dataset.job import ChunkRecord, finished, identity, opened, write_record
from exosight.dataset.manifest import FORMAT, MANIFEST, Manifest, new_manifest, read_manifest, write_manifest
from exosight.dataset.store import write_chunk
from exosight.errors import DataError, InputError
from exosight.rig.bags import bags_in, open_bags
from exosight.rig.card import write_card
from exosight.rig.folder import PictureFolder, open_folder
from exosight.rig.lerobot import is_lerobot, open_lerobot
from exosight.rig.matching import match_rows
from exosight.rig.matlab import open_mat
from exosight.rig.pictures import Fit, PictureSource, Region, Size, fit_of
from exosight.rig.readings import Readings, collect_readings
from exosight.rig.table import ReadingTable, column_of, read_table
from exosight.rig.video import Video
from exosight.validation import CONFIG, SystemName

CHUNK_BYTES = 32 * 2**20
"""Most bytes of pictures in a chunk, which is in memory as a whole."""
CHUNK_FRAMES = 1000

MEASURED = "measured"
"""Name of the one family and scenario of measured frames."""
UNREADABLE = "unreadable"
"""Cause of frames that are left out as their picture cannot be read."""


@checked(frozen=True, config=CONFIG)
class ImportConfig:
    """What is made of pictures and readings."""

    system: SystemName = "rig"
    """what the system is called"""
    sensors: tuple[str, ...] = ()
    """columns that networks are to estimate, with their units if the headings have none: "thumb [N]"; by
    default all with a unit that hold nothing else"""
    commands: tuple[str, ...] = ()
    """columns of what actuators were commanded to do, such as "pressure [kPa]" """
    unit: Annotated[str, Field(max_length=16)] | None = None
    """unit of columns that name none"""
    match: Literal["auto", "name", "order", "time"] = "auto"
    """how a picture finds its row: name (a column picture), order (a row a picture), time (the nearest row);
    auto: the first of them that is possible"""
    tolerance: Annotated[float, Field(gt=0, le=1e6)] = 0.02
    """largest difference in time between a picture and its row [s]"""
    sequence: str | None = None
    """column that says which sequence a row is of; by default one called sequence, run, trial, episode,
    recording or session, else the folders of the pictures"""
    stretches: Annotated[int, Field(ge=1, le=10_000)] = 20
    """where no sequences are known, how many stretches the whole is divided into, which count as such"""
    crop: Region | None = None
    """left, top, width and height of the part of each picture that is taken [pixels]; by default all of it"""
    size: Size | None = None
    """width and height in which pictures are stored [pixels], 32 to 1024 in multiples of 4; by default their
    own or the nearest such"""
    images: str | None = None
    """of a .mat file, the variable with the pictures; by default the only one of three or four dimensions. Of
    recordings of ROS the topic of the pictures, of a LeRobot dataset their feature; default: the only one"""
    order: str | None = None
    """of a .mat file, the order of its dimensions, such as HWN or NHW; by default as the readings say"""


@checked(frozen=True, config=CONFIG)
class ImportJob:
    """What is to be stored; every chunk follows from this and its number."""

    config: dict[str, JsonValue]
    """What is made of which files, by their names."""
    pictures: str
    """Fingerprint of the pictures."""
    readings: str
    """SHA-256 of the readings."""
    frames_per_chunk: int
    """Frames stored as one file."""
    causes: tuple[str, ...] = (UNREADABLE,)
    """Why frames may be left out of a chunk."""
    exosight_version: str = __version__
    """Version of the package that makes it."""
    format: int = FORMAT
    """Version of the layout on disk."""


@dataclass(frozen=True)
class Import:
    """Pictures and readings that were found to fit together.

    dropped  pictures that are left out, by cause
    notes    what was decided, in sentences for users
    """

    pictures: PictureSource
    fit: Fit
    readings: Readings
    config: dict[str, JsonValue]
    dropped: dict[str, int]
    notes: list[str] = field(default_factory=list)

    @property
    def job(self) -> ImportJob:
        """What is to be stored."""
        pixels = self.fit.size[0] * self.fit.size[1]
        each = max(1, min(CHUNK_FRAMES, CHUNK_BYTES // pixels))
        return ImportJob(self.config, self.pictures.fingerprint, self.readings.sha256, each)


@contextmanager
def prepare(
    source: Path,
    config: ImportConfig,
    table: Path | None = None,
    times: Path | None = None,
    *,
    drop: bool = False,
) -> Iterator[Import]:
    """Open pictures and table, and find out how they fit together; only the first picture is read.

    source  folder of pictures, video, .mat file, LeRobot dataset, recording of ROS or folder of such
    table   CSV file of readings; by default the one in the folder, or what the .mat file or recording holds
    times   CSV file that says when each picture was taken
    drop    leave out pictures without a row, with an empty cell in it, or that cannot be read

    Raises DataError for files that cannot be read, InputError for what does not fit together.
    """
    readings = read_table(table) if table is not None else None
    with _opened(source, config, readings) as (pictures, own):
        readings = readings or own or read_table(_only_table(source))
        yield _fitted(pictures, readings, source, config, times, drop)


def _fitted(
    pictures: PictureSource,
    readings: ReadingTable,
    source: Path,
    config: ImportConfig,
    times: Path | None,
    drop: bool,
) -> Import:
    if not readings.columns:
        raise InputError(f"{readings.source}: no readings in it; name a table with --table")
    readings, sensors = _with_units(readings, config.sensors)
    readings, commands = _with_units(readings, config.commands)
    match = match_rows(
        pictures, readings, config.match, config.tolerance, None if times is None else read_table(times)
    )
    fit = fit_of(pictures.picture(0), config.crop, config.size)
    found, dropped = collect_readings(
        pictures,
        readings,
        match,
        fit.size,
        system=config.system,
        sensors=sensors,
        commands=commands,
        unit=config.unit,
        sequence=config.sequence,
        stretches=config.stretches,
        drop=drop,
    )
    entries: dict[str, Any] = TypeAdapter(ImportConfig).dump_python(config, mode="json")
    entries |= {"source": source.name, "table": Path(readings.source).name}
    entries |= {"times": None if times is None else times.name}
    entries |= fit.remembered
    sensors = ", ".join(f"{sensor.name} [{sensor.unit}]" for sensor in found.schema.sensors)
    channels = ", ".join(f"{channel.name} [{channel.unit}]" for channel in found.schema.channels)
    notes = [
        f"{len(found)} of {len(pictures.names)} pictures of {fit.words}",
        match.words,
        f"sensors: {sensors}" + (f"; commands: {channels}" if channels else ""),
        f"{found.words} ({len(found.sequences)})",
    ]
    return Import(pictures, fit, found, entries, dropped, notes)


def store(
    found: Import,
    folder: Path,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    resume: bool = False,
    drop: bool = False,
) -> Manifest:
    """Read, convert and store all pictures with their readings.

    progress  called with the pictures done and their total
    resume    go on with the dataset that the folder holds; what is whole is not made again
    drop      leave out pictures that cannot be read

    Raises DataError for a picture that cannot be read, or if the folder is in use, holds something else or
    cannot be written; InputError for a picture of another size, or if nothing is left.
    """
    folder = folder.resolve()
    job, total = found.job, len(found.readings)
    starts = range(0, total, job.frames_per_chunk)
    with opened(folder, job, resume=resume):
        records: list[ChunkRecord] = []
        for number, start in enumerate(starts):
            part = np.arange(start, min(start + job.frames_per_chunk, total))
            of = set(np.unique(found.readings.sequence[part]).tolist())
            record = finished(folder, _chunk_job(found, part), number, of)
            if record is None:
                (folder / MANIFEST).unlink(missing_ok=True)  # until its chunks are whole, it is no dataset
                record = _make_chunk(
                    found, folder, number, part, drop, lambda done, n=start: progress(n + done, total)
                )
            records.append(record)
            progress(int(part[-1]) + 1, total)
        chunks = tuple(record.entry for record in records if record.entry)
        if not chunks:
            raise InputError(f"{folder}: no picture could be read; name a new folder")
        return _finish(found, folder, records)


@contextmanager
def _opened(
    source: Path, config: ImportConfig, table: ReadingTable | None
) -> Iterator[tuple[PictureSource, ReadingTable | None]]:
    """Pictures, and the readings that stand in the same file, which is open meanwhile."""
    is_mat = source.suffix.lower() == ".mat" and not source.is_dir()
    if not source.exists():
        raise DataError(
            f"{source}: not there; expected a folder of pictures, a video, a .mat file, a LeRobot "
            "dataset or a recording of ROS"
        )
    lerobot = is_lerobot(source)
    bags = [] if lerobot else bags_in(source)
    if config.order is not None and not is_mat:
        raise InputError(f"--order: an option of .mat files, got {source}; leave it out")
    if config.images is not None and not (is_mat or bags or lerobot):
        raise InputError(
            f"--images: an option of .mat files, LeRobot datasets and recordings of ROS, got {source}; "
            "leave it out"
        )
    if lerobot:
        with open_lerobot(source, config.images, own_table=table is None) as found:
            yield found
    elif bags:
        with open_bags(bags, config.images, config.tolerance, own_table=table is None) as found:
            yield found
    elif source.is_dir():
        yield open_folder(source), None
    elif is_mat:
        with open_mat(source, config.images, config.order, None if table is None else len(table)) as found:
            yield found
    else:
        with closing(Video(source)) as video:
            yield video, None


def _only_table(source: Path) -> Path:
    """The one CSV file in a folder of pictures."""
    found = sorted(source.glob("*.csv")) if source.is_dir() else []
    if len(found) == 1:
        return found[0]
    several = f"{len(found)} of them in the folder" if found else "none beside the pictures"
    raise InputError(f"{source}: expected a table of readings (CSV), got {several}; name one with --table")


def _with_units(table: ReadingTable, names: tuple[str, ...]) -> tuple[ReadingTable, list[str]]:
    """The table with the units that go with names like "thumb [N]", and the names without."""
    columns, plain = {column.name: column for column in table.columns}, []
    for text in names:
        if any(text == column.heading for column in table.columns):
            plain.append(text)
            continue
        asked = column_of(text, ())
        own = table.column(asked.name)
        if asked.unit is not None:
            columns[own.name] = replace(own, unit=asked.unit)
        plain.append(own.name)
    return ReadingTable(table.source, tuple(columns.values())), plain


def _chunk_job(found: Import, part: np.ndarray) -> ImportJob:
    """The job with the files of one chunk: where one of them was replaced, the chunk is made again."""
    if not isinstance(found.pictures, PictureFolder):
        return found.job
    return replace(found.job, pictures=found.pictures.fingerprint_of(found.readings.pictures[part].tolist()))


def _make_chunk(
    found: Import,
    folder: Path,
    number: int,
    part: np.ndarray,
    drop: bool,
    progress: Callable[[int], None],
) -> ChunkRecord:
    readings, (width, height) = found.readings, found.fit.size
    images, kept = np.empty((len(part), height, width), np.uint8), []
    for done, place in enumerate(readings.pictures[part].tolist()):
        try:
            picture = found.pictures.picture(place)
            images[len(kept)] = found.fit.apply(picture, found.pictures.names[place])
            kept.append(done)
        except (DataError, InputError) as error:
            if not drop:
                raise type(error)(
                    f"{error}; what is stored stays: mend it and go on with --resume, or leave such pictures "
                    "out with --resume --drop-incomplete"
                ) from error
        progress(done + 1)
    rows = part[kept]
    frames = Frames(
        schema=readings.schema,
        images=images[: len(kept)],
        sensors=readings.sensors[rows],
        commands=readings.commands[rows],
        pose=np.zeros((len(rows), 0)),
        design=readings.sequence[rows],
        family=np.zeros(len(rows), np.int8),
        scenario=np.zeros(len(rows), np.int8),
        step=readings.step[rows],
    )
    times = {} if readings.time is None else {"time": readings.time[rows]}
    record = ChunkRecord(
        job=identity(_chunk_job(found, part)),
        number=number,
        entry=write_chunk(folder, number, frames, times) if len(rows) else None,
        dofs=0,
        kept=(len(rows),),
        dropped={UNREADABLE: len(part) - len(rows)},
    )
    write_record(folder, record)
    return record


def _finish(found: Import, folder: Path, records: list[ChunkRecord]) -> Manifest:
    """Card and manifest of a folder that has all its chunks."""
    readings = found.readings
    chunks = tuple(record.entry for record in records if record.entry)
    if (folder / MANIFEST).exists():
        manifest = read_manifest(folder)
        if manifest.chunks == chunks:
            return manifest
        (folder / MANIFEST).unlink()
    unreadable = sum(record.dropped[UNREADABLE] for record in records)
    manifest = new_manifest(
        config=found.config,
        seed=int(readings.sha256[:13], 16),  # below 2⁵³, which every JSON reader keeps
        system=readings.schema.system,
        schema=readings.schema,
        description=None,
        camera=None,
        dofs=0,
        families=(MEASURED,),
        scenarios=(MEASURED,),
        designs=readings.sequences,
        chunks=chunks,
        dropped={**found.dropped, UNREADABLE: unreadable},
    )
    write_card(folder, manifest, [*found.notes, *found.pictures.notes])
    write_manifest(folder, manifest)
    return manifest
