"""A video file as a source of pictures."""

import hashlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float64

from exosight.errors import DataError
from exosight.rig.pictures import Gray
from exosight.vision.capture import open_video, unreadable


class Video:
    """The frames of a video. It is passed through once at first, to count them and to know their times."""

    time_unit = "s"

    def __init__(self, path: Path) -> None:
        self._path = path
        self.notes: list[str] = []
        self._capture: Any = None
        self._next = 0
        capture = open_video(path)
        times = []
        try:
            while capture.grab():
                times.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
            rate = capture.get(cv2.CAP_PROP_FPS)
        finally:
            capture.release()
        if not times:
            raise DataError(unreadable(path))
        found = np.array(times)
        if not (np.isfinite(found).all() and np.all(np.diff(found) > 0)):
            # A container without times of its own: frames come evenly.
            found = np.arange(len(times)) / rate if rate > 0 else np.zeros(0)
        self._times = found if len(found) == len(times) else None
        self.names = tuple(f"{path.name}, frame {place + 1}" for place in range(len(times)))
        self.folders = ("",) * len(times)

    @property
    def times(self) -> Float64[np.ndarray, " pictures"] | None:
        """Since the beginning [s], as the file has them."""
        return self._times

    @property
    def fingerprint(self) -> str:
        """Of the file's size and its number of frames."""
        size = self._path.stat().st_size
        return hashlib.sha256(f"{size} {len(self.names)}".encode()).hexdigest()

    def picture(self, place: int) -> Gray:
        """A frame; those before it are passed over."""
        if self._capture is None or place < self._next:
            self.close()
            self._capture, self._next = open_video(self._path), 0
        reached = all(self._capture.grab() for _ in range(place + 1 - self._next))
        picture = self._capture.retrieve()[1] if reached else None
        self._next = place + 1
        if picture is None:
            raise DataError(f"{self.names[place]}: cannot be read; the file is truncated or damaged there")
        return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture

    def close(self) -> None:
        """Release the file."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None
