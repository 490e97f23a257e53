"""Numbers with their units, as texts: "45 mm", "300 kPa", "0.04 N m/rad" → SI.

A dozen quantities with a handful of units each: a table says exactly what is accepted, and so does every
error. A library of units (pint) would also take expressions, which a file of unknown origin must not hold.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple

from pydantic import BeforeValidator, Field

LARGEST_TEXT = 64
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(.*?)\s*", re.DOTALL)


class Kind(NamedTuple):
    """A kind of quantity: what it is called, an example, and its units in SI units."""

    name: str
    example: str
    units: Mapping[str, float]


LENGTH = Kind("a length", "45 mm", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6})
ANGLE = Kind("an angle", "30 deg", {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180})
MODULUS = Kind("a modulus", "300 kPa", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9})
DENSITY = Kind("a density", "1070 kg/m^3", {"kg/m^3": 1.0, "g/cm^3": 1e3})
MASS = Kind("a mass", "20 g", {"kg": 1.0, "g": 1e-3})
FORCE = Kind("a force", "0.5 N", {"N": 1.0, "mN": 1e-3, "kN": 1e3})
TORQUE = Kind("a torque", "0.1 N m", {"N m": 1.0, "mN m": 1e-3, "N mm": 1e-3})
STIFFNESS = Kind("a stiffness", "1000 N/m", {"N/m": 1.0, "N/mm": 1e3, "kN/m": 1e3})
ROTARY_STIFFNESS = Kind(
    "a rotary stiffness",
    "0.04 N m/rad",
    {
        "N m/rad": 1.0,
        "mN m/rad": 1e-3,
        "N mm/rad": 1e-3,
        "N m/deg": 180 / math.pi,
        "N mm/deg": 0.18 / math.pi,
    },
)
ROTARY_DAMPING = Kind("a rotary damping", "0.001 N m s/rad", {"N m s/rad": 1.0, "mN m s/rad": 1e-3})
VISCOSITY = Kind("a viscosity", "300 Pa s", {"Pa s": 1.0, "kPa s": 1e3})
CONTACT_DAMPING = Kind("a damping of a contact", "0.5 s/m", {"s/m": 1.0})
TIME = Kind("a time", "20 s", {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0})
ACCELERATION = Kind("an acceleration", "9.81 m/s^2", {"m/s^2": 1.0})

KINDS = (
    LENGTH,
    ANGLE,
    MODULUS,
    DENSITY,
    MASS,
    FORCE,
    TORQUE,
    STIFFNESS,
    ROTARY_STIFFNESS,
    ROTARY_DAMPING,
    VISCOSITY,
    CONTACT_DAMPING,
    TIME,
    ACCELERATION,
)


def split_quantity(text: Any, example: str) -> tuple[float, str]:
    """Number and unit of a text such as "45 mm"; ValueError if it is no such text, or not finite."""
    found = _NUMBER.fullmatch(text) if isinstance(text, str) and len(text) <= LARGEST_TEXT else None
    if found is None or not found[2].isprintable() or not found[2]:
        raise ValueError(f"expected a number and its unit, like {example!r}, got {str(text)[:40]!r}")
    if found[2].startswith(","):
        raise ValueError(f"expected a decimal point, like {example!r}, got {text!r}")
    value = float(found[1])
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {text!r}")
    unit = " ".join(re.sub(r"[·*]", " ", found[2]).replace("²", "^2").replace("³", "^3").split())
    return value, unit


def si_unit(text: Any) -> str:
    """The SI unit of the quantity that a text such as "45 mm" is; "" if it is none."""
    try:
        _, unit = split_quantity(text, LENGTH.example)
    except ValueError:
        return ""
    return next((next(iter(kind.units)) for kind in KINDS if unit in kind.units), "")


def to_si(kind: Kind) -> Callable[[Any], float]:
    """The function from texts of a kind of quantity to SI; ValueError for another unit, or none."""

    def convert(text: Any) -> float:
        value, unit = split_quantity(text, kind.example)
        if unit not in kind.units:
            raise ValueError(f"expected {kind.name} in {', '.join(kind.units)}, got {text!r}")
        return value * kind.units[unit]

    return convert


Length = Annotated[float, BeforeValidator(to_si(LENGTH)), Field(gt=0, le=1e3)]
Distance = Annotated[float, BeforeValidator(to_si(LENGTH)), Field(ge=-1e3, le=1e3)]
Angle = Annotated[float, BeforeValidator(to_si(ANGLE)), Field(ge=-100, le=100)]
Roll = Annotated[float, BeforeValidator(to_si(ANGLE)), Field(ge=-math.pi, le=math.pi)]
Aside = Annotated[float, BeforeValidator(to_si(ANGLE)), Field(ge=-1.5, le=1.5)]
Modulus = Annotated[float, BeforeValidator(to_si(MODULUS)), Field(ge=1.0, le=1e13)]
Density = Annotated[float, BeforeValidator(to_si(DENSITY)), Field(ge=0, le=1e5)]
Mass = Annotated[float, BeforeValidator(to_si(MASS)), Field(ge=0, le=1e3)]
Force = Annotated[float, BeforeValidator(to_si(FORCE)), Field(gt=0, le=1e6)]
Stiffness = Annotated[float, BeforeValidator(to_si(STIFFNESS)), Field(gt=0, le=1e9)]
RotaryStiffness = Annotated[float, BeforeValidator(to_si(ROTARY_STIFFNESS)), Field(ge=0, le=1e6)]
RotaryDamping = Annotated[float, BeforeValidator(to_si(ROTARY_DAMPING)), Field(ge=0, le=1e6)]
Viscosity = Annotated[float, BeforeValidator(to_si(VISCOSITY)), Field(ge=0, le=1e13)]
ContactDamping = Annotated[float, BeforeValidator(to_si(CONTACT_DAMPING)), Field(ge=0, le=1e4)]
Time = Annotated[float, BeforeValidator(to_si(TIME)), Field(ge=1e-6, le=1e9)]
Acceleration = Annotated[float, BeforeValidator(to_si(ACCELERATION)), Field(ge=-1e4, le=1e4)]
