"""Cameras and video files as OpenCV opens them."""

from typing import Any

import cv2

from exosight.errors import DataError


def open_capture(what: str | int, complaint: str) -> Any:
    """An OpenCV capture of a video file or of the camera of this number.

    complaint   of the DataError that is raised if there is nothing to capture
    """
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
