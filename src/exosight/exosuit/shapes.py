"""The five surface families of an exosuit, S(X), within the bounds of Table II.

A surface gives the rod's radius [m] over X ∈ [0, 1], the arc length divided by the rod's length. Whatever
the family, the radius is clipped to [0.4, 1.0] cm. A family is one class: its fields carry the published
bound and step, `profile` its formula. Source: Learning User Interaction Forces using Vision for a Soft
Finger Exosuit, equations of S(X), Tables I and II; units that the tables leave out stand with the field.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, get_type_hints

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from exosight.errors import InputError

RADIUS_MIN = 0.004
"""Smallest radius of an exosuit [m], printed."""
RADIUS_MAX = 0.010
"""Largest radius of an exosuit [m]: Table II's bound on R0 and R1, kept by every family."""

Points = Float[np.ndarray, "*points"]


@dataclass(frozen=True)
class Range:
    """What Table II allows a parameter: low, low + step, low + 2 step … up to high."""

    low: float
    high: float
    step: float
    unit: str = ""
    count: int = 1
    """How many numbers the parameter holds."""

    def __str__(self) -> str:
        return f"{self.low:g}…{self.high:.6g} {self.unit}".rstrip()


Radius = Annotated[float | int, Range(RADIUS_MIN, RADIUS_MAX, 0.0001, "m")]
Phase = Annotated[float | int, Range(0.0, 2 * np.pi, 0.01, "rad")]
Frequency = Annotated[float | int, Range(1e-4, 5.0, 0.01)]
Length = Annotated[float | int, Range(0.07, 0.11, 0.0001, "m")]


def ranges(kind: type) -> dict[str, Range]:
    """Table II's range of each parameter of a family (or of `ExosuitShape`: its length), in field order."""
    hints = get_type_hints(kind, include_extras=True)
    metadata = {field.name: getattr(hints[field.name], "__metadata__", ()) for field in fields(kind)}
    return {name: found[0] for name, found in metadata.items() if found}


def _plain(what: str, name: str, allowed: Range, given: Any) -> Any:
    """What was given for a parameter as a float (or a tuple of them), or InputError with one sentence."""
    values = tuple(given) if allowed.count > 1 and isinstance(given, list | tuple) else (given,)
    if len(values) != allowed.count:
        raise InputError(f"{what}: {name} expects {allowed.count} numbers, got {len(values)}")
    for value in values:
        number = isinstance(value, float | int) and not isinstance(value, bool)
        if not (number and allowed.low <= value <= allowed.high):  # NaN fails here too
            raise InputError(f"{what}: {name} must be a number within {allowed}, got {value}")
    return tuple(float(value) for value in values) if allowed.count > 1 else float(values[0])


def _check_ranges(owner: Any, what: str) -> None:
    """Check every ranged field and make it plain floats, so that 1 and 1.0 give equal shapes."""
    for name, allowed in ranges(type(owner)).items():
        object.__setattr__(owner, name, _plain(what, name, allowed, getattr(owner, name)))


@dataclass(frozen=True)
class Surface(ABC):
    """A surface S(X); a concrete family adds its parameters and `profile`.

    Raises InputError when a parameter leaves its range.
    """

    family: ClassVar[str]

    def __post_init__(self) -> None:
        _check_ranges(self, self.family)

    @abstractmethod
    def profile(self, x: Points) -> tuple[Points, Points]:
        """S(X) and dS/dX before clipping [m]."""


@dataclass(frozen=True)
class Linear(Surface):
    """S = R0 + X (R1 − R0)."""

    family: ClassVar[str] = "linear"

    r0: Radius
    """Radius at the base [m], 0.004…0.010."""
    r1: Radius
    """Radius at the tip [m], 0.004…0.010."""

    def profile(self, x: Points) -> tuple[Points, Points]:
        """S(X) and dS/dX before clipping [m]."""
        # In this order exact at both ends, so that a bound met there does not count as clipped.
        value = (1 - x) * self.r0 + x * self.r1
        return value, np.full_like(x, self.r1 - self.r0)


@dataclass(frozen=True)
class Sine(Surface):
    """S = R0 + R0/20 sin(A π X)."""

    family: ClassVar[str] = "sine"

    r0: Radius
    """Mean radius [m], 0.004…0.010."""
    a: Annotated[float | int, Range(-15.0, 0.001, 0.1)]
    """Half waves along the exosuit [-], −15…0.001; the sign is the phase."""

    def profile(self, x: Points) -> tuple[Points, Points]:
        """S(X) and dS/dX before clipping [m]."""
        phase = self.a * np.pi * x
        value = self.r0 + self.r0 / 20 * np.sin(phase)
        return value, self.r0 / 20 * self.a * np.pi * np.cos(phase)


@dataclass(frozen=True)
class CosineSum(Surface):
    """S = |Σ_{n=0..6} B_n cos(π n X)|."""

    family: ClassVar[str] = "cosine_sum"

    b: Annotated[tuple[float | int, ...], Range(-15.0, 0.001, 0.1, "(0.1 mm)", count=7)]
    """Seven amplitudes in units of 0.1 mm, each −15…0.001."""

    def profile(self, x: Points) -> tuple[Points, Points]:
        """S(X) and dS/dX before clipping [m]."""
        amplitude, wave = 1e-4 * np.array(self.b), np.pi * np.arange(7)
        phase = x[..., None] * wave
        total, derivative = np.cos(phase) @ amplitude, -np.sin(phase) @ (amplitude * wave)
        return np.abs(total), np.sign(total) * derivative


