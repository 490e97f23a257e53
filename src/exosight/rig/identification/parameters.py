"""What is unknown of a rig: entries of its system file, and how well each is known beforehand.

An entry e is e₀ exp(σ x) where it is a size, e₀ + σ x where it is a place or an angle, with x of unit normal
distribution before any picture is seen. All else works with x.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.system.description import Description
from exosight.system.designs import moved_zones
from exosight.system.file import Values, describe, replaced
from exosight.system.units import ANGLE, LENGTH, split_quantity

SMALL = 1e-9
"""Smallest stiffness [N m/rad] and length [m] that is looked for; what is 0 in the file stays 0."""


@dataclass(frozen=True)
class Prior:
    """Standard deviations of what is unknown, before a picture is seen; sizes as logarithms."""

    modulus: float = 0.5
    """of Young's moduli"""
    stiffness: float = 0.5
    """of joints"""
    length: float = 0.1
    """of links"""
    gain: float = 1.0
    """of loads a unit of the command"""
    place: float = 0.003
    """of rods where they are mounted [m]"""
    angle: float = 0.05
    """of rods where they are mounted [rad]"""
    scale: float = 0.3
    """of the pixel"""
    shift: float = 0.03
    """of the middle of the picture [m]"""
    roll: float = 0.2
    """of the camera [rad]"""
    aside: float = 0.1
    """of pan and tilt of a pinhole camera [rad]"""
    edge: float = 0.2
    """by which outlines are found too far outside or inside [pixels]"""
    shared: float = 0.03
    """by which they are so differently along each side of a body, alike in all pictures [pixels]"""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"prior {name}: expected a finite standard deviation above 0, got {value}")


@dataclass(frozen=True)
class Parameter:
    """An entry that is unknown.

    entry       such as "rods.exosuit.young"
    nominal     its number in the file, in the file's unit
    unit        as the file spells it
    deviation   of the prior: of the logarithm for sizes, else in the file's unit
    size        whether it is a size, above 0
    """

    entry: str
    nominal: float
    unit: str
    deviation: float
    size: bool

    def value(self, x: float) -> float:
        """The number at x, in the file's unit."""
        return self.nominal * float(np.exp(self.deviation * x)) if self.size else self._place(x)

    def _place(self, x: float) -> float:
        return self.nominal + self.deviation * x

    def slope(self, x: float) -> float:
        """Its derivative by x."""
        return self.deviation * (self.value(x) if self.size else 1.0)

    @property
    def metres(self) -> float:
        """The file's unit of length in SI units."""
        return LENGTH.units[self.unit]

    def x(self, value: float) -> float:
        """The x of a number."""
        if self.size:
            return float(np.log(value / self.nominal)) / self.deviation
        return (value - self.nominal) / self.deviation


def parameters_of(values: Values, prior: Prior, known_gains: bool = True) -> tuple[Parameter, ...]:
    """What is unknown of a file's system: moduli, joints, links, mounts of rods, gains, the first camera.

    The frame of the world is that of the links: what stands on the ground but rods is where the file says.
    Without links the first rod is. A gain is known where a command is a force or torque.

    known_gains   whether the gains of the file are certain too
    """
    description = describe(values)
    found: list[Parameter] = []

    def add(entry: str, deviation: float, size: bool) -> None:
        text = _entry(values, entry)
        number, unit = split_quantity(text, "45 mm")
        if size and abs(number) < SMALL:
            return
        found.append(Parameter(entry, number, unit, deviation if size else _in_unit(deviation, unit), size))

    for name in description.rods:
        add(f"rods.{name}.young", prior.modulus, True)
    for name, link in description.links.items():
        if link.joint.type != "fixed":
            add(f"links.{name}.joint.stiffness", prior.stiffness, True)
    for name in description.links:
        add(f"links.{name}.length", prior.length, True)
    for name in _free_rods(description):
        add(f"rods.{name}.position.0", prior.place, False)
        add(f"rods.{name}.position.2", prior.place, False)
        add(f"rods.{name}.rotation.1", prior.angle, False)
    if not known_gains:
        for name, actuator in description.actuators.items():
            if actuator.gain is not None:
                add(f"actuators.{name}.gain", prior.gain, True)
    camera = f"cameras.{next(iter(description.cameras))}"
    add(f"{camera}.centre.0", prior.shift, False)
    add(f"{camera}.centre.1", prior.shift, False)
    add(f"{camera}.pixel", prior.scale, True)
    add(f"{camera}.roll", prior.roll, False)
    if description.cameras[camera.partition(".")[2]].distance is not None:
        add(f"{camera}.pan", prior.aside, False)
        add(f"{camera}.tilt", prior.aside, False)
    return tuple(found)


def complete(values: Values) -> Values:
    """The entries of a file with those written out that it may leave out and that are looked for."""
    description = describe(values)
    changed: Any = {**values}
    changed["rods"] = {
        name: {"position": ["0 mm"] * 3, "rotation": ["0 deg"] * 3, **table}
        for name, table in values.get("rods", {}).items()
    }
    changed["links"] = {
        name: {**table, "joint": {"stiffness": "0 N m/rad", **table["joint"]}}
        if description.links[name].joint.type != "fixed"
        else table
        for name, table in values.get("links", {}).items()
    }
    level, ahead = {"roll": "0 deg"}, {"pan": "0 deg", "tilt": "0 deg"}
    changed["cameras"] = {
        name: {**level, **(ahead if "distance" in table else {}), **table}
        for name, table in values["cameras"].items()
    }
    return {name: table for name, table in changed.items() if table != {}}


def values_at(values: Values, parameters: Sequence[Parameter], x: Float[np.ndarray, " parameters"]) -> Values:
    """The entries of a file with the parameters at x.

    Zones on links stay at their shares of a link. A pinhole keeps its focal length: its distance grows with
    the size of a pixel at its centre.
    """
    entries = {
        each.entry: f"{each.value(float(at))!r} {each.unit}" for each, at in zip(parameters, x, strict=True)
    }
    for name, table in values["cameras"].items():
        pixel = f"cameras.{name}.pixel"
        if "distance" in table and pixel in entries:
            distance, unit = split_quantity(table["distance"], "30 cm")
            nominal, _ = split_quantity(table["pixel"], "1 mm")
            farther = split_quantity(entries[pixel], "1 mm")[0] / nominal
            entries[f"cameras.{name}.distance"] = f"{farther * distance!r} {unit}"
    changed = replaced(values, entries)
    return replaced(changed, moved_zones(describe(values), describe(changed)))


def _free_rods(description: Description) -> list[str]:
    """Rods on the ground; without a link on the ground, the first of them carries the frame of the world."""
    rods = [name for name, rod in description.rods.items() if rod.parent is None]
    return rods if any(link.parent is None for link in description.links.values()) else rods[1:]


def _entry(values: Values, entry: str) -> Any:
    at: Any = values
    for step in entry.split("."):
        at = at[int(step)] if isinstance(at, list) else at[step]
    return at


def _in_unit(deviation: float, unit: str) -> float:
    """A deviation in SI units in a file's unit of length or angle."""
    return deviation / next(kind.units[unit] for kind in (LENGTH, ANGLE) if unit in kind.units)
