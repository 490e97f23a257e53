"""Where frames come from, live or from files: a camera, a video, a folder of pictures.

A source is any iterator of frames, so a generator of one's own is one too. It yields the newest frame each
time it is asked, or None if there is none, and ends when no more will come.
"""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from exosight.errors import DataError, InputError
from exosight.vision.capture import open_camera, open_video, unreadable
from exosight.vision.pictures import (
    ENDINGS,
    CameraCrop,
    Crop,
    crop_of,
    cropped,
    middle_of,
    natural_order,
    read_gray,
)

GIVEN_UP = 5.0
"""Time without a frame after which a camera is given up [s]; the guard has released long before."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of the plant.

    image     (height, width)  gray 0…255, as the network takes it
    time      when it was taken, on the clock of the loop [s]
    commands  (channels,)  that the plant reports with it [each in its channel's unit]; None: it reports none
    outputs   (outputs,)   true readings of the estimated sensors [each in its unit]; None: unknown
    """

    image: UInt8[np.ndarray, "height width"]
    time: float
    commands: Float[np.ndarray, " channels"] | None = None
    outputs: Float[np.ndarray, " outputs"] | None = None


Source = Iterator[Frame | None]
FrameStream = Generator[Frame | None, None, None]
"""A source that is to be closed in the end."""

Fit = Callable[[np.ndarray], UInt8[np.ndarray, "height width"]]
"""From a picture as a camera gives it to the one that the network takes: `fitted`."""


def open_source(
    name: str,
    width: int,
    height: int,
    crop: Crop | CameraCrop | None = None,
    unread: Callable[[str], None] = lambda fault: None,
) -> FrameStream:
    """The frames of a camera ("0", "1", …), a folder of pictures, or a video file.

    One frame is read at once, so that what is wrong with the source is raised here.

    width, height  of the pictures that the network takes [pixels]
    crop           the part of each picture that it gets; by default the largest in the middle, of a folder's
                   pictures all
    unread         called with what is wrong with a picture of a folder that is left out

    Raises InputError if there is no such source or the crop leaves its pictures, DataError if it cannot be
    read.
    """
    if name.isdecimal():
        return camera(int(name), width, height, crop)
    path = Path(name)
    if path.is_dir():
        return pictures(path, width, height, crop, unread)
    if path.is_file():
        return video(path, width, height, crop)
    raise InputError(
        f"source: expected a camera's number, a folder of pictures or a video file, got {name!r}"
    )


def pictures(
    folder: Path,
    width: int,
    height: int,
    crop: Crop | CameraCrop | None = None,
    unread: Callable[[str], None] = lambda fault: None,
) -> FrameStream:
    """The pictures of a folder in the order of their names (img_9 before img_10), one each time.

    In place of one that cannot be read there is no frame, and `unread` is called with the reason.

    Raises DataError if there are none, or if the first cannot be read.
    """
    found = (path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    files = sorted(found, key=lambda path: natural_order(path.name))
    if not files:
        raise DataError(f"{folder}: no pictures in it; expected files that end in {', '.join(ENDINGS)}")
    read_gray(files[0], width, height, crop)

    def frames() -> FrameStream:
        for path in files:
            try:
                yield Frame(read_gray(path, width, height, crop), time.monotonic())
            except (DataError, InputError) as error:
                unread(str(error))
                yield None

    return frames()


def video(path: Path, width: int, height: int, crop: Crop | CameraCrop | None = None) -> FrameStream:
    """The frames of a video file, one each time, none left out.

    Raises DataError if it cannot be read, or if its pictures are too large.
    """
    capture = open_video(path)
    taken, picture = capture.read()
    if not taken:
        raise DataError(unreadable(path))
    fit = partial(fitted, width=width, height=height, crop=crop, name=str(path))
    fit(picture)
    return _frames(capture, picture, fit)


def _frames(capture: Any, picture: np.ndarray | None, fit: Fit) -> FrameStream:
    try:
        while picture is not None:
            yield Frame(fit(picture), time.monotonic())
            _, picture = capture.read()
    finally:
        capture.release()


def camera(number: int, width: int, height: int, crop: Crop | CameraCrop | None = None) -> FrameStream:
    """The newest frame of a camera, the same again if there is no newer one.

    A thread of its own empties the camera's buffer, so that no frame waits in it; the time of a frame is that
    of its arrival.

    Raises DataError if there is no such camera, or if it gives no frame for 5 s.
    """
    capture = open_camera(
        number, f"camera {number}: cannot be opened; is it connected, and used by no other program?"
    )
    fit = partial(fitted, width=width, height=height, crop=crop, name=f"camera {number}")
    frames = _newest(capture, number, fit)
    while next(frames) is None:
        time.sleep(0.01)
    return frames


def _newest(capture: Any, number: int, fit: Fit) -> FrameStream:
    with _grabbing(capture) as grabbed:
        last, frame = time.monotonic(), None
        while True:
            if grabbed and (frame is None or grabbed[0][1] > frame.time):
                picture, last = grabbed[0]
                frame = Frame(fit(picture), last)
            elif time.monotonic() - last > GIVEN_UP:
                raise DataError(f"camera {number}: no frame for {GIVEN_UP:g} s; check its cable, start again")
            yield frame


@contextmanager
def _grabbing(capture: Any) -> Iterator[list[tuple[np.ndarray, float]]]:
    """A list that holds the newest picture and its time, kept so by a thread."""
    grabbed: list[tuple[np.ndarray, float]] = []
    stop = Event()

    def grab() -> None:
        while not stop.is_set():
            taken, picture = capture.read()
            if taken:
                grabbed[:] = [(picture, time.monotonic())]
            else:
                stop.wait(0.01)  # unplugged: it answers at once, and would fill a core

    thread = Thread(target=grab, name="camera", daemon=True)
    thread.start()
    try:
        yield grabbed
    finally:
        stop.set()
        thread.join(timeout=2)
        if not thread.is_alive():  # a driver that hangs in `read` must not be taken away from under it
            capture.release()


def fitted(
    picture: np.ndarray, width: int, height: int, crop: Crop | CameraCrop | None, name: str
) -> np.ndarray:
    """A camera's picture, cropped, gray and in the size that the network takes.

    picture  (rows, columns) gray or (rows, columns, 3) blue, green, red, 0…255
    crop     by default the largest part in the middle
    name     of the source, for messages
    returns  (height, width)  uint8

    Raises InputError if the crop leaves the picture.
    """
    gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    part = crop_of(crop, gray.shape) or middle_of(gray.shape, width, height)
    return cropped(gray, width, height, part, name)
