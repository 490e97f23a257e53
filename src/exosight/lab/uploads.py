"""Pictures that people drop on the page, and what a network reads off them."""

from typing import Any

from exosight.control.estimator import OnnxEstimator
from exosight.control.trust import trust
from exosight.lab.estimates import judge, reading_of
from exosight.lab.pictures import png_of, png_text
from exosight.vision.pictures import decode, decode_gray

LARGEST_UPLOAD = 8 * 2**20
"""[bytes]"""


def as_png(data: bytes) -> bytes:
    """An uploaded picture of a kind that browsers do not show, gray, as a PNG file."""
    return png_of(decode(data, "picture").gray)


def estimate(data: bytes, network: OnnxEstimator) -> dict[str, Any]:
    """What a network reads off an uploaded picture, and the picture as the network sees it."""
    schema = network.card.schema
    height, width = schema.image_size
    image = decode_gray(data, "picture", width, height, network.crop)
    reading = network.read(image[None])
    judged = trust(network.card, reading)
    return {
        "image": png_text(image),
        "reading": reading_of(reading, schema),
        "trust": {"flagged": judged.flagged, "words": judged.words},
        "guard": judge(image, reading, schema),
    }
