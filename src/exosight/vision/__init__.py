"""From bodies to pictures: a camera, a renderer of tapered tubes, and the paper's image corruptions."""

from exosight.vision.camera import Camera, project, resized
from exosight.vision.corruptions import CORRUPTIONS, add_noise, corrupt, set_contrast
from exosight.vision.renderer import BACKGROUND, Tube, render

__all__ = [
    "BACKGROUND",
    "CORRUPTIONS",
    "Camera",
    "Tube",
    "add_noise",
    "corrupt",
    "project",
    "render",
    "resized",
    "set_contrast",
]
