"""Pictures of unknown origin: read as gray, in the size that is wanted."""

import ctypes
import io
import logging
import re
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import ExifTags, Image, ImageOps, _imaging

from exosight.errors import DataError, InputError
from exosight.files import read_file

LARGEST_FILE = 256 * 2**20  # [bytes]
LARGEST_PICTURE = 40_000_000
"""[pixels]; a camera's picture has fewer, and a small file may claim many more."""
KINDS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP")
"""What is read, as Pillow names it."""
ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
"""Names of picture files end so."""

logging.getLogger("PIL").addHandler(logging.NullHandler())  # else Python prints its complaints to stderr
with suppress(AttributeError, OSError):  # a Pillow without libtiff, or with one that cannot be reached
    # libtiff writes about damaged files to the process's stderr, and Pillow lets it.
    ctypes.CDLL(_imaging.__file__).TIFFSetErrorHandler(None)

Crop = tuple[int, int, int]
"""Left edge, upper edge and width [pixels] of the part of a picture that the network gets; its height follows
from the network's aspect ratio."""


@dataclass(frozen=True)
class CameraCrop:
    """A crop of the pictures of one camera, which others are not cut by.

    shape   rows and columns of its pictures [pixels]
    """

    shape: tuple[int, int]
    crop: Crop

    def of(self, shape: tuple[int, ...]) -> Crop | None:
        """The crop of a picture of (rows, columns); None: it is of another camera."""
        return self.crop if shape == self.shape else None


def crop_of(crop: Crop | CameraCrop | None, shape: tuple[int, ...]) -> Crop | None:
    """The crop of a picture of (rows, columns); None: all of it, or what is usual for its source."""
    return crop.of(shape) if isinstance(crop, CameraCrop) else crop


@dataclass(frozen=True)
class Decoded:
    """A picture as its file has it.

    gray    0…255
    turned  its file says that it is to be turned or mirrored, which is done
    deep    it has 16 bits a pixel, of which the upper 8 are taken
    """

    gray: UInt8[np.ndarray, "rows columns"]
    turned: bool
    deep: bool


def read_gray(
    path: Path, width: int, height: int, crop: Crop | CameraCrop | None = None
) -> UInt8[np.ndarray, "height width"]:
    """A picture file (PNG, JPEG, TIFF, …) as gray values 0…255; see `decode_gray`.

    Raises DataError if the file is missing or too large, and what `decode_gray` raises.
    """
    return decode_gray(read_file(path, LARGEST_FILE, "expected a picture"), str(path), width, height, crop)


def decode_gray(
    data: bytes, name: str, width: int, height: int, crop: Crop | CameraCrop | None = None
) -> UInt8[np.ndarray, "height width"]:
    """The content of a picture file as gray values 0…255, shrunk or enlarged to the size wanted.

    Colours become gray by Rec. 601; transparency is ignored, and of all else that comes with the picture
    only its orientation counts. An area shrinks to its mean.

    name            of the file, for messages
    width, height   [pixels]
    crop            the part that is taken; by default all of it

    Raises DataError if it is no picture, damaged, too large, or without a crop of another aspect ratio: a
    stretched picture shows another pose. Raises InputError if the crop leaves the picture.
    """
    picture = decode(data, name).gray
    rows, columns = picture.shape
    part = crop_of(crop, picture.shape)
    if part is not None:
        return cropped(picture, width, height, part, name)
    if not same_aspect((rows, columns), width, height):
        expected = "a square picture" if width == height else f"the aspect ratio {width}:{height}"
        middle = "--crop {} {} {}".format(*middle_of((rows, columns), width, height))
        raise DataError(
            f"{name}: expected {expected}, got {columns}×{rows} pixels; crop it, {middle} takes its middle"
        )
    return resized(picture, width, height)


def natural_order(name: str) -> list[tuple[int, int, str]]:
    """Key by which names are sorted with their numbers as numbers: img_9 before img_10."""
    parts = re.split(r"([0-9]+)", name)
    return [(0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts]


def same_aspect(shape: tuple[int, int], width: int, height: int) -> bool:
    """Whether a picture of (rows, columns) has another's aspect ratio, within one pixel of the smaller."""
    rows, columns = shape
    return abs(columns * height - rows * width) <= max(rows, columns, width, height)


def decode(data: bytes, name: str) -> Decoded:
    """The content of a picture file in its own size; the size is read first, and a larger one not unpacked.

    Colours become gray by Rec. 601; transparency is ignored.

    Raises DataError if it is no picture, damaged, or too large.
    """
    picture, turned = _opened(data, name, "L")
    deep = picture.mode.startswith("I;16")
    gray = (np.asarray(picture) >> 8).astype(np.uint8) if deep else np.asarray(picture.convert("L"))
    return Decoded(gray, turned, deep)


def decode_colour(data: bytes, name: str) -> UInt8[np.ndarray, "rows columns 3"]:
    """Red, green and blue of a picture file, 0…255, turned as it says; of gray ones all three are equal.

    Raises what `decode` raises, and DataError for 16 bits a pixel.
    """
    picture, _ = _opened(data, name, "RGB")
    if picture.mode.startswith("I;16"):
        raise DataError(f"{name}: 16 bits a pixel; save it with 8")
    return np.asarray(picture.convert("RGB"))


def _opened(data: bytes, name: str, draft: str) -> tuple[Image.Image, bool]:
    """A picture file, unpacked, and whether it was turned as it says."""
    too_large = f"up to {LARGEST_PICTURE // 10**6} million pixels are read; make it smaller"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=KINDS) as picture:
                if picture.width * picture.height > LARGEST_PICTURE:
                    raise DataError(f"{name}: {picture.width}×{picture.height} pixels, {too_large}")
                picture.draft(draft, None)  # of a JPEG only the gray is unpacked, if that is wanted
                picture.load()
                turned = picture.getexif().get(ExifTags.Base.Orientation, 1) != 1
                ImageOps.exif_transpose(picture, in_place=True)
                if picture.mode in ("I", "F"):
                    raise DataError(f"{name}: more than 16 bits a pixel; save it with 8 or 16")
                return picture.copy(), turned
    except DataError:
        raise
    except Image.DecompressionBombError:
        raise DataError(f"{name}: far too large; {too_large}") from None
    except Exception as error:  # decoders fail in many ways, and none is for the user to understand
        raise DataError(
            f"{name}: not a picture that can be read, or damaged; give a PNG, JPEG or TIFF file"
        ) from error


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
