"""From bodies to pictures: a camera, a renderer of tapered tubes, and what may happen to a picture.

corruptions   the paper's noise and contrast
appearance    how far pictures may differ; augment draws numbers frame by frame and makes pictures so,
transforms    one class for each thing that may become of a picture
lighting      how the bodies' shades and their light may differ when they are rendered
disturbances  clean pictures changed in one respect at a time
ood_images    pictures without the plant, and what is kept for testing
"""

from exosight.system.camera import Camera, project, resized
from exosight.vision.appearance import TRAINING, AppearanceVariation
from exosight.vision.augment import Appearance, augment, draw_appearance
from exosight.vision.corruptions import CORRUPTIONS, add_noise, corrupt, set_contrast
from exosight.vision.lighting import Lighting, LightingVariation, draw_lighting
from exosight.vision.ood_images import HELD_OUT, OOD_KINDS, draw_ood_images
from exosight.vision.renderer import BACKGROUND, Light, Tube, render
from exosight.vision.view import transformed_points

__all__ = [
    "BACKGROUND",
    "CORRUPTIONS",
    "HELD_OUT",
    "OOD_KINDS",
    "TRAINING",
    "Appearance",
    "AppearanceVariation",
    "Camera",
    "Light",
    "Lighting",
    "LightingVariation",
    "Tube",
    "add_noise",
    "augment",
    "corrupt",
    "draw_appearance",
    "draw_lighting",
    "draw_ood_images",
    "project",
    "render",
    "resized",
    "set_contrast",
    "transformed_points",
]
