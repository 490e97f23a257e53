"""Cameras and video files as OpenCV opens them, without a word on stderr."""

import os
from pathlib import Path
from typing import Any

import cv2

from exosight.errors import DataError
from exosight.files import open_file
from exosight.vision.pictures import LARGEST_PICTURE

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # else FFmpeg prints its complaints to stderr

VIDEOS = ((0, b"RIFF"), (4, b"ftyp"), (0, b"\x1a\x45\xdf\xa3"))
"""What a video file holds at which byte: AVI; MP4 and MOV; Matroska and WebM. Nothing else is opened: FFmpeg
also takes playlists, which lead to other files and hosts."""


def open_camera(number: int, complaint: str) -> Any:
    """The camera of this number as an OpenCV capture; DataError with this complaint if there is none."""
    return _opened(number, cv2.CAP_ANY, complaint)


def open_video(path: Path) -> Any:
    """A video file as an OpenCV capture; DataError if it cannot be read, or if its pictures are too large."""
    with open_file(path, "expected a video") as file:
        beginning = file.read(16)
    if not any(beginning[at:].startswith(mark) for at, mark in VIDEOS):
        raise DataError(unreadable(path))
    # OpenCV's own readers, tried after FFmpeg, take a name as a pattern and print their complaints.
    capture = _opened(str(path), cv2.CAP_FFMPEG, unreadable(path))
    columns, rows = (int(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if columns * rows > LARGEST_PICTURE:
        capture.release()
        raise DataError(
            f"{path}: {columns}×{rows} pixels, up to {LARGEST_PICTURE // 10**6} million are read; "
            "make it smaller"
        )
    return capture


def unreadable(path: Path) -> str:
    """The sentence for a video that cannot be read."""
    return f"{path}: not a video that can be read; give an MP4, MOV, AVI, MKV or WebM file"


def _opened(what: str | int, backend: int, complaint: str) -> Any:
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)  # it would report every backend that it tries
    try:
        capture = cv2.VideoCapture(what, backend)
    finally:
        log.setLogLevel(level)
    if not capture.isOpened():
        raise DataError(complaint)
    return capture
