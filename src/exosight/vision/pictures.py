"""Pictures in files: read as gray, in the size that is wanted."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from exosight.errors import DataError, InputError

LARGEST_FILE = 256 * 2**20  # [bytes]
LARGEST_SIDE = 16_384  # [pixels]

Crop = tuple[int, int, int]
"""Left edge, upper edge and width [pixels] of the part of a picture that the network gets; its height follows
from the network's aspect ratio."""


def read_gray(
    path: Path, width: int, height: int, crop: Crop | None = None
) -> UInt8[np.ndarray, "height width"]:
    """A picture file (PNG, JPEG, TIFF, …) as gray values 0…255; see `decode_gray`.

    Raises DataError if the file is missing or too large, and what `decode_gray` raises.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise DataError(f"{path}: {size >> 20} MiB, pictures of up to {LARGEST_FILE >> 20} MiB are read")
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); expected a picture") from error
    return decode_gray(data, str(path), width, height, crop)


def decode_gray(
    data: bytes, name: str, width: int, height: int, crop: Crop | None = None
) -> UInt8[np.ndarray, "height width"]:
    """The content of a picture file as gray values 0…255, shrunk or enlarged to the size wanted.

    Colours become gray by Rec. 601; transparency is ignored. An area shrinks to its mean.

    name            of the file, for messages
    width, height   [pixels]
    crop            the part that is taken; by default all of it

    Raises DataError if it is no picture, damaged, too large, or without a crop of another aspect ratio: a
    stretched picture shows another pose. Raises InputError if the crop leaves the picture.
    """
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    except cv2.error:
        picture = None
    if picture is None:
        raise DataError(f"{name}: not a picture that can be read, or damaged; give a PNG, JPEG or TIFF file")
    rows, columns = picture.shape
    if max(rows, columns) > LARGEST_SIDE:
        raise DataError(f"{name}: {columns}×{rows} pixels, at most {LARGEST_SIDE} a side are read")
    if crop is not None:
        return cropped(picture, width, height, crop, name)
    # Within one pixel of the smaller picture.
    if abs(columns * height - rows * width) > max(rows, columns, width, height):
        expected = "a square picture" if width == height else f"the aspect ratio {width}:{height}"
        middle = "--crop {} {} {}".format(*middle_of((rows, columns), width, height))
        raise DataError(
            f"{name}: expected {expected}, got {columns}×{rows} pixels; crop it, {middle} takes its middle"
        )
    return resized(picture, width, height)


def cropped(
    picture: UInt8[np.ndarray, "rows columns"], width: int, height: int, crop: Crop, name: str
) -> UInt8[np.ndarray, "height width"]:
    """A part of a gray picture in the size that the network takes [pixels].

    name   of the picture, for messages

    Raises InputError if the crop leaves the picture.
    """
    (rows, columns), (left, top, side) = picture.shape, crop
    high = max(1, round(side * height / width))
    if not (left >= 0 and top >= 0 and side >= 1 and left + side <= columns and top + high <= rows):
        raise InputError(
            f"crop: expected left, top and width of {side}×{high} pixels within the {columns}×{rows} of "
            f"{name}, got {left} {top} {side}"
        )
    return resized(picture[top : top + high, left : left + side], width, height)


def middle_of(shape: tuple[int, int], width: int, height: int) -> Crop:
    """The largest part with the network's aspect ratio, in the middle of a picture of (rows, columns)."""
    rows, columns = shape
    side = max(1, min(columns, rows * width // height))
    return (columns - side) // 2, (rows - max(1, side * height // width)) // 2, side


def resized(
    picture: UInt8[np.ndarray, "rows columns"], width: int, height: int
) -> UInt8[np.ndarray, "height width"]:
    """A gray picture in another size [pixels]; an area shrinks to its mean."""
    shrinking = picture.shape[1] > width
    return cv2.resize(
        picture, (width, height), interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_LINEAR
    )
