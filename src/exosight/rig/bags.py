"""Recordings of ROS: bags of ROS 1 (.bag) and ROS 2 (folders, .mcap, .db3) as pictures and readings.

Each picture gets of every topic the reading that is nearest in time, by the stamps in the messages' headers
where there are any, else by when they were recorded. Read by the library `rosbags`, which needs no ROS.
"""

import hashlib
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float64

from exosight.errors import DataError, InputError
from exosight.rig.pictures import Gray, upper_bits
from exosight.rig.table import ReadingTable, column_of, short_heading
from exosight.validation import check_unique
from exosight.vision.pictures import LARGEST_PICTURE, decode, natural_order

ENDINGS = (".mcap", ".db3", ".bag")
METADATA = "metadata.yaml"
"""What makes a folder a bag of ROS 2."""
PICTURES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
SEQUENCE = "recording"
"""Column with the name of the bag."""

_LARGEST_PIXEL = 8  # bytes: four colours of 16 bits
_MOST_VALUES = 64  # of one message
_COLOURS = {
    "rgb8": cv2.COLOR_RGB2GRAY,
    "bgr8": cv2.COLOR_BGR2GRAY,
    "rgba8": cv2.COLOR_RGBA2GRAY,
    "bgra8": cv2.COLOR_BGRA2GRAY,
}
_BRIGHTNESS = {"yuv422_yuy2": 0, "yuyv": 0, "yuv422": 1, "uyvy": 1}
"""Which of two bytes a pixel is the brightness."""
_GRAYS = {"mono8": 1, "8UC1": 1, "mono16": 2, "16UC1": 2}
"""Bytes a pixel."""

Values = list[tuple[str, str | None, float]]
"""Name, unit and value of what a message says."""


def _wrench(message: Any) -> Values:
    wrench = getattr(message, "wrench", message)
    forces = [(f"f{axis}", "N", getattr(wrench.force, axis)) for axis in "xyz"]
    return [*forces, *((f"t{axis}", "N m", getattr(wrench.torque, axis)) for axis in "xyz")]


def _vector(message: Any) -> Values:
    vector = getattr(message, "vector", message)
    return [(axis, None, getattr(vector, axis)) for axis in "xyz"]


def _number(message: Any) -> Values:
    return [("", None, message.data)]


def _numbers(message: Any) -> Values:
    return [(str(place), None, value) for place, value in enumerate(message.data)]


def _joints(message: Any) -> Values:
    parts = (("position", "rad"), ("velocity", "rad/s"), ("effort", "N m"))
    return [
        (f"{name}_{part}", unit, value)
        for part, unit in parts
        for name, value in zip(message.name, getattr(message, part), strict=False)
    ]


READINGS: dict[str, Callable[[Any], Values]] = {
    "geometry_msgs/msg/Wrench": _wrench,
    "geometry_msgs/msg/WrenchStamped": _wrench,
    "geometry_msgs/msg/Vector3": _vector,
    "geometry_msgs/msg/Vector3Stamped": _vector,
    "sensor_msgs/msg/FluidPressure": lambda message: [("", "Pa", message.fluid_pressure)],
    "sensor_msgs/msg/JointState": _joints,
    "std_msgs/msg/Float32": _number,
    "std_msgs/msg/Float64": _number,
    "std_msgs/msg/Float32MultiArray": _numbers,
    "std_msgs/msg/Float64MultiArray": _numbers,
}
"""Types of messages that hold readings."""


def bags_in(source: Path) -> list[Path]:
    """The bags that a path stands for: itself, or those in it; none where it is something else."""
    if source.suffix.lower() in ENDINGS or (source / METADATA).is_file():
        return [source]
    if not source.is_dir():
        return []
    return sorted(
        (path for path in source.iterdir() if path.suffix.lower() in ENDINGS or (path / METADATA).is_file()),
        key=lambda path: natural_order(path.name),
    )


@contextmanager
def open_bags(
    paths: Sequence[Path], topic: str | None, tolerance: float, *, own_table: bool = True
) -> Iterator[tuple["BagPictures", ReadingTable | None]]:
    """The pictures of one topic in all bags, and a table with a row for each, unless another is given.

    topic      of the pictures; None: the only one
    tolerance  largest difference in time between a picture and a reading [s]

    Raises DataError for a bag that cannot be read; InputError if it holds no pictures, or several topics of
    them and none is named, or no readings.
    """
    with ExitStack() as stack:
        bags = [stack.enter_context(_bag(path)) for path in paths]
        chosen = _picture_topic(bags, topic)
        pictures = BagPictures(bags, chosen)
        yield pictures, _table(bags, pictures, tolerance) if own_table else None


