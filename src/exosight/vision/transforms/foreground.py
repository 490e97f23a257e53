"""What hides the bodies: other fingers, and objects."""

from collections.abc import Mapping
from typing import ClassVar

from exosight.vision.appearance import AppearanceVariation
from exosight.vision.occlusion import (
    HELD_OUT_OCCLUSIONS,
    OCCLUSIONS,
    Occlusion,
    draw_fingers,
    occluder,
    overlay,
)
from exosight.vision.transforms.base import TURN, Canvas, Column, Draws, Row, Transform

OCCLUSION_KINDS: tuple[Occlusion, ...] = OCCLUSIONS + HELD_OUT_OCCLUSIONS
"""What the column `occlusion` counts, from 1; 0 is none."""

BEFORE, FRONT = 2, 3  # what a frame's seed is used for; 1 and 4 are those of the composition


class FingersInFront(Transform):
    """Other fingers in front of the bodies."""

    columns: ClassVar[Mapping[str, float]] = {"fingers_in_front": 0.0}  # their number
    switches = ("fingers_in_front",)

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """Any number up to the limit."""
        return {"fingers_in_front": draws.count("fingers_in_front", limits.fingers_in_front)}

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Draw them over the picture."""
        canvas.picture = canvas.picture.copy()
        draw_fingers(canvas.picture, int(row["fingers_in_front"]), canvas.own(FRONT))


class Occluder(Transform):
    """An object that hides a part of the bodies, see `exosight.vision.occlusion`."""

    columns: ClassVar[Mapping[str, float]] = {
        "occlusion": 0.0,  # place in OCCLUSION_KINDS, from 1; 0 is none
        "occluded": 0.0,  # share of the picture that it covers
        "occlusion_at": 0.0,  # which of the bodies' pixels it is centred on, 0 (first) … 1 (last)
        "occlusion_angle": 0.0,  # its angle [rad]
        "occlusion_shade": 0.0,  # its gray, 0…1
    }
    switches = ("occlusion",)

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """A kind, and where on the bodies."""
        kind = draws.kind("occlusion", limits.occlusions, OCCLUSION_KINDS)
        low, high = limits.occluded
        return {
            "occlusion": kind,
            "occluded": (low + (high - low) * draws.share("occluded")) * (kind > 0),
            "occlusion_at": draws.share("occlusion_at") * (kind > 0),
            "occlusion_angle": TURN * draws.share("occlusion_angle") * (kind > 0),
            "occlusion_shade": draws.share("occlusion_shade") * (kind > 0),
        }

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Put it before the picture, centred on a pixel of the bodies."""
        kind = OCCLUSION_KINDS[int(row["occlusion"]) - 1]
        share, place, angle = row["occluded"], row["occlusion_at"], row["occlusion_angle"]
        mask = occluder(kind, canvas.bodies, share, place, angle, canvas.own(BEFORE))
        canvas.picture = overlay(canvas.picture, mask, row["occlusion_shade"])
