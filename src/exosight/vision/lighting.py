"""How the bodies themselves look: shades and lamp, drawn frame by frame when pictures are rendered."""

from collections.abc import Mapping
from dataclasses import dataclass as record
from typing import Annotated

import numpy as np
from jaxtyping import Float, Integer
from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from exosight.validation import CONFIG, Name, rising
from exosight.vision.counter_rng import Seed, uniforms
from exosight.vision.renderer import AMBIENT, LAMP, Light

Shade = Annotated[float, Field(ge=0.0, le=0.85)]  # darker than the background, which tells them from it
Share = Annotated[float, Field(ge=0.0, le=1.0)]

_LAMP_AND_AMBIENT = 2
"""Place of their three draws among those of the shades: a third tube's comes after them, so that what a frame
of one or two tubes draws does not depend on how many there are."""


@dataclass(frozen=True, config=CONFIG)
class LightingVariation:
    """How shades and lamp differ from frame to frame; what is not named, None, or 0, does not vary."""

    shades: dict[Name, Annotated[tuple[Shade, Shade], AfterValidator(rising)]] = Field(default_factory=dict)
    """gray of tubes where they face the lamp, 0 (black) to 1 (white), by their names: finger 0.5 0.8"""
    lamp: Annotated[float, Field(ge=0.0, le=3.0)] = 0.0
    """largest angle between the lamp's direction and the nominal one [rad]"""
    ambient: Annotated[tuple[Share, Share], AfterValidator(rising)] | None = None
    """share of light that reaches every surface; the nominal one is 0.4"""


@record(frozen=True)
class Lighting:
    """Shades and light of each frame."""

    shades: Float[np.ndarray, "frames tubes"]
    """Gray of each tube where it faces the lamp, 0…1."""
    light: Light
    """Lamp and ambient light."""


def draw_lighting(
    variation: LightingVariation,
    seed: Seed,
    numbers: Integer[np.ndarray, " frames"],
    nominal: Mapping[str, float],
) -> Lighting:
    """Shades and light of the frames with these numbers; each depends on the seed and its number alone.

    The lamp is even over the cap of directions within `lamp` of the nominal one.

    nominal   shade of every tube, by name, in the order in which they are drawn; others do not count

    Raises InputError for a negative seed or number.
    """
    first = _LAMP_AND_AMBIENT
    share = uniforms(seed, numbers, max(len(nominal), first) + 3)
    tilt, turn, level = share[:, first : first + 3].T
    own = np.delete(share, slice(first, first + 3), axis=1)

    def between(limits: tuple[float, float] | None, usual: float, at: np.ndarray) -> np.ndarray:
        return np.full(len(at), usual) if limits is None else limits[0] + (limits[1] - limits[0]) * at

    away = np.arccos(1 - (1 - np.cos(variation.lamp)) * tilt)
    around = 2 * np.pi * turn
    towards = np.array(LAMP)
    right = np.array([1.0, 0.0, 0.0])
    aside = np.cos(around)[:, None] * right + np.sin(around)[:, None] * np.cross(towards, right)
    lamp = np.cos(away)[:, None] * towards + np.sin(away)[:, None] * aside
    shades = [
        between(variation.shades.get(name), shade, own[:, k])
        for k, (name, shade) in enumerate(nominal.items())
    ]
    return Lighting(
        shades=np.stack(shades, axis=-1) if shades else np.empty((len(share), 0)),
        light=Light(lamp, between(variation.ambient, AMBIENT, level)),
    )
