"""Pictures of unknown origin: read as gray, in the size that is wanted."""

import ctypes
import io
import warnings
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageOps, _imaging

from exosight.errors import DataError
from exosight.files import read_file

LARGEST_FILE = 256 * 2**20  # [bytes]
LARGEST_PICTURE = 40_000_000
"""[pixels]; a camera's picture has fewer, and a small file may claim many more."""
KINDS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP")
"""What is read, as Pillow names it."""

with suppress(AttributeError, OSError):  # a Pillow without libtiff, or with one that cannot be reached
    # libtiff writes about damaged files to the process's stderr, and Pillow lets it.
    ctypes.CDLL(_imaging.__file__).TIFFSetErrorHandler(None)


def read_gray(path: Path, width: int, height: int) -> UInt8[np.ndarray, "height width"]:
    """A picture file (PNG, JPEG, TIFF, …) as gray values 0…255; see `decode_gray`.

    Raises DataError if the file is missing or too large, and where `decode_gray` does.
    """
    return decode_gray(read_file(path, LARGEST_FILE, "expected a picture"), str(path), width, height)


def decode_gray(data: bytes, name: str, width: int, height: int) -> UInt8[np.ndarray, "height width"]:
    """The content of a picture file as gray values 0…255, shrunk or enlarged to the size wanted.

    Colours become gray by Rec. 601; transparency is ignored, and of all else that comes with the picture
    only its orientation counts. An area shrinks to its mean.

    name            of the file, for messages
    width, height   [pixels]

    Raises DataError if it is no picture, damaged, too large, or of another aspect ratio: a stretched picture
    shows another pose.
    """
    picture = _decoded(data, name)
    rows, columns = picture.shape
    # Within one pixel of the smaller picture.
    if abs(columns * height - rows * width) > max(rows, columns, width, height):
        expected = "a square picture" if width == height else f"the aspect ratio {width}:{height}"
        raise DataError(f"{name}: expected {expected}, got {columns}×{rows} pixels; crop it")
    return resized(picture, width, height)


def _decoded(data: bytes, name: str) -> UInt8[np.ndarray, "rows columns"]:
    """The picture as it is stored; its size is read first, and one that is too large is not unpacked."""
    too_large = f"up to {LARGEST_PICTURE // 10**6} million pixels are read; make it smaller"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=KINDS) as picture:
                if picture.width * picture.height > LARGEST_PICTURE:
                    raise DataError(f"{name}: {picture.width}×{picture.height} pixels, {too_large}")
                picture.draft("L", None)  # of a JPEG only the gray is unpacked
                picture.load()
                ImageOps.exif_transpose(picture, in_place=True)
                deep = picture.mode.startswith("I;16")
                if picture.mode in ("I", "F"):
                    raise DataError(f"{name}: more than 16 bits a pixel; save it with 8 or 16")
                return (
                    (np.asarray(picture) >> 8).astype(np.uint8) if deep else np.asarray(picture.convert("L"))
                )
    except DataError:
        raise
    except Image.DecompressionBombError:
        raise DataError(f"{name}: far too large; {too_large}") from None
    except Exception as error:  # decoders fail in many ways, and none is for the user to understand
        raise DataError(
            f"{name}: not a picture that can be read, or damaged; give a PNG, JPEG or TIFF file"
        ) from error


def resized(
    picture: UInt8[np.ndarray, "rows columns"], width: int, height: int
) -> UInt8[np.ndarray, "height width"]:
    """A gray picture in another size [pixels]; an area shrinks to its mean."""
    shrinking = picture.shape[1] > width
    return cv2.resize(
        picture, (width, height), interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_LINEAR
    )
