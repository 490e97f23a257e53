"""What can be set of a system: the sliders of its designs, and the system that their values make."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from exosight.errors import InputError
from exosight.lab.pose_cache import round125
from exosight.system.design import Design
from exosight.system.designs import FileDesigns
from exosight.system.file import describe
from exosight.system.schema import Schema
from exosight.system.system import System
from exosight.system.units import KINDS, split_quantity


@dataclass(frozen=True)
class Slider:
    """One number on the page.

    key     of the value
    scale   shown = scale × value
    start   value of the nominal design
    place   in the value, if that is a list
    """

    key: str
    label: str
    unit: str
    scale: float
    low: float
    high: float
    step: float
    start: float
    place: int | None = None


@dataclass(frozen=True)
class Choice:
    """One of several kinds, each with sliders of its own.

    key      of the value that names the kind
    options  name, label and sliders of each
    """

    key: str
    label: str
    options: tuple[tuple[str, str, tuple[Slider, ...]], ...]


@dataclass(frozen=True)
class Group:
    """Sliders that stand together under a name; `choice` comes first."""

    name: str
    sliders: tuple[Slider, ...]
    choice: Choice | None = None


@runtime_checkable
class DesignControls(Protocol):
    """The designs of one system, as the page sets them: values by key, those left out are nominal."""

    @property
    def schema(self) -> Schema:
        """Of every design."""
        ...

    @property
    def groups(self) -> tuple[Group, ...]:
        """The sliders."""
        ...

    def complete(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The values with all that was left out; InputError for an unknown key or a value out of range."""
        ...

    def build(self, values: Mapping[str, Any]) -> System:
        """The system of complete values."""
        ...

    def words(self, values: Mapping[str, Any]) -> list[str]:
        """Options of `exosight lab` that give these values."""
        ...


class FileControls:
    """The designs of a system file: a slider for each entry that varies.

    A value is a number in the unit of the entry's limits.
    """

    def __init__(self, designs: FileDesigns) -> None:
        self._designs = designs
        self.schema = designs.schema
        tables = describe(designs.values).vary
        self._sliders = {
            table.entry: _slider(designs, table.entry, table.low, table.high) for table in tables
        }
        self.groups = (Group(designs.name, tuple(self._sliders.values())),) if tables else ()

    def complete(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """See `DesignControls`."""
        for entry, value in values.items():
            slider = self._sliders.get(entry)
            if slider is None:
                known = ", ".join(self._sliders) or "no entry at all"
                raise InputError(
                    f"design.{entry[:80]}: it does not vary in {self.schema.system}; expected {known}"
                )
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and slider.low <= value <= slider.high):  # NaN fails here too
                raise InputError(
                    f"design.{entry}: expected {slider.low:g} to {slider.high:g} {slider.unit}".rstrip()
                    + f", got {str(value)[:40]}"
                )
        return {entry: float(values.get(entry, slider.start)) for entry, slider in self._sliders.items()}

    def build(self, values: Mapping[str, Any]) -> System:
        """See `DesignControls`."""
        entries = {
            entry: _spelled(value, self._sliders[entry].unit) if self._sliders[entry].unit else value
            for entry, value in values.items()
            if value != self._sliders[entry].start
        }
        return self._designs.build(Design(0, 0, 0, entries))

    def words(self, values: Mapping[str, Any]) -> list[str]:
        """See `DesignControls`."""
        changed = [
            f"{entry}={_spelled(value, self._sliders[entry].unit)}"
            for entry, value in self.complete(values).items()
            if value != self._sliders[entry].start
        ]
        return ["--vary", *changed] if changed else []

    def parse(self, texts: Sequence[str]) -> dict[str, float]:
        """Values from texts such as "rods.sleeve.young=250 kPa"; InputError for one that is no such text."""
        values: dict[str, float] = {}
        for text in texts:
            entry, equals, value = text.partition("=")
            slider = self._sliders.get(entry)
            if not equals or slider is None:
                known = ", ".join(self._sliders) or "nothing in this system"
                raise InputError(f"vary: expected ENTRY=VALUE, where ENTRY is {known}, got {text[:80]!r}")
            try:
                values[entry] = _in_unit(value, slider.unit)
            except ValueError as error:
                raise InputError(f"vary: {entry}: {error}") from None
        self.complete(values)
        return values


def _slider(designs: FileDesigns, entry: str, low: str | float, high: str | float) -> Slider:
    """From the lower to the upper limit, in their unit; the file's own value lies within."""
    unit = split_quantity(low, "45 mm")[1] if isinstance(low, str) else ""
    least, most = (_in_unit(limit, unit) for limit in (low, high))
    start = _in_unit(_entry(designs.values, entry), unit)
    least, most = min(least, start), max(most, start)
    label = " ".join(entry.split(".")[1:] if entry.count(".") > 1 else entry.split("."))
    return Slider(entry, label, unit, 1.0, least, most, round125((most - least) / 100), start)


def _entry(values: Any, entry: str) -> Any:
    for step in entry.split("."):
        values = values[int(step)] if isinstance(values, list) else values[step]
    return values


def _in_unit(value: str | float, unit: str) -> float:
    """The number of a text such as "250 kPa" in a unit; ValueError for another quantity, or no such text."""
    if not unit:
        return float(value)
    number, given = split_quantity(value, f"1 {unit}")
    if given == unit:
        return number
    for kind in KINDS:
        if given in kind.units and unit in kind.units:
            return number * kind.units[given] / kind.units[unit]
    raise ValueError(f"expected a value in {unit}, got {str(value)[:40]!r}")


def _spelled(value: float, unit: str) -> str:
    return f"{value:.10g} {unit}".rstrip()


def key_of(values: Mapping[str, Any]) -> str:
    """What tells complete values from others."""
    return json.dumps(values, sort_keys=True)
