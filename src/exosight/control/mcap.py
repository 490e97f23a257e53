"""A recording as one MCAP file with messages of ROS 2, which Foxglove, PlotJuggler and `ros2 bag` read.

Every step writes messages at its time, in nanoseconds after the first; what a step did not have it
leaves out. Values are `std_msgs/Float64`, in the units that the recording has.

/camera/image        sensor_msgs/Image, mono8
/target, /command    of the controlled sensor, of the driven channel
/estimated/NAME      of every estimated sensor, /low/NAME and /high/NAME the ends of its interval
/true/NAME           where the true reading is known
/ood_score, /age     of the frame
/state               std_msgs/String: the guard's state, and why it changed
"""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from exosight.control.recording import STATES, Recording
from exosight.errors import DataError, InputError
from exosight.files import check_absent, unfinished, write_error

ENDING = ".mcap"
IMAGE, STRING, NUMBER = "sensor_msgs/msg/Image", "std_msgs/msg/String", "std_msgs/msg/Float64"


def export_recording(
    recording: Recording, out: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> None:
    """Write a recording as a new file *.mcap.

    progress   called with the steps written and their total

    Raises InputError without the library rosbags; DataError if the file exists or cannot be written, or an
    image of the recording is damaged.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError as error:
        raise InputError(
            f"{out}: MCAP needs {error.name}, which is not installed: pip install 'exosight[ros]'"
        ) from error
    check_absent(out)
    store, connections = get_typestore(Stores.ROS2_HUMBLE), {}
    try:
        with unfinished(out) as part:
            with Writer(part, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
                for k, image in enumerate(recording.images()):
                    at = round(1e9 * float(recording.time[k] - recording.time[0]))
                    for topic, kind, message in _messages(recording, k, at, image, store.types):
                        if topic not in connections:
                            connections[topic] = writer.add_connection(topic, kind, typestore=store)
                        writer.write(connections[topic], at, store.serialize_cdr(message, kind))
                    progress(k + 1, len(recording))
            (file,) = part.glob(f"*{ENDING}")
            os.replace(file, out)
    except OSError as error:
        raise DataError(str(write_error(out, error))) from error


def _messages(
    recording: Recording, k: int, at: int, image: np.ndarray, types: Any
) -> Iterator[tuple[str, str, Any]]:
    """Topic, type and content of what a step says."""
    if recording.has_frame[k]:
        header = types["std_msgs/msg/Header"](
            types["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9), "camera"
        )
        rows, columns = image.shape
        yield (
            "/camera/image",
            IMAGE,
            types[IMAGE](header, rows, columns, "mono8", 0, columns, np.ascontiguousarray(image).ravel()),
        )
    for topic, value in _values(recording, k):
        yield topic, NUMBER, types[NUMBER](float(value))
    state = STATES[recording.state[k]].value
    cause = recording.cause[k].decode(errors="replace")
    yield "/state", STRING, types[STRING](f"{state}: {cause}" if cause else state)


def _values(recording: Recording, k: int) -> Iterator[tuple[str, float]]:
    yield "/target", recording.target[k]
    yield "/command", recording.command[k]
    names = recording.controller.schema.outputs
    if recording.has_frame[k]:
        yield "/age", recording.age[k]
    if recording.has_estimate[k]:
        yield "/ood_score", recording.ood_score[k]
        for what in ("estimated", "low", "high"):
            for name, value in zip(names, getattr(recording, what)[k], strict=True):
                yield f"/{what}/{name}", value
    for name, value in zip(names, recording.true[k], strict=True):
        if np.isfinite(value):
            yield f"/true/{name}", value
