"""The sliders of the published system: family and parameters of the exosuit, material, finger."""

import json
from collections.abc import Mapping
from typing import Any

import pydantic

from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit, varied
from exosight.exosuit.published import published
from exosight.exosuit.shapes import FAMILIES, ranges
from exosight.exosuit.variation import Variant
from exosight.lab.designs import Choice, Group, Slider
from exosight.lab.published_design import DESIGN, PublishedDesign, shape_of
from exosight.lab.settings import sentence
from exosight.system.schema import Schema
from exosight.system.system import System

_GROUPS: dict[str, tuple[tuple[str, str, str, float, float], ...]] = {
    "Exosuit": (
        ("length", "Length", "mm", 1e3, 1e-4),
        ("young", "Young's modulus", "kPa", 1e-3, 1e4),
        ("gap", "Gap at the base", "mm", 1e3, 1e-4),
    ),
    "Finger": (
        ("finger_length", "Length", "%", 100.0, 0.01),
        ("finger_radius", "Radius", "%", 100.0, 0.01),
        ("joint_stiffness", "Joint stiffness", "%", 100.0, 0.01),
    ),
}

_PARAMETERS = {
    "linear": ("Radius at the base", "Radius at the tip"),
    "sine": ("Mean radius", "Half waves A"),
    "cosine_sum": tuple(f"Amplitude B{n}" for n in range(7)),
    "sine_cosine": ("Mean radius", "Half waves C", "Half waves D", "Phase φC", "Phase φD"),
    "legendre": tuple(f"Amplitude m{n}" for n in range(6)),
}

STARTS: dict[str, tuple[float, ...]] = {
    "linear": PublishedDesign().parameters,
    "sine": (0.008, -5.0),
    "cosine_sum": (-15.0, -15.0, -15.0, -15.0, -12.0, -9.0, -6.0),
    "sine_cosine": (0.007, 1.5, 2.5, 0.5, 1.0),
    "legendre": (0.35, 0.1, 0.2, 0.3, 0.2, 0.1),
}
"""Parameters of each family when it is chosen: ones whose radius varies."""

_FAMILY_WORDS = {
    "linear": "linear taper",
    "sine": "sine",
    "cosine_sum": "sum of cosines",
    "sine_cosine": "sine and cosine",
    "legendre": "Legendre polynomials",
}


class PublishedControls:
    """The designs of the published system; values are those of `PublishedDesign`."""

    def __init__(self) -> None:
        self._schema = self.build({}).schema

    @property
    def schema(self) -> Schema:
        """See `DesignControls`."""
        return self._schema

    @property
    def groups(self) -> tuple[Group, ...]:
        """See `DesignControls`."""
        bounds = DESIGN.json_schema()["properties"]
        families = tuple((name, _FAMILY_WORDS[name], _parameters(name)) for name in FAMILIES)
        choices = {"Exosuit": Choice("family", "Family", families)}
        return tuple(
            Group(name, tuple(_slider(*words, bounds) for words in sliders), choices.get(name))
            for name, sliders in _GROUPS.items()
        )

    def complete(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """See `DesignControls`."""
        try:
            design = DESIGN.validate_json(json.dumps(values), strict=True)
        except pydantic.ValidationError as error:
            raise InputError(f"design.{sentence(error)}") from None
        shape_of(design)
        return DESIGN.dump_python(design, mode="json")

    def build(self, values: Mapping[str, Any]) -> System:
        """See `DesignControls`."""
        return published(exosuit_of(DESIGN.validate_python(dict(values))))

    def words(self, values: Mapping[str, Any]) -> list[str]:
        """See `DesignControls`."""
        words, nominal = [], DESIGN.dump_python(PublishedDesign(), mode="json")
        for key, value in self.complete(values).items():
            if value != nominal[key]:
                given = value if isinstance(value, list) else [value]
                texts = (each if isinstance(each, str) else f"{each:.10g}" for each in given)
                words += [f"--{key.replace('_', '-')}", *texts]
        return words


def exosuit_of(design: PublishedDesign) -> Exosuit:
    """The worn exosuit of a design."""
    longer, stiffer = design.finger_length, design.joint_stiffness
    return varied(
        Exosuit(shape_of(design), young=design.young, gap=design.gap),
        Variant(
            link_length=(longer, longer, longer, longer),
            finger_radius=design.finger_radius,
            joint_stiffness=(stiffer, stiffer, stiffer),
        ),
    )


def _slider(key: str, label: str, unit: str, scale: float, step: float, bounds: dict[str, Any]) -> Slider:
    low, high = bounds[key]["minimum"], bounds[key]["maximum"]
    return Slider(key, label, unit, scale, low, high, step, getattr(PublishedDesign(), key))


def _parameters(family: str) -> tuple[Slider, ...]:
    allowed = [each for each in ranges(FAMILIES[family]).values() for _ in range(each.count)]
    shown = {"m": ("mm", 1e3), "(0.1 mm)": ("mm", 0.1)}
    sliders = []
    for place, (label, each, start) in enumerate(
        zip(_PARAMETERS[family], allowed, STARTS[family], strict=True)
    ):
        unit, scale = shown.get(each.unit, (each.unit, 1.0))
        sliders.append(Slider("parameters", label, unit, scale, each.low, each.high, each.step, start, place))
    return tuple(sliders)
