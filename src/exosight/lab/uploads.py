"""Pictures that people drop on the page: looked at with suspicion, then read as the network takes them."""

import base64
import io
import warnings
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image, UnidentifiedImageError

from exosight.errors import DataError
from exosight.lab.views import judge, network, png_of, reading_of
from exosight.vision.pictures import decode_gray

LARGEST_UPLOAD = 8 * 2**20
"""[bytes]"""
_PIXELS = 40_000_000  # a camera's picture has fewer; 8 MiB of PNG may hold a thousand times as many
_KINDS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP")


def read_upload(data: bytes) -> UInt8[np.ndarray, "height width"]:
    """An uploaded picture, gray, in the size that the network takes.

    Raises DataError if it is no picture, damaged, too large, or of another aspect ratio.
    """
    # Pillow reads no more than the head here: OpenCV tells a size only after it has made room for it.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=_KINDS) as picture:
                width, height = picture.size
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError, SyntaxError, EOFError):
        raise DataError("picture: not one that can be read, or damaged; give a PNG or JPEG file") from None
    if width * height > _PIXELS:
        raise DataError(
            f"picture: {width}×{height} pixels, up to {_PIXELS // 10**6} million are read; make it smaller"
        )
    card = network().card
    return decode_gray(data, "picture", card.image_width, card.image_height)


def estimate(data: bytes) -> dict[str, Any]:
    """What the network reads off an uploaded picture, and the picture as the network sees it."""
    image = read_upload(data)
    reading = network().read(image[None])
    state, cause = judge(image, reading)
    return {
        "image": base64.b64encode(png_of(image)).decode(),
        "reading": reading_of(reading),
        "guard": {"state": state, "cause": cause},
    }
