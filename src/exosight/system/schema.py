"""The interface of a system: its load channels, its sensors, its cameras.

The schema travels: it stands in the manifest of a dataset, the card of a network, a recording and a report,
and is compared wherever two of them meet. Usable without JAX.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from exosight.errors import InputError
from exosight.system.camera import Visibility
from exosight.validation import CONFIG, Name, SystemName, check_name, check_unique, first_fault

Finite = Annotated[float, Field(allow_inf_nan=False)]
Unit = Annotated[str, Field(max_length=16, pattern=r"^[A-Za-zµ°%Ω][A-Za-z0-9µ°%Ω/^ .-]*$")]
Quantity = Literal[
    "contact force", "net force", "joint angle", "force per length", "centre of pressure", "measurement"
]
"""A `measurement` is what an instrument read, of any unit and either sign; no simulation gives one."""
Component = Literal["magnitude", "normal", "tangential"]


@dataclass(frozen=True, config=CONFIG)
class Channel:
    """One load channel of a system: what an actuator is commanded to do.

    Raises a validation error for an empty range, or a rate that is not above 0.
    """

    name: Name
    unit: Unit
    low: Finite
    """Smallest command [unit]."""
    high: Finite
    """Largest command [unit]."""
    rate: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Largest change of the command a second [unit/s]; None: not limited."""
    drive: Finite | None = None
    """Command at the far end of a dataset's paths [unit]; None: the end of the range further from 0."""

    @property
    def peak(self) -> float:
        """Command at the far end of a dataset's paths [unit]."""
        return self.drive if self.drive is not None else max(self.high, self.low, key=abs)

    def __post_init__(self) -> None:
        if self.drive is not None and not (self.low <= self.drive <= self.high and self.drive != 0):
            raise ValueError(
                f"channel {self.name}: expected drive within its range and not 0, got {self.drive:g}"
            )
        if not self.low <= 0 <= self.high or self.low == self.high:
            raise ValueError(
                f"channel {self.name}: expected a range with 0 in it, got {self.low:g}…{self.high:g}"
            )


@dataclass(frozen=True, config=CONFIG)
class SensorSpec:
    """One scalar that is read off a state of a system."""

    name: Name
    quantity: Quantity
    unit: Unit
    estimated: bool = False
    """Whether networks estimate it from images."""
    parts: tuple[Name, ...] = ()
    """Of a net force: the sensors whose sum it is."""
    limit: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Largest magnitude that control may allow [unit]; None: not limited."""
    component: Component = "magnitude"
    """Of a contact force or a force per length: of all of it, or of its normal or tangential part."""

    @property
    def signed(self) -> bool:
        """Whether it may be below 0; what may not is 0 where there is no contact."""
        return self.quantity in ("joint angle", "measurement")


@dataclass(frozen=True, config=CONFIG)
class ViewSpec:
    """Name and image size of a camera [pixels], and which of several bodies its images show."""

    name: Name
    width: Annotated[int, Field(ge=1)]
    height: Annotated[int, Field(ge=1)]
    visibility: Visibility = Field("stacked", exclude_if=lambda value: value == "stacked")
    """Where a file does not say it, images were made before there was a choice. So it is left out where it is
    `stacked`: what identifies such a dataset stays."""


@dataclass(frozen=True, config=CONFIG)
class Schema:
    """Names, units and ranges of everything that goes into a system and comes out of it.

    A system of which only readings and pictures are known may have no channel.

    Raises a validation error if a name is used twice, or a sum names a sensor that does not come before it,
    has another unit or is counted twice.
    """

    system: SystemName
    channels: Annotated[tuple[Channel, ...], Field(max_length=64)]
    sensors: Annotated[tuple[SensorSpec, ...], Field(min_length=1, max_length=1024)]
    cameras: Annotated[tuple[ViewSpec, ...], Field(min_length=1, max_length=64)]

    def __post_init__(self) -> None:
        for kind in ("channels", "sensors", "cameras"):
            check_unique(kind, (entry.name for entry in getattr(self, kind)))
        units: dict[str, str] = {}
        for sensor in self.sensors:
            for part in sensor.parts:
                if part not in units:
                    raise ValueError(f"sensor {sensor.name}: it sums {part}, which is no sensor before it")
                if units[part] != sensor.unit:
                    raise ValueError(
                        f"sensor {sensor.name}: it sums {part}, which is in {units[part]}, not {sensor.unit}"
                    )
            units[sensor.name] = sensor.unit
        _ = self._sums  # as a check

    @property
    def estimated(self) -> tuple[SensorSpec, ...]:
        """The sensors that networks estimate, in the order of their outputs."""
        return tuple(sensor for sensor in self.sensors if sensor.estimated)

    @property
    def measured(self) -> bool:
        """Whether an instrument gives what is estimated: no simulation does."""
        return any(sensor.quantity == "measurement" for sensor in self.estimated)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the sensors that networks estimate."""
        return tuple(sensor.name for sensor in self.estimated)

    @property
    def controllable(self) -> tuple[str, ...]:
        """Names of the sensors that follow from what is estimated: the estimated ones and their sums."""
        return tuple(sensor.name for sensor in self.sensors if sensor.name in self._sums)

    @property
    def controlled(self) -> str:
        """The sensor that force control follows by default: the first sum, or the first estimated one."""
        sums = [s.name for s in self.sensors if s.parts and s.name in self.controllable]
        return (sums or list(self.controllable))[0]

    @property
    def image_size(self) -> tuple[int, int]:
        """(height, width) of the images of the first camera [pixels]."""
        return self.cameras[0].height, self.cameras[0].width

    def index(self, name: str) -> int:
        """Place of a sensor among all; InputError if there is none of this name."""
        if "+" in name:
            raise InputError(
                f"sensor: expected the name of one, got {name!r}; a sum of some is a sensor of type "
                "net_force in the system's file"
            )
        return self._place("sensor", name, self.sensors)

    def sensor(self, name: str) -> SensorSpec:
        """A sensor by its name; InputError if there is none."""
        return self.sensors[self.index(name)]

    def channel_index(self, name: str | None = None) -> int:
        """Place of a channel, by default the first; InputError if there is none of this name."""
        return 0 if name is None else self._place("channel", name, self.channels)

    def channel(self, name: str | None = None) -> Channel:
        """A channel by its name, the first by default; InputError if there is none."""
        return self.channels[self.channel_index(name)]

    def commands(
        self, u: float | Float[np.ndarray, "*batch"], channel: str | None = None
    ) -> Float[np.ndarray, "*batch channels"]:
        """u on one channel, the first by default, and 0 on the others [each in its unit]."""
        commands = np.zeros((*np.shape(u), len(self.channels)))
        commands[..., self.channel_index(channel)] = u
        return commands

    def check_commands(
        self, commands: Float[np.ndarray, "*batch channels"]
    ) -> Float[np.ndarray, "*batch channels"]:
        """The commands as floats; InputError unless each is a number within its channel's range."""
        values = np.asarray(commands, dtype=float)
        if values.shape[-1:] != (len(self.channels),):
            names = ", ".join(channel.name for channel in self.channels)
            raise InputError(f"commands: expected one for each channel ({names}), got shape {values.shape}")
        for channel, column in zip(self.channels, np.moveaxis(values, -1, 0), strict=True):
            wrong = column[~((column >= channel.low) & (column <= channel.high))]  # NaN is caught here too
            if wrong.size:
                raise InputError(
                    f"{channel.name}: expected {channel.low:g} to {channel.high:g} {channel.unit}, got "
                    f"{wrong.flat[0]:g}"
                )
        return values

    def _place(self, kind: str, name: str, entries: Sequence[Channel] | Sequence[SensorSpec]) -> int:
        names = [entry.name for entry in entries]
        check_name(kind, name, names)
        return names.index(name)

    def output_indices(self) -> list[int]:
        """Places of the estimated sensors among all."""
        return [self.index(name) for name in self.outputs]

    def weights(self, name: str) -> Float[np.ndarray, " outputs"]:
        """w with sensor = w · (estimated sensors).

        Raises InputError for a sensor that does not follow from the estimated ones.
        """
        self.index(name)
        if name not in self._sums:
            raise InputError(
                f"sensor {name}: it is not estimated from images; choose one of "
                f"{', '.join(self.controllable)}"
            )
        return self._sums[name].copy()

    @cached_property
    def _sums(self) -> dict[str, Float[np.ndarray, " outputs"]]:
        """`weights` of every sensor that follows from the estimated ones, each part before its sum."""
        found = dict(zip(self.outputs, np.eye(len(self.outputs)), strict=True))
        for sensor in self.sensors:
            if sensor.name not in found and sensor.parts and found.keys() >= set(sensor.parts):
                found[sensor.name] = np.sum([found[part] for part in sensor.parts], axis=0)
                if (found[sensor.name] > 1).any():  # sums of sums of sums would grow without limit
                    raise ValueError(f"sensor {sensor.name}: it counts a sensor twice")
        return found

    @property
    def limits(self) -> tuple[Float[np.ndarray, " channels"], Float[np.ndarray, " channels"]]:
        """Smallest and largest command of every channel [its unit]."""
        return np.array([c.low for c in self.channels]), np.array([c.high for c in self.channels])


