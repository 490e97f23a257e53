"""What light, lens and sensor make of the scene."""

from collections.abc import Mapping
from typing import ClassVar

import cv2
import numpy as np

from exosight.vision.appearance import AppearanceVariation
from exosight.vision.corruptions import NOISE_MEAN
from exosight.vision.counter_rng import normal_quantiles
from exosight.vision.pixel_loops import expose, illuminate
from exosight.vision.transforms.base import TURN, Canvas, Column, Draws, Row, Transform


class Illumination(Transform):
    """Uneven light."""

    columns: ClassVar[Mapping[str, float]] = {
        "gradient": 0.0,  # relative gain of brightness from the middle to a corner, along gradient_angle
        "gradient_angle": 0.0,  # where it becomes brighter, clockwise from the right [rad]
        "vignette": 0.0,  # relative loss of brightness at the corners
    }
    switches = ("gradient", "vignette")

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """In any direction."""
        return {
            "gradient": draws.up_to("gradient", limits.gradient),
            "gradient_angle": TURN * draws.share("gradient_angle"),
            "vignette": draws.up_to("vignette", limits.vignette),
        }

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Light the picture so."""
        lit = np.empty_like(canvas.picture)
        angle = row["gradient_angle"]
        slope = (row["gradient"] * np.cos(angle), row["gradient"] * np.sin(angle))
        illuminate(canvas.picture, *slope, row["vignette"], lit)
        canvas.picture = lit


class Blur(Transform):
    """A lens out of focus."""

    columns: ClassVar[Mapping[str, float]] = {"blur": 0.0}  # standard deviation of Gaussian blur [pixels]
    switches = ("blur",)

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """Up to the limit."""
        return {"blur": draws.up_to("blur", limits.blur)}

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Blur the picture."""
        blurred = cv2.GaussianBlur(canvas.picture, (0, 0), row["blur"], borderType=cv2.BORDER_REFLECT)
        canvas.picture = np.asarray(blurred, np.uint8)


class MotionBlur(Transform):
    """A camera that moves while it exposes."""

    columns: ClassVar[Mapping[str, float]] = {
        "motion": 0.0,  # length of the motion [pixels]
        "motion_angle": 0.0,  # its direction, clockwise from the right [rad]
    }
    switches = ("motion",)

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """In any direction."""
        return {
            "motion": draws.up_to("motion", limits.motion),
            "motion_angle": TURN * draws.share("motion_angle"),
        }

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Blur the picture along a line."""
        kernel = _streak(row["motion"], row["motion_angle"])
        blurred = cv2.filter2D(canvas.picture, -1, kernel, borderType=cv2.BORDER_REFLECT)
        canvas.picture = np.asarray(blurred, np.uint8)


class Exposure(Transform):
    """What each gray becomes on the sensor, with noise."""

    columns: ClassVar[Mapping[str, float]] = {
        "gamma": 1.0,  # exponent of brightness [-]
        "dark": 0.0,  # what black becomes, 0…1
        "range": 0.0,  # range of grays that is lost, 0…1: white becomes dark + 1 − range
        "noise": 0.0,  # variance of Gaussian noise [full scale²]; its mean is the paper's
        "shot": 0.0,  # variance of shot noise at white [full scale²]
    }
    switches = ("gamma", "dark", "range", "noise", "shot")

    def draw(self, limits: AppearanceVariation, draws: Draws) -> dict[str, Column]:
        """As many frames at every standard deviation of noise: the square of an even number."""
        lost = draws.up_to("range", limits.contrast)
        return {
            "gamma": 2.0 ** draws.either_way("gamma", limits.gamma),
            "dark": lost * draws.share("dark"),
            "range": lost,
            "noise": draws.up_to("noise", 1.0) ** 2 * limits.noise,
            "shot": draws.up_to("shot", 1.0) ** 2 * limits.shot,
        }

    def apply(self, canvas: Canvas, row: Row) -> None:
        """Expose the picture."""
        tone = row["dark"] + (1 - row["range"]) * (np.arange(256) / 255) ** row["gamma"]
        spread = np.sqrt(row["noise"] + row["shot"] * tone)
        mean = 255 * NOISE_MEAN if row["noise"] else 0.0
        curve, deviation = (255 * tone).astype(np.float32), (255 * spread).astype(np.float32)
        exposed = np.empty_like(canvas.picture)
        expose(canvas.picture, curve, deviation, mean, normal_quantiles(), np.uint64(canvas.seed), exposed)
        canvas.picture = exposed


def _streak(length: float, angle: float) -> np.ndarray:
    """The kernel of a point that moves evenly along a line of this length [pixels]."""
    reach = int(np.ceil(length / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    steps = (np.arange(64) + 0.5) / 64 - 0.5
    x, y = reach + length * np.cos(angle) * steps, reach + length * np.sin(angle) * steps
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    right, down = x - column, y - row
    for across, along, weight in (
        (0, 0, (1 - right) * (1 - down)),
        (1, 0, right * (1 - down)),
        (0, 1, (1 - right) * down),
        (1, 1, right * down),
    ):
        np.add.at(kernel, (row + along, column + across), weight)
    return kernel / kernel.sum()
