"""Recordings of ROS 1 and 2, written by the library and read back, beside the same data as files and a
table."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from own_data import imported, pictures_of, readings_of

from exosight.dataset import read_frames
from exosight.errors import DataError, ExosightError, InputError
from exosight.rig.bags import open_bags

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="needs the extra 'ros'")
rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra 'ros'")
typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra 'ros'")

COUNT, PERIOD, LATE = 12, 100_000_000, 3_000_000  # ns between pictures, and from a picture to its reading
START = 1_700_000_000_000_000_000
STORES = {
    "ros1": typesys.get_typestore(typesys.Stores.ROS1_NOETIC),
    "ros2": typesys.get_typestore(typesys.Stores.ROS2_HUMBLE),
}
Write = Callable[..., Path]


class Recorder:
    """Messages into one bag."""

    def __init__(self, path: Path, kind: str) -> None:
        self.kind, self.store = kind, STORES["ros1" if kind == "bag" else "ros2"]
        if kind == "bag":
            self.writer = rosbag1.Writer(path)
        else:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            self.writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        self.writer.open()
        self.connections: dict[str, Any] = {}

    def make(self, name: str, *values: Any, **entries: Any) -> Any:
        return self.store.types[name](*values, **entries)

    def header(self, stamp: int) -> Any:
        time = self.make("builtin_interfaces/msg/Time", stamp // 10**9, stamp % 10**9)
        return self.make("std_msgs/msg/Header", *([0] if self.kind == "bag" else []), time, "")

    def write(self, topic: str, message: Any, at: int) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        pack = self.store.serialize_ros1 if self.kind == "bag" else self.store.serialize_cdr
        self.writer.write(self.connections[topic], at, pack(message, kind))

    def image(
        self, topic: str, picture: np.ndarray, stamp: int, encoding: str = "mono8", **changes: Any
    ) -> None:
        rows, columns = picture.shape[:2]
        data = np.frombuffer(picture.tobytes(), np.uint8)
        entries = {
            "header": self.header(stamp),
            "height": rows,
            "width": columns,
            "encoding": encoding,
            "is_bigendian": 0,
            "step": len(data) // rows,
            "data": data,
        }
        # Recorded a tenth of a second late: the header's stamp is what counts.
        self.write(topic, self.make("sensor_msgs/msg/Image", **entries | changes), stamp + 100_000_000)

    def wrench(self, topic: str, force: float, torque: float, stamp: int) -> None:
        zero = 0.0
        parts = (
            self.make("geometry_msgs/msg/Vector3", zero, zero, force),
            self.make("geometry_msgs/msg/Vector3", torque, zero, zero),
        )
        wrench = self.make("geometry_msgs/msg/Wrench", *parts)
        self.write(topic, self.make("geometry_msgs/msg/WrenchStamped", self.header(stamp), wrench), stamp)

    def number(self, topic: str, value: float, at: int) -> None:
        self.write(topic, self.make("std_msgs/msg/Float64", value), at)

    def close(self) -> None:
        self.writer.close()


@pytest.fixture
def record(tmp_path: Path) -> Write:
    """Write a bag of twelve pictures with readings: record(name, kind, start, …)."""

    def call(name: str, kind: str = "mcap", start: int = START, late: int = LATE, **image: Any) -> Path:
        path = tmp_path / name
        recorder = Recorder(path, kind)
        readings = readings_of(COUNT)
        for place, picture in enumerate(pictures_of(COUNT, seed=start % 97)):
            stamp = start + place * PERIOD
            recorder.image("/camera/image_raw", picture, stamp, **image)
            recorder.wrench("/ft/wrench", *readings[place].tolist(), stamp + late)
            # Another topic, three times as often.
            for part in (-1, 0, 1):
                recorder.number("/valve/pressure", place + part / 10, stamp + part * PERIOD // 3)
        recorder.close()
        return path

    return call


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_it_is_the_same_as_pictures_and_a_table(kind: str, record: Write, tmp_path: Path) -> None:
    bag = record("run.bag" if kind == "bag" else "run", kind)
    manifest = imported(bag, tmp_path / "data", sensors=("ft_wrench_fz", "ft_wrench_tx"), stretches=4)
    frames = read_frames(tmp_path / "data")
    np.testing.assert_array_equal(frames.images, pictures_of(COUNT, seed=START % 97))
    np.testing.assert_array_equal(frames.labels, readings_of(COUNT).astype(np.float32))
    found = [(sensor.name, sensor.unit) for sensor in manifest.schema.sensors]
    assert found == [("ft_wrench_fz", "N"), ("ft_wrench_tx", "N m")]
    assert len(manifest.designs) == 1  # one recording is one sequence


def test_a_file_of_a_bag_is_read_alone(record: Write, tmp_path: Path) -> None:
    (file,) = record("run", "mcap").glob("*.mcap")
    assert imported(file, tmp_path / "data", sensors=("ft_wrench_fz",)).frames == COUNT


def test_several_recordings_are_sequences(record: Write, tmp_path: Path) -> None:
    for number in (10, 9):
        record(f"bags/run_{number}", "mcap", START + number * 10**12)
    (tmp_path / "bags" / "notes.txt").write_text("of the afternoon")
    manifest = imported(tmp_path / "bags", tmp_path / "data", sensors=("ft_wrench_fz",))
    assert [design.parameters["name"] for design in manifest.designs] == ["run_9", "run_10"]
    assert manifest.frames == 2 * COUNT
    np.testing.assert_array_equal(
        read_frames(tmp_path / "data").images[:COUNT], pictures_of(COUNT, seed=(START + 9 * 10**12) % 97)
    )


def test_the_nearest_reading_counts(record: Write) -> None:
    with open_bags([record("run")], None, 0.02) as (pictures, table):
        assert table is not None
        assert table.column("valve_pressure").numbers.tolist() == list(range(COUNT))
        assert table.column("time").numbers == pytest.approx(pictures.times)
        assert "at most" in pictures.notes[0]


def test_pictures_without_a_reading_in_time_are_refused_or_left_out(record: Write, tmp_path: Path) -> None:
    bag = record("run", late=25_000_000)
    with pytest.raises(InputError, match="empty"):
        imported(bag, tmp_path / "data", sensors=("ft_wrench_fz",))
    assert imported(bag, tmp_path / "data", sensors=("ft_wrench_fz",), tolerance=0.03).frames == COUNT


@pytest.mark.parametrize(
    ("encoding", "pack"),
    [
        ("rgb8", lambda gray: np.repeat(gray[:, :, None], 3, 2)),
        ("bgra8", lambda gray: np.repeat(gray[:, :, None], 4, 2)),
        ("mono16", lambda gray: gray.astype("<u2") << 8),
        ("yuv422_yuy2", lambda gray: np.stack([gray, 255 - gray], 2)),
    ],
)
def test_every_encoding_gives_the_same_grays(
    encoding: str, pack: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    recorder = Recorder(tmp_path / "run", "mcap")
    grays = pictures_of(2)
    for place, gray in enumerate(grays):
        recorder.image("/image", pack(gray), START + place, encoding)
    recorder.close()
    with open_bags([tmp_path / "run"], None, 0.02, own_table=False) as (pictures, _):
        for place in (1, 0, 1):
            # Weights of the three colours are rounded.
            assert np.abs(pictures.picture(place).astype(int) - grays[place]).max() <= 1


def test_rows_may_be_padded_and_pictures_compressed(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run", "mcap")
    grays = pictures_of(2)
    padded = np.pad(grays[0], ((0, 0), (0, 12)))
    recorder.image("/image", padded, START, width=grays.shape[2])
    content = np.frombuffer(cv2.imencode(".png", grays[1])[1].tobytes(), np.uint8)
    recorder.write(
        "/png",
        recorder.make("sensor_msgs/msg/CompressedImage", recorder.header(START), "png", content),
        START,
    )
    recorder.close()
    for topic, gray in zip(("/image", "/png"), grays, strict=True):
        with open_bags([tmp_path / "run"], topic, 0.02, own_table=False) as (pictures, _):
            np.testing.assert_array_equal(pictures.picture(0), gray)
    with pytest.raises(InputError, match="expected one topic of pictures, got /image, /png; choose one"):
        imported(tmp_path / "run", tmp_path / "data")
    with pytest.raises(InputError, match="expected a topic of pictures, /image, /png, got /depth"):
        imported(tmp_path / "run", tmp_path / "data", images="/depth")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"encoding": "bayer_rggb8"}, "expected one of the encodings"),
        ({"height": 10**5, "width": 10**5}, "up to 40 million pixels"),
        ({"height": 33}, "the recording is damaged"),
        ({"width": 37}, "the recording is damaged"),
        ({"height": 0}, "up to 40 million pixels"),
    ],
)
def test_pictures_that_are_not_what_they_say_are_one_sentence(
    record: Write, tmp_path: Path, changes: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(DataError, match=sentence):
        imported(record("run", **changes), tmp_path / "data")


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_a_truncated_recording_is_one_sentence(kind: str, record: Write, tmp_path: Path) -> None:
    path = record("run.bag" if kind == "bag" else "run", kind)
    (file,) = [path] if path.is_file() else path.glob(f"*.{kind}")
    content = file.read_bytes()
    for share in (0.0, 0.01, 0.5, 0.9):
        file.write_bytes(content[: int(share * len(content))])
        with pytest.raises(ExosightError):
            imported(path, tmp_path / "data")


def test_metadata_do_not_lead_out_of_the_folder(record: Write, tmp_path: Path) -> None:
    path = record("run")
    (file,) = path.glob("*.mcap")
    file.rename(tmp_path / file.name)
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(file.name, f"../{file.name}"))
    with pytest.raises(DataError, match="no recording of ROS that can be read"):
        imported(path, tmp_path / "data")


def test_a_recording_of_pictures_alone_takes_a_table(write: Write, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run", "mcap")
    for place, picture in enumerate(pictures_of(COUNT)):
        recorder.image("/image", picture, START + place * PERIOD)
    recorder.close()
    with pytest.raises(InputError, match="expected a topic of readings"):
        imported(tmp_path / "run", tmp_path / "data")
    rows = [(START / 1e9 + k / 100, k) for k in range(120)]
    imported(tmp_path / "run", tmp_path / "data", write(("time [s]", "f [N]"), rows))
    assert read_frames(tmp_path / "data").reading("f").tolist() == [10.0 * k for k in range(COUNT)]