@dataclass(frozen=True)
class SineCosine(Surface):
    """S = R0 + R0/10 (sin(C π X + φ_C) + cos(D π X + φ_D))."""

    family: ClassVar[str] = "sine_cosine"

    r0: Radius
    """Mean radius [m], 0.004…0.010."""
    c: Frequency
    """Half waves of the sine along the exosuit [-], 0.0001…5."""
    d: Frequency
    """Half waves of the cosine along the exosuit [-], 0.0001…5."""
    phi_c: Phase
    """Phase of the sine [rad], 0…2π; sampled every 0.01 rad, as no step is printed."""
    phi_d: Phase
    """Phase of the cosine [rad], 0…2π; sampled every 0.01 rad."""

    def profile(self, x: Points) -> tuple[Points, Points]:
        """S(X) and dS/dX before clipping [m]."""
        sine, cosine = self.c * np.pi * x + self.phi_c, self.d * np.pi * x + self.phi_d
        value = self.r0 + self.r0 / 10 * (np.sin(sine) + np.cos(cosine))
        slope = self.r0 / 10 * np.pi * (self.c * np.cos(sine) - self.d * np.sin(cosine))
        return value, slope


@dataclass(frozen=True)
class Legendre(Surface):
    """S = Σ_{n=0..5} 2 m_n / 3ⁿ P_n(X)."""

    family: ClassVar[str] = "legendre"

    m: Annotated[tuple[float | int, ...], Range(0.001, 1.0, 0.005, "cm", count=6)]
    """Six amplitudes in centimetres, each 0.001…1."""

    def profile(self, x: Points) -> tuple[Points, Points]:
        """S(X) and dS/dX before clipping [m]."""
        coefficients = 0.01 * 2 * np.array(self.m) / 3.0 ** np.arange(6)
        return legendre.legval(x, coefficients), legendre.legval(x, legendre.legder(coefficients))


FAMILIES: dict[str, type[Surface]] = {
    kind.family: kind for kind in (Linear, Sine, CosineSum, SineCosine, Legendre)
}
"""The families by name; a family's index in a dataset is its place here."""


@dataclass(frozen=True)
class ExosuitShape:
    """An exosuit's outer geometry: its surface and its length.

    Raises InputError when the length leaves Table II's range.
    """

    surface: Surface
    length: Length = 0.10
    """Length of the rod [m], 0.07…0.11."""

    def __post_init__(self) -> None:
        if not isinstance(self.surface, Surface):
            raise InputError(f"exosuit: surface must be one of {', '.join(FAMILIES)}, got {self.surface!r}")
        _check_ranges(self, "exosuit")


TABLE_I = ExosuitShape(Linear(r0=0.0058, r1=0.0040), length=0.10)
"""The published exosuit: a taper from 0.58 cm to 0.40 cm over 10 cm."""


def _on_unit_interval(x: Points | float | int) -> Points:
    x = np.asarray(x, dtype=np.float64)
    if not np.all((x >= 0) & (x <= 1)):
        raise InputError("x: expected arc length over rod length within [0, 1], got a value outside it")
    return x


def radius(surface: Surface, x: Points | float | int) -> Points:
    """Radius of the exosuit: S(X) clipped to [0.004, 0.010] m.

    x        (*points,)  arc length over rod length [-], within [0, 1]
    returns  (*points,)  [m]

    Raises InputError if x leaves [0, 1].
    """
    x = _on_unit_interval(x)
    return np.clip(surface.profile(x.ravel())[0], RADIUS_MIN, RADIUS_MAX).reshape(x.shape)


def radius_slope(surface: Surface, x: Points | float | int) -> Points:
    """Exact dS/dX of the clipped radius: zero wherever the profile is cut off.

    x        (*points,)  arc length over rod length [-], within [0, 1]
    returns  (*points,)  [m]; divide by the rod's length for the slope over arc length [-]

    Raises InputError if x leaves [0, 1].
    """
    x = _on_unit_interval(x)
    value, slope = surface.profile(x.ravel())
    clipped = (value < RADIUS_MIN) | (value > RADIUS_MAX)
    return np.where(clipped, 0.0, slope).reshape(x.shape)


def shape_to_dict(shape: ExosuitShape) -> dict[str, Any]:
    """The shape as JSON values: family, parameters (units as in the family's fields) and length [m]."""
    parameters = {}
    for name, allowed in ranges(type(shape.surface)).items():
        value = getattr(shape.surface, name)
        parameters[name] = list(value) if allowed.count > 1 else value
    return {"family": shape.surface.family, "parameters": parameters, "length": shape.length}


def shape_from_dict(values: dict[str, Any]) -> ExosuitShape:
    """The shape that `shape_to_dict` wrote.

    Raises InputError naming what is unknown, missing or out of range.
    """
    expected = {"family", "parameters", "length"}
    if set(values) != expected:
        raise InputError(f"exosuit: expected the entries {sorted(expected)}, got {sorted(values)}")
    family, parameters = values["family"], values["parameters"]
    if not isinstance(family, str) or family not in FAMILIES:
        raise InputError(f"exosuit: unknown family {family!r}; the families are {', '.join(FAMILIES)}")
    kind = FAMILIES[family]
    allowed = ranges(kind)
    if not isinstance(parameters, dict) or set(parameters) != set(allowed):
        got = sorted(parameters) if isinstance(parameters, dict) else parameters
        raise InputError(f"{family}: expected the parameters {list(allowed)}, got {got}")
    surface = kind(**{name: _plain(family, name, allowed[name], parameters[name]) for name in allowed})
    length = _plain("exosuit", "length", ranges(ExosuitShape)["length"], values["length"])
    return ExosuitShape(surface, length)
