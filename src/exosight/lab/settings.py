"""What a page may ask for, with bounds: one view of a worn exosuit, one run of the closed loop."""

from typing import Annotated, Any, Literal, TypeVar

import pydantic
from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.errors import InputError
from exosight.exosuit.shapes import FAMILIES, ExosuitShape, ranges, shape_from_dict

STEP = 0.05
"""Actuations are multiples of this [N], the step in which loads are followed."""
LARGEST = 4.0
"""Largest actuation [N], that of the published data."""

Family = Literal["linear", "sine", "cosine_sum", "sine_cosine", "legendre"]
Corruption = Literal[
    "none",
    "noise-low",
    "noise-medium",
    "noise-high",
    "contrast-low",
    "contrast-high",
    "blur",
    "occlusion",
    "background",
]
Law = Literal["scheduled", "proportional"]
Sensor = Literal["network", "true"]
Disturbance = Literal["none", "noise", "lost", "frozen", "elsewhere", "softer"]


def _on_grid(value: float) -> float:
    """The multiple of STEP that is meant; for pydantic's AfterValidator."""
    nearest = round(value / STEP)
    if abs(value - nearest * STEP) > 1e-6:
        raise ValueError(f"expected multiples of {STEP:g} N")
    return round(nearest * STEP, 10)


Actuation = Annotated[float, Field(ge=0.0, le=LARGEST, allow_inf_nan=False), AfterValidator(_on_grid)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class View:
    """A worn exosuit, how it was driven, and what looks at it."""

    family: Family = "linear"
    """surface of the exosuit"""
    parameters: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=8)] = (0.010, 0.005)
    """its parameters in the order and units of `exosight simulate`: lengths in m, phases in rad"""
    length: Annotated[float, Field(ge=0.07, le=0.11, allow_inf_nan=False)] = 0.095
    """length of the exosuit [m]"""
    young: Annotated[float, Field(ge=1e5, le=1e6, allow_inf_nan=False)] = 300e3
    """Young's modulus of the exosuit [Pa]"""
    gap: Annotated[float, Field(ge=0.0, le=0.01, allow_inf_nan=False)] = 0.0
    """clearance between exosuit and finger at the base [m]"""
    finger_length: Annotated[float, Field(ge=0.8, le=1.25, allow_inf_nan=False)] = 1.0
    """factor on the length of every link of the finger"""
    finger_radius: Annotated[float, Field(ge=0.8, le=1.25, allow_inf_nan=False)] = 1.0
    """factor on the finger's radius"""
    joint_stiffness: Annotated[float, Field(ge=0.5, le=2.0, allow_inf_nan=False)] = 1.0
    """factor on the stiffness of the finger's joints"""
    drive: Annotated[tuple[Actuation, ...], Field(min_length=1, max_length=64)] = (2.4,)
    """actuations driven to one after the other, from rest; the last one is seen [N]"""
    shift_x: Annotated[float, Field(ge=-0.2, le=0.2, allow_inf_nan=False)] = 0.0
    """shift of the picture to the right, as a share of its width"""
    shift_y: Annotated[float, Field(ge=-0.2, le=0.2, allow_inf_nan=False)] = 0.0
    """shift of the picture downwards, as a share of its height"""
    roll: Annotated[float, Field(ge=-0.4, le=0.4, allow_inf_nan=False)] = 0.0
    """clockwise turn of the picture [rad]"""
    zoom: Annotated[float, Field(ge=0.7, le=1.4, allow_inf_nan=False)] = 1.0
    """enlargement of the picture"""
    tilt: Annotated[float, Field(ge=-0.6, le=0.6, allow_inf_nan=False)] = 0.0
    """angle between the camera's axis and the normal of the scene [rad]"""
    corruption: Corruption = "none"
    """what is wrong with the picture"""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class LoopSettings:
    """One run of the closed loop on the exosuit and the camera of a view."""

    view: View = Field(default_factory=View)
    """exosuit and camera; how it was driven does not matter, a run starts from rest"""
    target: Annotated[float, Field(ge=0.02, le=1.0, allow_inf_nan=False)] = 0.3
    """F_net to hold [N]"""
    law: Law = "scheduled"
    """what drives: the law that knows its exosuit behind its guard, or the paper's"""
    gain: Annotated[float, Field(ge=0.05, le=200.0, allow_inf_nan=False)] = 5.0
    """K_P of the paper's law [N/N]"""
    sensor: Sensor = "network"
    """what measures: the network on the picture, or the simulation's own forces"""
    disturbance: Disturbance = "none"
    """what goes wrong"""


Settings = TypeVar("Settings", View, LoopSettings)


def shape_of(view: View) -> ExosuitShape:
    """The shape of a view's exosuit.

    Raises InputError for another number of parameters, or one outside its range.
    """
    allowed = ranges(FAMILIES[view.family])
    count = sum(each.count for each in allowed.values())
    if len(view.parameters) != count:
        raise InputError(
            f"parameters: the family {view.family} has {count} ({', '.join(allowed)}), "
            f"got {len(view.parameters)}"
        )
    rest, named = list(view.parameters), {}
    for name, each in allowed.items():
        own, rest = rest[: each.count], rest[each.count :]
        named[name] = own if each.count > 1 else own[0]
    return shape_from_dict({"family": view.family, "parameters": named, "length": view.length})


def read_settings(kind: type[Settings], body: bytes) -> Settings:
    """Settings from JSON.

    Raises InputError with one sentence for what is no JSON, unknown, missing or out of range.
    """
    try:
        settings = pydantic.TypeAdapter(kind).validate_json(body, strict=True)
    except pydantic.ValidationError as error:
        raise InputError(_sentence(error)) from None
    shape_of(settings if isinstance(settings, View) else settings.view)
    return settings


def _sentence(error: pydantic.ValidationError) -> str:
    fault: dict[str, Any] = dict(error.errors(include_url=False)[0])
    name = ".".join(str(part) for part in fault["loc"])[:80] or "request"
    words = fault["msg"].removeprefix("Value error, ")
    return f"{name}: {words[:1].lower()}{words[1:200]}, got {str(fault['input'])[:80]!r}"