@dataclass(frozen=True)
class _Bag:
    path: Path
    reader: Any
    """rosbags.highlevel.AnyReader"""

    def connections(self, kinds: Sequence[str], topic: str | None = None) -> list[Any]:
        """Of topics of some types."""
        return [c for c in self.reader.connections if c.msgtype in kinds and topic in (None, c.topic)]

    def messages(self, connections: list[Any]) -> Iterator[tuple[str, str, int, bytes]]:
        """Topic, type, time of recording [ns] and content of each, in the order of recording."""
        with _readable(self.path):
            for connection, time, data in self.reader.messages(connections) if connections else ():
                yield connection.topic, connection.msgtype, time, data

    def message(self, data: bytes, kind: str) -> Any:
        with _readable(self.path):
            return self.reader.deserialize(data, kind)


@contextmanager
def _bag(path: Path) -> Iterator[_Bag]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError as error:
        raise InputError(
            f"{path}: recordings of ROS need {error.name}, which is not installed: pip install "
            "'exosight[ros]'"
        ) from error
    with _readable(path):
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    try:
        yield _Bag(path, reader)
    finally:
        reader.close()


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except (DataError, InputError, MemoryError):
        raise
    except Exception as error:  # the library's parsers fail in many ways on what is cut short
        raise DataError(
            f"{path}: no recording of ROS that can be read, or truncated ({type(error).__name__}); make it "
            "whole, such as with ros2 bag reindex"
        ) from error


def _picture_topic(bags: Sequence[_Bag], asked: str | None) -> str:
    topics = list(dict.fromkeys(c.topic for bag in bags for c in bag.connections(PICTURES)))
    shown = ", ".join(topics) or "none"
    if asked is not None and asked not in topics:
        raise InputError(f"--images: expected a topic of pictures, {shown}, got {asked}")
    if asked is None and len(topics) != 1:
        raise InputError(
            f"{bags[0].path}: expected one topic of pictures, got {shown}; "
            + ("choose one with --images" if topics else f"record one of type {' or '.join(PICTURES)}")
        )
    return asked or topics[0]


@dataclass
class BagPictures:
    """The pictures of one topic, bag after bag."""

    bags: Sequence[_Bag]
    topic: str
    names: tuple[str, ...] = field(init=False)
    folders: tuple[str, ...] = field(init=False)
    times: Float64[np.ndarray, " pictures"] = field(init=False)
    """[s], of most recorders since 1970"""
    counts: tuple[int, ...] = field(init=False)
    """pictures of each bag"""
    notes: list[str] = field(default_factory=list)
    time_unit = "s"

    def __post_init__(self) -> None:
        names, folders, stamps, counts = [], [], [], []
        for bag in self.bags:
            before = len(names)
            for place, (_, kind, time, data) in enumerate(self._messages(bag)):
                names.append(f"{bag.path.name} {self.topic}, picture {place + 1}")
                folders.append(bag.path.name)
                stamps.append(_stamp(bag.message(data, kind), time))
            counts.append(len(names) - before)
        self.counts = tuple(counts)
        self.names, self.folders, self.times = tuple(names), tuple(folders), np.array(stamps, float)
        self._stream: Iterator[tuple[_Bag, str, bytes]] = iter(())
        self._next = len(names)

    @property
    def fingerprint(self) -> str:
        """Of the topic and the times of its pictures."""
        digest = hashlib.sha256(f"{self.topic} {self.folders}".encode())
        digest.update(self.times.tobytes())
        return digest.hexdigest()

    def picture(self, place: int) -> Gray:
        """A picture; those before it are passed over."""
        if place < self._next:
            self._stream, self._next = self._read(), 0
        found = None
        while self._next <= place:
            found = next(self._stream, None)
            self._next += 1
        if found is None:
            raise DataError(f"{self.names[place]}: cannot be read; the recording has changed")
        bag, kind, data = found
        return _gray(bag.message(data, kind), self.names[place])

    def _read(self) -> Iterator[tuple[_Bag, str, bytes]]:
        for bag in self.bags:
            for _, kind, _, data in self._messages(bag):
                yield bag, kind, data

    def _messages(self, bag: _Bag) -> Iterator[tuple[str, str, int, bytes]]:
        return bag.messages(bag.connections(PICTURES, self.topic))


