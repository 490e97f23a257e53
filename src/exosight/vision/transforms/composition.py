"""What is in the scene: the camera, the bodies, and what is behind them."""

from collections.abc import Mapping
from typing import ClassVar

from exosight.vision.appearance import AppearanceVariation
from exosight.vision.background import BACKGROUNDS, HELD_OUT_BACKGROUNDS, Background, background
from exosight.vision.occlusion import draw_fingers
from exosight.vision.transforms.base import TURN, Canvas, Column, Draws, Row, Transform
from exosight.vision.view import remapped

BACKGROUND_KINDS: tuple[Background, ...] = BACKGROUNDS + HELD_OUT_BACKGROUNDS
"""What the column `background` counts, from 1; 0 is the renderer's."""

BEHIND, TEXTURE = 1, 4  # what a frame's seed is used for; 2 and 3 are those of the foreground


class View(Transform):
    """Another camera, see `exosight.vision.view`."""

    columns: ClassVar[Mapping[str, float]] = {
        "shift_x": 0.0,  # to the right, as a share of the width
        "shift_y": 0.0,  # downwards, as a share of the height
        "roll": 0.0,  # clockwise turn about the picture's middle [rad]
        "zoom": 1.0,  # enlargement [-]
        "tilt_x": 0.0,  # turn about the scene's horizontal axis [rad]; positive takes its lower half away
        "tilt_y": 0.0,  # about its vertical axis [rad]; positive takes its right half away
        "distortion": 0.0,  # radial, at a corner, as a share of its distance; positive is a pincushion
    }
    switches = tuple(columns)

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """Each either way."""
        return {
            "shift_x": draws.either_way("shift_x", limits.shift),
            "shift_y": draws.either_way("shift_y", limits.shift, "shift_x"),
            "roll": draws.either_way("roll", limits.roll),
            "zoom": (1 + limits.zoom) ** draws.either_way("zoom", 1.0),
            "tilt_x": draws.either_way("tilt_x", limits.tilt),
            "tilt_y": draws.either_way("tilt_y", limits.tilt, "tilt_x"),
            "distortion": draws.either_way("distortion", limits.distortion),
        }

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Move the bodies, and what is known of where they are."""
        height, width = canvas.bodies.shape
        shift = (row["shift_x"] * width, row["shift_y"] * height)
        layers = (canvas.bodies,) if canvas.cover is None else (canvas.bodies, canvas.cover)
        canvas.bodies, *rest = remapped(layers, canvas.homography, row["distortion"], shift)
        canvas.cover = rest[0] if rest else None


class BodyContrast(Transform):
    """Grays of the bodies moved into a narrower range."""

    columns: ClassVar[Mapping[str, float]] = {
        "body_dark": 0.0,  # what black becomes on the bodies, 0…1
        "body_range": 0.0,  # range of grays that the bodies lose, 0…1
    }
    switches = ("body_range",)
    separates = True

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """The range, and where within 0…1 it lies."""
        lost = draws.up_to("body_range", limits.body_contrast)
        return {"body_dark": lost * draws.share("body_dark"), "body_range": lost}

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Say so; it is done where the bodies are put before what is behind them."""
        canvas.dark, canvas.contrast = row["body_dark"], 1.0 - row["body_range"]


class Backdrop(Transform):
    """A pattern behind the bodies, see `exosight.vision.background`."""

    columns: ClassVar[Mapping[str, float]] = {
        "background": 0.0,  # place in BACKGROUND_KINDS, from 1; 0 is the renderer's own
        "background_level": 0.0,  # its mean gray, 0…1
        "background_contrast": 0.0,  # half its range of grays, 0…1
        "background_size": 0.0,  # its features' size, as a share of the width
        "background_angle": 0.0,  # its angle [rad]
    }
    switches = ("background",)
    separates = True

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """A kind, and a pattern of which neither end is clipped."""
        kind = draws.kind("background", limits.backgrounds, BACKGROUND_KINDS)
        half_range = 0.5 * draws.share("background_contrast")
        return {
            "background": kind,
            "background_level": (half_range + (1 - 2 * half_range) * draws.share("background_level"))
            * (kind > 0),
            "background_contrast": half_range * (kind > 0),
            "background_size": (0.05 + 0.45 * draws.share("background_size")) * (kind > 0),
            "background_angle": TURN * draws.share("background_angle") * (kind > 0),
        }

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Put it behind the bodies."""
        height, width = canvas.bodies.shape
        canvas.behind = background(
            BACKGROUND_KINDS[int(row["background"]) - 1],
            (height, width),
            row["background_level"],
            row["background_contrast"],
            row["background_size"],
            row["background_angle"],
            canvas.own(TEXTURE),
        )


class FingersBehind(Transform):
    """Other fingers behind the bodies."""

    columns: ClassVar[Mapping[str, float]] = {"fingers_behind": 0.0}  # their number
    switches = ("fingers_behind",)
    separates = True

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """Any number up to the limit."""
        return {"fingers_behind": draws.count("fingers_behind", limits.fingers_behind)}

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Draw them on what is behind the bodies."""
        draw_fingers(canvas.behind_bodies(), int(row["fingers_behind"]), canvas.own(BEHIND))
