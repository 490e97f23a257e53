"""Pictures of a view: as the camera takes them, and as files."""

import base64
from collections.abc import Mapping

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from exosight.arrays import AnyArray
from exosight.lab.settings import CameraSettings
from exosight.system.camera import project
from exosight.system.system import System
from exosight.vision.augment import Appearance, augment
from exosight.vision.corruptions import CORRUPTIONS, corrupt
from exosight.vision.transforms.composition import BACKGROUND_KINDS
from exosight.vision.transforms.foreground import OCCLUSION_KINDS
from exosight.vision.view import transformed_points

_AROUND = 24  # points on the outline of a sphere, 1 % of its radius within it
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


def camera_image(
    settings: CameraSettings, clean: UInt8[np.ndarray, "1 height width"], frame: int = 0
) -> UInt8[np.ndarray, "1 height width"]:
    """A clean picture as the view's camera takes it, corruption included.

    frame   of a sequence: decides the noise
    """
    image = augment(clean, _appearance(settings))
    corruption = settings.corruption
    return corrupt(image, corruption, seed=0, first=frame) if corruption in CORRUPTIONS else image


def _appearance(settings: CameraSettings) -> Appearance:
    changed = {
        "shift_x": settings.shift_x,
        "shift_y": settings.shift_y,
        "roll": settings.roll,
        "zoom": settings.zoom,
        "tilt_y": settings.tilt,
        **_SPOILT.get(settings.corruption, {}),
    }
    return Appearance.neutral(1, **changed)


def tubes_outside(
    settings: CameraSettings, system: System, axes: Mapping[str, Float[AnyArray, "nodes 3"]]
) -> tuple[str, ...]:
    """Names of the tubes that reach beyond the image of the view's camera, by more than half a pixel.

    axes   of the tubes, by name [m]
    """
    camera, columns = system.camera, _appearance(settings).columns
    angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    circle = np.stack([np.cos(angle), np.zeros(_AROUND), np.sin(angle)], axis=-1)
    outside = []
    for tube in system.tubes:
        edge = np.asarray(axes[tube.name])[:, None] + np.asarray(tube.radius)[:, None, None] * circle
        points = project(camera, edge.reshape(-1, 3))[None]
        place = transformed_points(columns, points, camera.width, camera.height)[0]
        if np.any(place < -0.5) or np.any(place > (camera.width + 0.5, camera.height + 0.5)):
            outside.append(tube.name)
    return tuple(outside)


def png_of(image: UInt8[np.ndarray, "height width"]) -> bytes:
    """A picture as a PNG file."""
    return cv2.imencode(".png", image)[1].tobytes()


def png_text(image: UInt8[np.ndarray, "height width"]) -> str:
    """The same in JSON."""
    return base64.b64encode(png_of(image)).decode()
