"""Designs: systems of one structure that differ in numbers. A dataset is made of designs, drawn by a seed."""

import json
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Bool
from pydantic import JsonValue

from exosight.errors import InputError
from exosight.system.build import build
from exosight.system.camera import Camera
from exosight.system.description import Description, VaryTable
from exosight.system.design import Design
from exosight.system.faults import at_place
from exosight.system.file import Values, describe, replaced
from exosight.system.observation import Observation
from exosight.system.schema import Schema
from exosight.system.system import System
from exosight.system.units import split_quantity

SHARES = (0.0, 0.6180339887498949, 1.0)
"""Of the way from low to high at which varied entries are tried; no entry that counts is whole in between."""


Filter = Callable[[Observation], Bool[np.ndarray, "*batch"]]
"""Which states of an observation a dataset leaves out."""


@runtime_checkable
class DesignSet(Protocol):
    """Where designs come from, and how a system is made of one."""

    @property
    def name(self) -> str:
        """Of the system."""
        ...

    @property
    def families(self) -> tuple[str, ...]:
        """Kinds of designs; a test may hold one of them out."""
        ...

    @property
    def scenarios(self) -> tuple[str, ...]:
        """What may vary; designs are drawn scenario by scenario."""
        ...

    @property
    def schema(self) -> Schema:
        """Of every design."""
        ...

    @property
    def camera(self) -> Camera:
        """The first camera of the nominal design."""
        ...

    @property
    def filters(self) -> Mapping[str, Filter]:
        """Frames that a dataset leaves out, beside no equilibria and crossing rods, by cause."""
        ...

    def draw(self, per_scenario: int, seed: int) -> tuple[Design, ...]:
        """So many designs of each scenario; InputError if there are not as many."""
        ...

    def build(self, design: Design) -> System:
        """The system of a design; InputError for parameters that are not this set's."""
        ...

    def numbers(self, design: Design) -> dict[str, float]:
        """What varies in the plant beside family and scenario, by name; equal names for all designs."""
        ...

    def key(self, design: Design) -> Hashable:
        """What is equal for designs of equal geometry, whatever their numbers and sets."""
        ...


class FileDesigns:
    """The designs of a system file: its entries, and what its `vary` tables say of them.

    Raises InputError for entries that no system can be built of, an entry to vary that is not there, and one
    that changes what all designs share: structure, channels, sensors, cameras.
    """

    scenarios = ("vary",)

    def __init__(self, values: Values) -> None:
        self.values = values
        self._description = describe(values)
        nominal = build(self._description)
        self.name, self.schema = nominal.name, nominal.schema
        self.families = (nominal.name,)
        self.camera = nominal.camera
        self.filters: Mapping[str, Filter] = {}
        for place, table in enumerate(self.varied):
            at_place(f"vary.{place}", _limits, table)
            if table.entry in [before.entry for before in self.varied[:place]]:
                raise InputError(f"vary.{place}: {table.entry} varies already")
        try:
            for share in SHARES:
                self._check_fit(self.varied, share, nominal)
        except InputError:  # one by one only to find which of them it was
            for place, table in enumerate(self.varied):
                for share in SHARES:
                    at_place(f"vary.{place}", self._check_fit, (table,), share, nominal)
            raise InputError(
                "vary: expected limits that all entries can be at together, got others"
            ) from None

    @property
    def varied(self) -> tuple[VaryTable, ...]:
        """What differs from design to design, as the file says it."""
        return self._description.vary

    def nominal(self) -> Design:
        """The design that the file describes."""
        return Design(0, 0, 0, {})

    def draw(self, per_scenario: int, seed: int) -> tuple[Design, ...]:
        """Designs with every varied entry drawn evenly between its limits.

        Design k depends on the seed and on k alone.
        """
        if per_scenario < 1 or seed < 0:
            raise InputError(
                f"designs: expected at least 1 and a seed of at least 0, got {per_scenario} and {seed}"
            )
        return tuple(self._design(number, seed) for number in range(per_scenario))

    def build(self, design: Design) -> System:
        """The system of the file with the design's entries in the place of its own.

        Zones on links whose length varies stay at their shares of a link, see `moved_zones`.
        """
        varied = {table.entry for table in self.varied}
        for entry in design.parameters:
            if entry not in varied:
                raise InputError(f"design {design.number}: {entry} does not vary in {self.name}")
        changed = replaced(self.values, design.parameters)
        moved = moved_zones(self._description, describe(changed))
        return build(describe(replaced(changed, {**moved, **design.parameters})))

    def numbers(self, design: Design) -> dict[str, float]:
        """The varied entries, as numbers in the units of the file."""
        return {
            entry: split_quantity(value, "45 mm")[0] if isinstance(value, str) else float(str(value))
            for entry, value in design.parameters.items()
        }

    def key(self, design: Design) -> Hashable:
        """The file's entries and the design's, as text."""
        return json.dumps([self.values, dict(design.parameters)], sort_keys=True)

    def _design(self, number: int, seed: int) -> Design:
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        return Design(number, 0, 0, {table.entry: _between(table, random.random()) for table in self.varied})

    def _check_fit(self, tables: Sequence[VaryTable], share: float, nominal: System) -> None:
        """InputError unless the system with these entries at this share stacks with the nominal one."""
        entries = {table.entry: _between(table, share) for table in tables}
        try:
            system = self.build(Design(0, 0, 0, entries))
        except InputError as error:
            given = ", ".join(f"{entry} = {value}" for entry, value in entries.items())
            raise InputError(f"with {given}: {error}") from None
        if jax.tree.structure(system) != jax.tree.structure(nominal):
            raise InputError(
                f"{', '.join(entries)} changes what all designs share (parts, names, channels, limits of "
                "sensors, cameras, shades); leave it out"
            )


def moved_zones(before: Description, after: Description) -> dict[str, str]:
    """Entries that move the middles of zones along chains of links with the links that they are on.

    A zone stays at its share of its link when lengths change.
    """
    found: dict[str, str] = {}
    for name, sensor in before.sensors.items():
        surface = before.surfaces.get(sensor.surface or "")
        if sensor.at is None or surface is None or not set(surface.bodies) <= set(before.links):
            continue
        old, new = (
            np.cumsum([0.0, *(of.links[body].length for body in surface.bodies)]) for of in (before, after)
        )
        if not np.array_equal(old, new):
            beyond = max(sensor.at - float(old[-1]), 0.0)
            found[f"sensors.{name}.at"] = f"{float(np.interp(sensor.at, old, new)) + beyond!r} m"
    return found


def _limits(table: VaryTable) -> tuple[float, float, str]:
    """Both limits and their unit; ValueError for limits that are none."""
    if isinstance(table.low, str) and isinstance(table.high, str):
        (low, unit), (high, other) = (split_quantity(text, "45 mm") for text in (table.low, table.high))
        if unit != other:
            raise ValueError(f"expected low and high in one unit, got {unit} and {other}")
    elif isinstance(table.low, str) or isinstance(table.high, str):
        raise ValueError(
            f"expected low and high both with a unit or without, got {table.low} and {table.high}"
        )
    else:
        low, high, unit = table.low, table.high, ""
    if not low < high:
        raise ValueError(f"expected low below high, got {table.low} and {table.high}")
    return low, high, unit


def _between(table: VaryTable, share: float) -> JsonValue:
    """The value at a share from low (0) to high (1), as the file would spell it."""
    low, high, unit = _limits(table)
    value = low + (high - low) * share
    return f"{value!r} {unit}" if unit else value
