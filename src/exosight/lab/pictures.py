"""Pictures of a view: as the camera takes them, and as files."""

import base64

import cv2
import numpy as np
from jaxtyping import UInt8

from exosight.lab.settings import Look
from exosight.vision.augment import Appearance, augment
from exosight.vision.corruptions import CORRUPTIONS, corrupt
from exosight.vision.transforms.composition import BACKGROUND_KINDS
from exosight.vision.transforms.foreground import OCCLUSION_KINDS

_SPOILT: dict[str, dict[str, float]] = {
    "blur": {"blur": 2.0},
    "occlusion": {
        "occlusion": 1.0 + OCCLUSION_KINDS.index("ellipse"),
        "occluded": 0.06,
        "occlusion_at": 0.5,
        "occlusion_shade": 0.4,
    },
    "background": {
        "background": 1.0 + BACKGROUND_KINDS.index("smooth"),
        "background_level": 0.6,
        "background_contrast": 0.3,
        "background_size": 0.3,
    },
}


def photograph(
    look: Look, clean: UInt8[np.ndarray, "1 height width"], frame: int = 0
) -> UInt8[np.ndarray, "1 height width"]:
    """A clean picture as the view's camera takes it, corruption included.

    frame   of a sequence: decides the noise
    """
    changed = {
        "shift_x": look.shift_x,
        "shift_y": look.shift_y,
        "roll": look.roll,
        "zoom": look.zoom,
        "tilt_y": look.tilt,
        **_SPOILT.get(look.corruption, {}),
    }
    image = augment(clean, Appearance.neutral(1, **changed))
    return corrupt(image, look.corruption, seed=0, first=frame) if look.corruption in CORRUPTIONS else image


def png_of(image: UInt8[np.ndarray, "height width"]) -> bytes:
    """A picture as a PNG file."""
    return cv2.imencode(".png", image)[1].tobytes()


def png_text(image: UInt8[np.ndarray, "height width"]) -> str:
    """The same in JSON."""
    return base64.b64encode(png_of(image)).decode()
