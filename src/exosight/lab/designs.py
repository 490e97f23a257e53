"""The values of a design that can be set: their sliders, and the system that the values describe."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from exosight.errors import InputError
from exosight.lab.pose_cache import round125
from exosight.system.design import Design
from exosight.system.designs import FileDesigns
from exosight.system.schema import Schema
from exosight.system.system import System
from exosight.system.units import KINDS, split_quantity


@dataclass(frozen=True)
class Slider:
    """One number on the page.

    key     of the value
    unit    of what is shown
    start   value of the nominal design
    scale   shown = scale × value
    """

    key: str
    label: str
    unit: str
    low: float
    high: float
    step: float
    start: float
    scale: float = 1.0


@dataclass(frozen=True)
class Option:
    """One kind of a `Choice`, with sliders of its own."""

    name: str
    label: str
    sliders: tuple[Slider, ...]


@dataclass(frozen=True)
class Choice:
    """One of several kinds; the first is the nominal one. `key` is that of the value that names the kind."""

    key: str
    label: str
    options: tuple[Option, ...]


@dataclass(frozen=True)
class Group:
    """Sliders that stand together under a name; `choice` comes first."""

    name: str
    sliders: tuple[Slider, ...]
    choice: Choice | None = None


Values = Mapping[str, Any]
"""Of a design, by key: a number in its slider's unit, or the name of a kind; those left out are nominal."""


class DesignControls:
    """The designs of one system, as the page sets them.

    schema   of every design
    groups   the sliders
    build    the system of complete values
    """

    def __init__(self, schema: Schema, groups: tuple[Group, ...], build: Callable[[Values], System]) -> None:
        self.schema, self.groups, self.build = schema, groups, build

    def complete(self, values: Values) -> dict[str, Any]:
        """The values with all that was left out; InputError for an unknown key or a value out of range."""
        kinds, sliders = self._settable(values)
        for key, value in values.items():
            if key in kinds:
                continue
            if key not in sliders:
                known = ", ".join((*kinds, *sliders)) or "no entry at all"
                raise InputError(
                    f"design.{key[:80]}: it does not vary in {self.schema.system}; expected {known}"
                )
            slider = sliders[key]
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and slider.low <= value <= slider.high):  # NaN fails here too
                raise InputError(
                    f"design.{key}: expected {slider.low:g} to {slider.high:g} {slider.unit}".rstrip()
                    + f", got {str(value)[:40]}"
                )
        return kinds | {key: float(values.get(key, slider.start)) for key, slider in sliders.items()}

    def changed(self, values: Values) -> list[str]:
        """Texts such as "rods.sleeve.young=250 kPa" for all that is not nominal, which `parse` reads."""
        nominal, (_, sliders) = self._settable({})[0], self._settable(values)
        return [
            f"{key}={spelled(value, sliders[key].unit) if key in sliders else value}"
            for key, value in self.complete(values).items()
            if value != (sliders[key].start if key in sliders else nominal[key])
        ]

    def parse(self, texts: Sequence[str]) -> dict[str, Any]:
        """Values from the texts of `changed`; InputError for one that is no such text."""
        given = {key: value for key, _, value in (text.partition("=") for text in texts)}
        kinds, sliders = self._settable(given)
        values: dict[str, Any] = {}
        for (key, value), text in zip(given.items(), texts, strict=False):
            if "=" not in text or key not in (*kinds, *sliders):
                known = ", ".join((*kinds, *sliders)) or "nothing in this system"
                raise InputError(f"vary: expected ENTRY=VALUE, where ENTRY is {known}, got {text[:80]!r}")
            try:
                values[key] = value if key in kinds else _in_unit(value, sliders[key].unit)
            except ValueError as error:
                raise InputError(f"vary: {key}: {error}") from None
        self.complete(values)
        return values

    def _settable(self, values: Values) -> tuple[dict[str, str], dict[str, Slider]]:
        """The kind of each choice, and all sliders that these leave."""
        kinds: dict[str, str] = {}
        sliders = [slider for group in self.groups for slider in group.sliders]
        for choice in (group.choice for group in self.groups if group.choice):
            options = {option.name: option for option in choice.options}
            kind = values.get(choice.key, choice.options[0].name)
            if not isinstance(kind, str) or kind not in options:
                raise InputError(
                    f"design.{choice.key}: expected one of {', '.join(options)}, got {str(kind)[:40]!r}"
                )
            kinds[choice.key] = kind
            sliders += options[kind].sliders
        return kinds, {slider.key: slider for slider in sliders}


def file_controls(designs: FileDesigns) -> DesignControls:
    """The designs of a system file: a slider for each entry that varies, in the unit of its limits."""
    sliders = {each.entry: _slider(designs, each.entry, each.low, each.high) for each in designs.varied}

    def build(values: Values) -> System:
        changed = {entry: value for entry, value in values.items() if value != sliders[entry].start}
        texts = {
            entry: spelled(value, sliders[entry].unit) if sliders[entry].unit else value
            for entry, value in changed.items()
        }
        return designs.build(Design(0, 0, 0, texts))

    groups = (Group(designs.name, tuple(sliders.values())),) if sliders else ()
    return DesignControls(designs.schema, groups, build)


def _slider(designs: FileDesigns, entry: str, low: str | float, high: str | float) -> Slider:
    """From the lower to the upper limit, in their unit; the file's own value lies within."""
    unit = split_quantity(low, "45 mm")[1] if isinstance(low, str) else ""
    least, most = (_in_unit(limit, unit) for limit in (low, high))
    start = _in_unit(_entry(designs.values, entry), unit)
    least, most = min(least, start), max(most, start)
    label = " ".join(entry.split(".")[1:] if entry.count(".") > 1 else entry.split("."))
    return Slider(entry, label, unit, least, most, round125((most - least) / 100), start)


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


def spelled(value: float, unit: str) -> str:
    """A number with its unit, as system files have it."""
    return f"{value:.10g} {unit}".rstrip()


def key_of(values: Values) -> str:
    """What tells complete values from others."""
    return json.dumps(values, sort_keys=True)
