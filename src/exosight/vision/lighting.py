"""How the bodies themselves look: shades and lamp, drawn frame by frame when pictures are rendered."""

from dataclasses import dataclass as record
from typing import Annotated

import numpy as np
from jaxtyping import Float, Integer
from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.validation import rising
from exosight.vision.counter_rng import Seed, uniforms
from exosight.vision.renderer import AMBIENT, LAMP, Light

FINGER_SHADE = 0.70
"""Mid gray: apart from the background (0.92) and from the exosuit by equal steps of about 0.3."""
EXOSUIT_SHADE = 0.35
"""Dark gray: the body whose bending carries most of the information stands out most."""

Shade = Annotated[float, Field(ge=0.0, le=0.85)]  # darker than the background, which tells them from it
Share = Annotated[float, Field(ge=0.0, le=1.0)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class LightingVariation:
    """How shades and lamp differ from frame to frame; what is None, or 0, does not vary."""

    finger_shade: Annotated[tuple[Shade, Shade], AfterValidator(rising)] | None = None
    """gray of the finger where it faces the lamp, 0 (black) to 1 (white)"""
    exosuit_shade: Annotated[tuple[Shade, Shade], AfterValidator(rising)] | None = None
    """gray of the exosuit where it faces the lamp"""
    lamp: Annotated[float, Field(ge=0.0, le=3.0)] = 0.0
    """largest angle between the lamp's direction and the nominal one [rad]"""
    ambient: Annotated[tuple[Share, Share], AfterValidator(rising)] | None = None
    """share of light that reaches every surface; the nominal one is 0.4"""


@record(frozen=True)
class Lighting:
    """Shades and light of each frame."""

    finger_shade: Float[np.ndarray, " frames"]
    """Gray of the finger where it faces the lamp, 0…1."""
    exosuit_shade: Float[np.ndarray, " frames"]
    """Gray of the exosuit where it faces the lamp, 0…1."""
    light: Light
    """Lamp and ambient light."""


def draw_lighting(
    variation: LightingVariation, seed: Seed, numbers: Integer[np.ndarray, " frames"]
) -> Lighting:
    """Shades and light of the frames with these numbers; each depends on the seed and its number alone.

    The lamp is even over the cap of directions within `lamp` of the nominal one.

    Raises InputError for a negative seed or number.
    """
    share = uniforms(seed, numbers, 5)

    def between(limits: tuple[float, float] | None, nominal: float, at: np.ndarray) -> np.ndarray:
        return np.full(len(at), nominal) if limits is None else limits[0] + (limits[1] - limits[0]) * at

    away = np.arccos(1 - (1 - np.cos(variation.lamp)) * share[:, 2])
    around = 2 * np.pi * share[:, 3]
    nominal = np.array(LAMP)
    right = np.array([1.0, 0.0, 0.0])
    aside = np.cos(around)[:, None] * right + np.sin(around)[:, None] * np.cross(nominal, right)
    lamp = np.cos(away)[:, None] * nominal + np.sin(away)[:, None] * aside
    return Lighting(
        finger_shade=between(variation.finger_shade, FINGER_SHADE, share[:, 0]),
        exosuit_shade=between(variation.exosuit_shade, EXOSUIT_SHADE, share[:, 1]),
        light=Light(lamp, between(variation.ambient, AMBIENT, share[:, 4])),
    )
