"""Designs: systems of one structure that differ in numbers. A dataset is made of designs, drawn by a seed."""

from collections.abc import Hashable
from typing import Any, Protocol, runtime_checkable

import numpy as np

from exosight.errors import InputError
from exosight.system.build import build
from exosight.system.description import VaryTable
from exosight.system.design import Design
from exosight.system.file import Values, describe, replaced
from exosight.system.schema import Schema
from exosight.system.system import System
from exosight.system.units import split_quantity


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

    def draw(self, per_scenario: int, seed: int) -> tuple[Design, ...]:
        """So many designs of each scenario; InputError if there are not as many."""
        ...

    def build(self, design: Design) -> System:
        """The system of a design; InputError for parameters that are not this set's."""
        ...


class FileDesigns:
    """The designs of a system file: its entries, and what its `vary` tables say of them.

    Raises InputError for entries that no system can be built of, or an entry to vary that is not there.
    """

    scenarios = ("vary",)

    def __init__(self, values: Values) -> None:
        self.values = values
        self._description = describe(values)
        nominal = build(self._description)
        self.name, self.schema = nominal.name, nominal.schema
        self.families = (nominal.name,)
        for place, table in enumerate(self._description.vary):
            _check_limits(place, table)
            for limit in (table.low, table.high):
                try:
                    build(describe(replaced(values, table.entry, limit)))
                except InputError as error:
                    raise InputError(f"vary.{place}: with {table.entry} = {limit!r}: {error}") from None

    def nominal(self) -> Design:
        """The design that the file describes."""
        return Design(0, 0, 0, {})

    def draw(self, per_scenario: int, seed: int) -> tuple[Design, ...]:
        """Designs with every varied entry drawn evenly between its limits; number k depends on seed and k alone."""
        if per_scenario < 1 or seed < 0:
            raise InputError(
                f"designs: expected at least 1 and a seed of at least 0, got {per_scenario} and {seed}"
            )
        return tuple(
            Design(
                number,
                0,
                0,
                self._drawn(np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))),
            )
            for number in range(per_scenario)
        )

    def build(self, design: Design) -> System:
        """The system of the file with the design's entries in the place of its own."""
        values = self.values
        varied = {table.entry for table in self._description.vary}
        for entry, value in design.parameters.items():
            if entry not in varied:
                raise InputError(f"design {design.number}: {entry} does not vary in {self.name}")
            values = replaced(values, entry, value)
        return build(describe(values))

    def _drawn(self, random: np.random.Generator) -> dict[str, Any]:
        drawn: dict[str, Any] = {}
        for table in self._description.vary:
            share = random.random()
            if isinstance(table.low, str):
                (low, unit), (high, _) = (split_quantity(text, "45 mm") for text in (table.low, table.high))
                drawn[table.entry] = f"{low + (high - low) * share!r} {unit}"
            else:
                drawn[table.entry] = float(table.low) + (float(table.high) - float(table.low)) * share
        return drawn


def _check_limits(place: int, table: VaryTable) -> None:
    if isinstance(table.low, str) != isinstance(table.high, str):
        raise InputError(f"vary.{place}: expected low and high both with a unit or both without")
    if isinstance(table.low, str) and isinstance(table.high, str):
        try:
            (low, unit), (high, other) = (split_quantity(text, "45 mm") for text in (table.low, table.high))
        except ValueError as error:
            raise InputError(f"vary.{place}: {error}") from None
        if unit != other:
            raise InputError(f"vary.{place}: expected low and high in one unit, got {unit} and {other}")
    else:
        low, high = float(table.low), float(table.high)
    if not low < high:
        raise InputError(f"vary.{place}: expected low below high, got {table.low} and {table.high}")
