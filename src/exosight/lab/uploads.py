"""Pictures that people drop on the page: looked at with suspicion, then read as the network takes them."""

import io
import warnings
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image, UnidentifiedImageError

from exosight.control.estimator import OnnxEstimator
from exosight.errors import DataError
from exosight.lab.estimates import judge, reading_of
from exosight.lab.pictures import png_text
from exosight.vision.pictures import decode_gray

LARGEST_UPLOAD = 8 * 2**20
"""[bytes]"""
_PIXELS = 40_000_000  # a camera's picture has fewer; 8 MiB of PNG may hold a thousand times as many
_KINDS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP")


def read_upload(data: bytes, width: int, height: int) -> UInt8[np.ndarray, "height width"]:
    """An uploaded picture, gray, in the size that a network takes [pixels].

    Raises DataError if it is no picture, damaged, too large, or of another aspect ratio.
    """
    # Pillow reads no more than the head here: OpenCV tells a size only after it has made room for it.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=_KINDS) as picture:
                columns, rows = picture.size
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError, SyntaxError, EOFError):
        raise DataError("picture: not one that can be read, or damaged; give a PNG or JPEG file") from None
    if columns * rows > _PIXELS:
        raise DataError(
            f"picture: {columns}×{rows} pixels, up to {_PIXELS // 10**6} million are read; make it smaller"
        )
    return decode_gray(data, "picture", width, height)


def estimate(data: bytes, network: OnnxEstimator) -> dict[str, Any]:
    """What a network reads off an uploaded picture, and the picture as the network sees it."""
    schema = network.card.schema
    image = read_upload(data, schema.cameras[0].width, schema.cameras[0].height)
    reading = network.read(image[None])
    return {
        "image": png_text(image),
        "reading": reading_of(reading, schema),
        "guard": judge(image, reading, schema),
    }
