"""Clean pictures changed in one respect at a time: what tells a network's user why an image is unusual."""

import numpy as np
from jaxtyping import UInt8

from exosight.vision.appearance import AppearanceVariation
from exosight.vision.augment import augment, draw_appearance
from exosight.vision.background import BACKGROUNDS, HELD_OUT_BACKGROUNDS
from exosight.vision.occlusion import HELD_OUT_OCCLUSIONS, OCCLUSIONS
from exosight.vision.renderer import BACKGROUND

Pictures = UInt8[np.ndarray, "frames height width"]

CLEAN = 0.01
"""Least share of a picture that shows the renderer's background: only such can be given another."""

_OCCLUDED = 0.01, 0.2
_CAMERA = AppearanceVariation(shift=0.06, roll=0.12, zoom=0.12, tilt=0.2, distortion=0.05)
_LIGHT = AppearanceVariation(gradient=0.7, vignette=0.6, gamma=1.0, body_contrast=0.6)
_BLUR = AppearanceVariation(blur=2.0, motion=6.0, noise=0.05)

DISTURBANCES: dict[str, tuple[AppearanceVariation, ...]] = {
    "background": (AppearanceVariation(backgrounds=BACKGROUNDS),),
    "object in front": (
        AppearanceVariation(occlusions=OCCLUSIONS, occluded=_OCCLUDED),
        AppearanceVariation(fingers_in_front=2),
    ),
    "camera moved": (_CAMERA,),
    "light": (_LIGHT,),
    "blur or noise": (_BLUR,),
}
"""What may be unusual about a picture, and how it is drawn; where there are several ways, in equal shares."""

HELD_OUT_DISTURBANCES = DISTURBANCES | {
    "background": tuple(AppearanceVariation(backgrounds=(kind,)) for kind in HELD_OUT_BACKGROUNDS),
    "object in front": tuple(
        AppearanceVariation(occlusions=(kind,), occluded=_OCCLUDED) for kind in HELD_OUT_OCCLUSIONS
    ),
}
"""The same for testing: backgrounds and objects of other kinds, cameras, light and blur of other draws."""


def is_clean(images: Pictures) -> np.ndarray:
    """Whether each picture shows the renderer's background, (frames,) bool."""
    return np.mean(images == BACKGROUND, axis=(1, 2)) >= CLEAN


def disturbed(images: Pictures, ways: tuple[AppearanceVariation, ...], seed: int) -> Pictures:
    """Clean pictures with one of DISTURBANCES; each depends on the seed and its number alone."""
    found = np.empty_like(images)
    for k, variation in enumerate(ways):
        own = np.arange(k, len(images), len(ways))
        found[own] = augment(images[own], draw_appearance(variation, seed, own))
    return found
