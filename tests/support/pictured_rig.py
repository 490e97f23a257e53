"""A small rig's true parameters, and pictures of it at four commands."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.outlines import outline_of_picture
from exosight.system.system import System

COMMANDS = np.array([[4.0], [14.0], [24.0], [34.0]])
TRUTH = {
    "rods.actuator.young": "380.0 kPa",
    "links.bone.joint.stiffness": "0.035 N m/rad",
    "links.bone.length": "53.0 mm",
    "cameras.side.centre.0": "31.0 mm",
    "cameras.side.centre.1": "3.0 mm",
    "cameras.side.pixel": "1.04 mm",
    "cameras.side.roll": "4.0 deg",
}
UNCERTAIN = {
    "rods.actuator.young": (300.0, "kPa", 0.05),
    "links.bone.joint.stiffness": (0.05, "N m/rad", 0.08),
    "links.bone.length": (50.0, "mm", 0.01),
}
"""What of the lever an identification leaves uncertain: middle, unit, and deviation of the logarithm."""


def vary(width: float = 1.96) -> list[dict[str, str]]:
    """The tables of a file that say so; of a 95 % interval, or so many deviations."""
    return [
        {"entry": entry, "low": scaled(entry, -width), "high": scaled(entry, width)} for entry in UNCERTAIN
    ]


def scaled(entry: str, deviations: float) -> str:
    """What is uncertain, so many deviations from its middle."""
    value, unit, deviation = UNCERTAIN[entry]
    return f"{float(value * np.exp(deviation * deviations))!r} {unit}"


@dataclass(frozen=True)
class Pictured:
    """The true rig, its pictures and what its sensor read."""

    system: System
    pictures: UInt8[np.ndarray, "pictures height width"]
    readings: Float[np.ndarray, " pictures"]

    @property
    def measured(self) -> Measurements:
        shades = [tube.shade for tube in self.system.tubes]
        return Measurements(COMMANDS, tuple(outline_of_picture(each, shades) for each in self.pictures))
