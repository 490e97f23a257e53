"""What a page may ask for, whatever the system: one view, one path, one run of the closed loop."""

from typing import Annotated, Any, Literal, TypeVar

import pydantic
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.errors import InputError
from exosight.validation import Name

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
Measured = Literal["network", "true"]
Disturbance = Literal["none", "noise", "lost", "frozen", "elsewhere", "softer"]

Finite = Annotated[float, Field(allow_inf_nan=False)]
Commands = Annotated[tuple[Finite, ...], Field(min_length=1, max_length=64)]
DesignValues = Annotated[dict[str, pydantic.JsonValue], Field(max_length=256)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class CameraSettings:
    """What the camera does to the picture, and what is wrong with it."""

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
class View:
    """A design of the system, how it was driven, and its camera."""

    design: DesignValues = Field(default_factory=dict)
    """what differs from the nominal design, by the keys of the system's sliders; see `DesignControls`"""
    drive: Annotated[tuple[Commands, ...], Field(max_length=64)] = ()
    """stops, one after the other from rest, each a command a channel [their units]; the channels move there
    one by one, in their order; the last stop is seen, and rest if there is none"""
    camera: CameraSettings = Field(default_factory=CameraSettings)
    """what the camera does"""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class PathSettings:
    """One channel of a view's system driven to its peak and back, while the others stay as in the view."""

    view: View = Field(default_factory=View)
    """the system, and the commands of the other channels"""
    channel: Name | None = None
    """that is driven; by default the first"""
    sensor: Name | None = None
    """that is read; by default the one that force control follows"""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class LoopSettings:
    """One run of the closed loop on the system and the camera of a view."""

    view: View = Field(default_factory=View)
    """system and camera; how it was driven does not matter, a run starts from rest"""
    sensor: Name | None = None
    """that follows the target; by default the one that force control follows"""
    channel: Name | None = None
    """that the law commands; by default the first"""
    target: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)] = 0.3
    """to hold [unit of the sensor]"""
    law: Law = "scheduled"
    """what drives: the law that knows its system behind its guard, or the paper's"""
    gain: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)] = 5.0
    """K_P of the paper's law [unit of the channel per unit of the sensor]"""
    measured: Measured = "network"
    """what measures: the network on the picture, or the simulation's own sensors"""
    disturbance: Disturbance = "none"
    """what goes wrong"""


Settings = TypeVar("Settings", View, PathSettings, LoopSettings)


def read_settings(kind: type[Settings], body: bytes) -> Settings:
    """Settings from JSON.

    Raises InputError with one sentence for what is no JSON, unknown, missing or out of range. Whether they
    fit a system is for `LabSystem.check` to say.
    """
    try:
        return pydantic.TypeAdapter(kind).validate_json(body, strict=True)
    except pydantic.ValidationError as error:
        raise InputError(sentence(error)) from None


def sentence(error: pydantic.ValidationError) -> str:
    """The first fault, and what was given, in one sentence."""
    fault: dict[str, Any] = dict(error.errors(include_url=False)[0])
    name = ".".join(str(part) for part in fault["loc"])[:80] or "request"
    words = fault["msg"].removeprefix("Value error, ")
    return f"{name}: {words[:1].lower()}{words[1:200]}, got {str(fault['input'])[:80]!r}"
