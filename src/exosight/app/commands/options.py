"""Options that several commands have."""

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.errors import InputError
from exosight.exosuit.shapes import FAMILIES, ExosuitShape, ranges, shape_from_dict, shape_to_dict

if TYPE_CHECKING:
    from exosight.exosuit.assembly import Exosuit

Json = Annotated[str | None, tyro.conf.arg(metavar="FILE|-", help_behavior_hint="")]
"""Where to write JSON: a new file, or stdout."""

Plot = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
"""Where to draw what is found: a new file, PNG, PDF or SVG by its ending."""

MaybePath = Annotated[Path | None, tyro.conf.arg(help_behavior_hint="")]
Paths = Annotated[tuple[Path, ...], tyro.conf.arg(help_behavior_hint="")]
"""A place that may be left out; the help says what happens then."""

Pixels = Annotated[
    tuple[int, int, int] | None, tyro.conf.arg(metavar="LEFT TOP WIDTH", help_behavior_hint="")
]
"""The part of a picture that a network is shown."""

SystemName = Annotated[str, tyro.conf.arg(metavar="NAME|FILE")]
"""A preset, or a system file."""

PUBLISHED = "published"
"""The preset of the paper."""

Name = Annotated[str | None, tyro.conf.arg(help_behavior_hint="")]
"""Of a family, a sensor or a channel; the help says which is meant if it is left out."""

Number = Annotated[float | None, tyro.conf.arg(metavar="X", help_behavior_hint="")]
Numbers = Annotated[tuple[float, ...] | None, tyro.conf.arg(metavar="X X …", help_behavior_hint="")]

Seed = Annotated[int, Field(ge=0)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class LoopOptions:
    """What a controller drives."""

    system: SystemName = PUBLISHED
    """name of a preset, or a system file (*.toml)"""
    sensor: Name = None
    """the one that follows the target; default: the first net force"""
    channel: Name = None
    """the one that is driven; default: the first"""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class ExosuitOptions:
    """An exosuit of a preset."""

    family: Name = None
    """of a preset, as all that follow: surface of the exosuit: linear (r0, r1), sine (r0, a),
    cosine_sum (b), sine_cosine (r0, c, d, phi-c, phi-d) or legendre (m); default: linear"""
    r0: Number = None
    """radius at the base, or mean radius [m], 0.004…0.01"""
    r1: Number = None
    """radius at the tip [m], 0.004…0.01"""
    a: Number = None
    """half waves of the sine along the exosuit, −15…0.001"""
    b: Numbers = None
    """seven amplitudes of the cosine sum [0.1 mm], each −15…0.001"""
    c: Number = None
    """half waves of the sine, 0.0001…5"""
    d: Number = None
    """half waves of the cosine, 0.0001…5"""
    phi_c: Number = None
    """phase of the sine [rad], 0…2π"""
    phi_d: Number = None
    """phase of the cosine [rad], 0…2π"""
    m: Numbers = None
    """six amplitudes of the Legendre polynomials [cm], each 0.001…1"""
    length: Number = None
    """length of the exosuit [m], 0.07…0.11"""
    young: Number = None
    """its Young's modulus [Pa], 1e3…1e9; default: 3e5"""
    contact_stiffness: Number = None
    """penalty stiffness of the contact spheres [N/m], 1…1e6; default: 1000"""
    gap: Number = None
    """clearance between exosuit and finger at the base [m], 0…0.1; default: 0"""
    friction: Number = None
    """coefficient of friction between the two in index-friction, 0…2; default: 0.3"""

    def given(self) -> dict[str, Any]:
        """The options that were not left out."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def refuse(self, remedy: str) -> None:
        """Raise InputError if there is any."""
        if self.given():
            raise InputError(f"{_option(next(iter(self.given())))}: an option of presets; {remedy}")

    def exosuit(self, nominal: ExosuitShape, system: str) -> "Exosuit":
        """The exosuit of these options; the nominal shape has what is left out of length and linear family.

        system   the preset that it is for

        Raises InputError for parameters that are missing, of another family, without effect or out of range.
        """
        given = self.given()
        for name, own in _ONLY.items():
            if name in given and system != own:
                raise InputError(
                    f"{_option(name)}: has an effect in {own} alone; leave it out, or choose --system {own}"
                )
        worn = {name: given.pop(name) for name in _WORN if name in given}
        family, length = given.pop("family", "linear"), given.pop("length", nominal.length)
        if family == nominal.surface.family and set(given) <= set(ranges(FAMILIES[family])):
            given = shape_to_dict(nominal)["parameters"] | given
        if family in FAMILIES:
            wanted = ranges(FAMILIES[family])
            missing = [_option(name) for name in wanted if name not in given]
            foreign = [_option(name) for name in given if name not in wanted]
            if missing or foreign:
                raise InputError(
                    f"family {family}: expected {', '.join(map(_option, wanted))}"
                    + (f"; missing: {', '.join(missing)}" if missing else "")
                    + (f"; not its own: {', '.join(foreign)}" if foreign else "")
                )
        shape = shape_from_dict({"family": family, "parameters": given, "length": length})
        from exosight.exosuit.assembly import Exosuit  # only now: JAX takes a second to import

        return Exosuit(shape, **worn)


_WORN = ("young", "contact_stiffness", "gap", "friction")
_ONLY = {"contact_stiffness": PUBLISHED, "friction": "index-friction"}

NO_OPTIONS, NOMINAL_LOOP = ExosuitOptions(), LoopOptions()


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
