"""Where frames come from, live or from files: a camera, a video, a folder of pictures.

A source is any iterator of frames, so a generator of one's own is one too. It yields the newest frame each
time it is asked, or None if there is none, and ends when no more will come.
"""

import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from exosight.errors import DataError, InputError
from exosight.vision.pictures import read_gray, resized

GIVEN_UP = 5.0
"""Time without a frame after which a camera is given up [s]; the guard has released long before."""

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
"""Names of picture files end so."""

Crop = tuple[int, int, int]
"""Left edge, upper edge and width [pixels] of the part of a camera's picture that the network gets."""


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


def open_source(name: str, width: int, height: int, crop: Crop | None = None) -> FrameStream:
    """The frames of a camera ("0", "1", …), a folder of pictures, or a video file.

    width, height  of the pictures that the network takes [pixels]
    crop           the part of a camera's or video's picture that it gets; by default the largest in
                   the middle

    Raises InputError if there is no such source, DataError if it cannot be read.
    """
    if name.isdecimal():
        return camera(int(name), width, height, crop)
    path = Path(name)
    if path.is_dir():
        return pictures(path, width, height)
    if path.is_file():
        return video(path, width, height, crop)
    raise InputError(
        f"source: expected a camera's number, a folder of pictures or a video file, got {name!r}"
    )


def pictures(folder: Path, width: int, height: int) -> FrameStream:
    """The pictures of a folder in the order of their names, one each time; DataError if there are none."""
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)
    if not files:
        raise DataError(f"{folder}: no pictures in it; expected files that end in {', '.join(PICTURES)}")
    # A generator of its own: what is wrong with the folder is raised at once, not at the first frame.
    return (Frame(read_gray(path, width, height), time.monotonic()) for path in files)


def video(path: Path, width: int, height: int, crop: Crop | None = None) -> FrameStream:
    """The frames of a video file, one each time, none left out; DataError if it cannot be read."""
    capture = _opened(str(path), f"{path}: not a video that can be read; give an MP4 or AVI file")
    shape = round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)), round(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
    _part(shape, width, height, crop)  # refuses a crop now, not at the first frame
    return _frames(capture, width, height, crop)


def _frames(capture: Any, width: int, height: int, crop: Crop | None) -> FrameStream:
    try:
        while True:
            taken, picture = capture.read()
            if not taken:
                return
            yield Frame(fitted(picture, width, height, crop), time.monotonic())
    finally:
        capture.release()


def camera(number: int, width: int, height: int, crop: Crop | None = None) -> FrameStream:
    """The newest frame of a camera, None before the first, the same again if there is no newer one.

    A thread of its own empties the camera's buffer, so that no frame waits in it; the time of a frame is that
    of its arrival.

    Raises DataError if there is no such camera, or if it gives no frame for 5 s.
    """
    capture = _opened(
        number, f"camera {number}: cannot be opened; is it connected, and used by no other program?"
    )
    shape = round(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)), round(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
    try:
        _part(shape, width, height, crop)
    except InputError:
        capture.release()
        raise
    return _newest(capture, number, width, height, crop)


def _newest(capture: Any, number: int, width: int, height: int, crop: Crop | None) -> FrameStream:
    with _grabbing(capture) as grabbed:
        last, frame = time.monotonic(), None
        while True:
            if grabbed and (frame is None or grabbed[0][1] > frame.time):
                picture, last = grabbed[0]
                frame = Frame(fitted(picture, width, height, crop), last)
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


def _opened(what: str | int, complaint: str) -> Any:
    """An OpenCV capture; DataError with this complaint if there is nothing to capture."""
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)  # it would report every backend that it tries
    try:
        capture = cv2.VideoCapture(what)
    finally:
        log.setLogLevel(level)
    if not capture.isOpened():
        raise DataError(complaint)
    return capture


def fitted(picture: np.ndarray, width: int, height: int, crop: Crop | None = None) -> np.ndarray:
    """A camera's picture, cropped, gray and in the size that the network takes.

    picture  (rows, columns) gray or (rows, columns, 3) blue, green, red, 0…255
    returns  (height, width)  uint8

    Raises InputError if the crop leaves the picture.
    """
    left, top, side, rows = _part(picture.shape[:2], width, height, crop)
    part = picture[top : top + rows, left : left + side]
    gray = cv2.cvtColor(part, cv2.COLOR_BGR2GRAY) if part.ndim == 3 else part
    return resized(gray, width, height)


def _part(shape: tuple[int, ...], width: int, height: int, crop: Crop | None) -> tuple[int, int, int, int]:
    """Left, top, columns and rows of what the network gets; InputError if that leaves the picture."""
    rows, columns = shape
    if crop is None:
        side = max(1, min(columns, rows * width // height))
        crop = (columns - side) // 2, (rows - max(1, side * height // width)) // 2, side
    left, top, side = crop
    high = max(1, round(side * height / width))
    if not (left >= 0 and top >= 0 and side >= 1 and left + side <= columns and top + high <= rows):
        raise InputError(
            f"crop: expected left, top and width of {side}×{high} pixels within the {columns}×{rows} of the "
            f"source, got {left}, {top}, {side}"
        )
    return left, top, side, high