_ADAPTER = TypeAdapter(Schema)


def schema_to_dict(schema: Schema) -> dict[str, Any]:
    """The schema as JSON values."""
    return _ADAPTER.dump_python(schema, mode="json")


def schema_from_dict(values: Any) -> Schema:
    """The schema that `schema_to_dict` wrote; InputError naming the first entry that does not fit."""
    try:
        return _ADAPTER.validate_python(values)
    except ValidationError as error:
        raise InputError(f"schema: {first_fault(error)}") from None


def difference(
    first: Schema, second: Schema, parts: Sequence[str] = ("channels", "sensors", "cameras")
) -> str | None:
    """How the second schema differs from the first in the given parts, in words, or None if they agree.

    Names of systems may differ: two systems are interchangeable where their channels, sensors and cameras
    agree.
    """
    for kind in parts:
        mine, other = getattr(first, kind), getattr(second, kind)
        names, others = [x.name for x in mine], [x.name for x in other]
        if names != others:
            return f"expected the {kind} {', '.join(names)}, got {', '.join(others)}"
        for a, b in zip(mine, other, strict=True):
            for field in a.__dataclass_fields__:
                x, y = getattr(a, field), getattr(b, field)
                same = (
                    math.isclose(x, y, rel_tol=1e-12)
                    if isinstance(x, float) and isinstance(y, float)
                    else x == y
                )
                if not same:
                    return f"{kind[:-1]} {a.name}: expected {field} {_shown(x)}, got {_shown(y)}"
    return None


def network_difference(trained: Schema, schema: Schema, *, channels: bool = False) -> str | None:
    """How a schema differs from the one of a network in what the network depends on, or None if it does not.

    These are the estimated sensors, not their limits, the cameras and, if its inputs are commands, the
    channels. Sensors that are not estimated may differ: another sum of the same zones needs no training.
    """

    def outputs(of: Schema) -> Schema:
        return replace(of, sensors=tuple(replace(sensor, limit=None) for sensor in of.estimated))

    parts = ("channels", "sensors", "cameras") if channels else ("sensors", "cameras")
    return difference(outputs(trained), outputs(schema), parts)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return " + ".join(map(str, value)) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)