def _stamp(message: Any, recorded: int) -> float:
    """When a message was made [s]: its header's stamp, or when it was recorded [ns]."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    made = 0 if stamp is None else stamp.sec * 10**9 + stamp.nanosec
    return (made or recorded) / 1e9


def _gray(message: Any, name: str) -> Gray:
    """A picture, gray 0…255; DataError for an encoding that is not read, or another size than it says."""
    if hasattr(message, "format"):
        found = decode(bytes(message.data), name)
        return upper_bits(found.gray, name) if found.deep else found.gray
    rows, columns, step, encoding = message.height, message.width, message.step, message.encoding
    if not 1 <= rows * columns <= LARGEST_PICTURE:
        raise DataError(
            f"{name}: expected a picture of up to {LARGEST_PICTURE // 10**6} million pixels, got "
            f"{columns}×{rows}"
        )
    known = {**_GRAYS, **dict.fromkeys(_BRIGHTNESS, 2)}
    known |= {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}
    if encoding not in known:
        raise DataError(
            f"{name}: expected one of the encodings {', '.join(known)}, got {encoding[:32]!r}; "
            "convert the pictures"
        )
    wide = columns * known[encoding]
    if step < wide or step > columns * _LARGEST_PIXEL + 4096 or len(message.data) != rows * step:
        raise DataError(
            f"{name}: {columns}×{rows} pixels of {encoding} in {len(message.data)} bytes of {step} a row; "
            "the recording is damaged"
        )
    plain = np.asarray(message.data, np.uint8).reshape(rows, step)[:, :wide]
    if encoding in _BRIGHTNESS:
        return np.ascontiguousarray(plain[:, _BRIGHTNESS[encoding] :: 2])
    if encoding in _COLOURS:
        return cv2.cvtColor(np.ascontiguousarray(plain).reshape(rows, columns, -1), _COLOURS[encoding])
    if _GRAYS[encoding] == 1:
        return np.ascontiguousarray(plain)
    high = plain[:, 0::2] if message.is_bigendian else plain[:, 1::2]
    return upper_bits(np.ascontiguousarray(high), name)


@dataclass
class _Series:
    """What one topic says over time."""

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    times: list[float]
    rows: list[tuple[float, ...]]


def _table(bags: Sequence[_Bag], pictures: BagPictures, tolerance: float) -> ReadingTable:
    """A row a picture: its bag, its time, and of each topic the reading nearest in time."""
    per_bag = [_series(bag) for bag in bags]
    topics = list(dict.fromkeys(topic for series in per_bag for topic in series))
    if not topics:
        raise InputError(
            f"{bags[0].path}: expected a topic of readings, of type {', '.join(READINGS)}, got none; name "
            "a table with --table"
        )
    bounds = [0, *np.cumsum(pictures.counts).tolist()]
    columns = {SEQUENCE: list(pictures.folders), "time [s]": [repr(float(s)) for s in pictures.times]}
    apart: list[float] = []
    for topic in topics:
        heads = _heads(topic, per_bag, bags)
        cells: list[list[str]] = [[] for _ in heads]
        for series, (first, last) in zip(per_bag, pairwise(bounds), strict=True):
            for stamp in pictures.times[first:last]:
                row, far = _nearest(series.get(topic), float(stamp))
                near = far <= tolerance and len(row) == len(heads)
                if near:
                    apart.append(far)
                for place, cell in enumerate(cells):
                    cell.append(repr(float(row[place])) if near else "")
        columns |= dict(zip(heads, cells, strict=True))
    if apart:
        pictures.notes.append(
            f"readings by time, {1e3 * float(np.median(apart)):.3g} ms apart (median), "
            f"{1e3 * max(apart):.3g} ms at most"
        )
    source = bags[0].path if len(bags) == 1 else bags[0].path.parent
    found = tuple(column_of(head, cells) for head, cells in columns.items())
    check_unique("columns", (column.name for column in found))
    return ReadingTable(str(source), found)


def _series(bag: _Bag) -> dict[str, _Series]:
    found: dict[str, _Series] = {}
    for topic, kind, time, data in bag.messages(bag.connections(tuple(READINGS))):
        message = bag.message(data, kind)
        values = READINGS[kind](message)
        if len(values) > _MOST_VALUES:
            raise InputError(
                f"{bag.path}: expected up to {_MOST_VALUES} values in a message of {topic}, got {len(values)}"
            )
        names, units, row = (tuple(part) for part in zip(*values, strict=True)) if values else ((), (), ())
        series = found.setdefault(topic, _Series(names, units, [], []))
        if names == series.names:  # a message of other joints is none of this series
            series.times.append(_stamp(message, time))
            series.rows.append(row)
    for series in found.values():
        order = np.argsort(series.times, kind="stable")
        series.times = [series.times[place] for place in order]
        series.rows = [series.rows[place] for place in order]
    return found


def _nearest(series: _Series | None, stamp: float) -> tuple[tuple[float, ...], float]:
    """The row nearest in time, and how far from it [s]."""
    if series is None or not series.times:
        return (), np.inf
    after = min(bisect_left(series.times, stamp), len(series.times) - 1)
    place = min((max(after - 1, 0), after), key=lambda k: abs(series.times[k] - stamp))
    return series.rows[place], abs(series.times[place] - stamp)


def _heads(topic: str, per_bag: Sequence[dict[str, _Series]], bags: Sequence[_Bag]) -> list[str]:
    """Headings of a topic's columns: its name, shortened from the left, with what each value is."""
    own = [series[topic] for series in per_bag if topic in series]
    if len({(series.names, series.units) for series in own}) > 1:
        raise InputError(
            f"{bags[0].path.parent}: {topic} holds other values in some recordings; import them apart"
        )
    heads = []
    for name, unit in zip(own[0].names, own[0].units, strict=True):
        full = short_heading([part for part in topic.split("/") if part], name)
        heads.append(full if unit is None else f"{full} [{unit}]")
    return heads
