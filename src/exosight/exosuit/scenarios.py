"""The eleven scenarios of exosuit shapes, sampled on Table II's grids without duplicates.

Two shapes are the same when their lengths agree and their clipped radii agree to 1 µm everywhere. Distinct
parameters would not do: clipping makes half of all Legendre draws and one in seven cosine sums the same
plain cylinder. Every shape belongs to the first scenario that can make it (a straight profile to `linear`,
the Table I taper to `length`, the 10 cm rod to the scenario of fixed length), so the scenarios are disjoint
and each has a random stream of its own: a larger draw with the same seed only adds shapes to each scenario.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from exosight.errors import InputError
from exosight.exosuit.shapes import (
    FAMILIES,
    TABLE_I,
    ExosuitShape,
    Range,
    Surface,
    radius,
    ranges,
    shape_from_dict,
    shape_to_dict,
)


@dataclass(frozen=True)
class Scenario:
    """What varies from shape to shape."""

    name: str
    family: str
    surface_varies: bool
    """Whether the family's parameters vary; otherwise the surface is the Table I taper."""
    length_varies: bool
    """Whether the length varies; otherwise it is 10 cm."""


SCENARIOS: tuple[Scenario, ...] = (
    Scenario("length", TABLE_I.surface.family, surface_varies=False, length_varies=True),
    *(Scenario(family, family, surface_varies=True, length_varies=False) for family in FAMILIES),
    *(Scenario(f"{family}_length", family, surface_varies=True, length_varies=True) for family in FAMILIES),
)
"""The published scenarios; a scenario's index in a dataset is its place here."""


@dataclass(frozen=True)
class SampledShape:
    """One exosuit of a sampled set."""

    shape: ExosuitShape
    scenario: int
    """Index into SCENARIOS."""
    shape_id: int
    """Place in the set, 0, 1, 2 …"""


_LENGTHS: Range = ranges(ExosuitShape)["length"]
_STATIONS = np.linspace(0.0, 1.0, 101)  # the shortest wave, A = −15, still has 13 of them
_RESOLUTION = 1e-6  # [m], a hundredth of the step of R0 and R1


def _grid_size(allowed: Range) -> int:
    return int(np.floor((allowed.high - allowed.low) / allowed.step + 1e-9)) + 1


def _draw_values(allowed: Range, rng: np.random.Generator) -> list[float]:
    steps = rng.integers(_grid_size(allowed), size=allowed.count)
    # Rounding takes off what the multiplication adds, so that the grid reads as printed.
    return [round(allowed.low + allowed.step * int(step), 9) for step in steps]


def _draw_surface(family: type[Surface], rng: np.random.Generator) -> Surface:
    values = {name: (_draw_values(allowed, rng), allowed.count) for name, allowed in ranges(family).items()}
    return family(**{name: tuple(v) if count > 1 else v[0] for name, (v, count) in values.items()})


def _draw(scenario: Scenario, rng: np.random.Generator) -> ExosuitShape:
    surface = _draw_surface(FAMILIES[scenario.family], rng) if scenario.surface_varies else TABLE_I.surface
    length = _draw_values(_LENGTHS, rng)[0] if scenario.length_varies else TABLE_I.length
    return ExosuitShape(surface, length)


def geometry(shape: ExosuitShape) -> tuple[float, bytes]:
    """What makes two shapes the same: length, and radii in whole micrometres."""
    radii = np.round(radius(shape.surface, _STATIONS) / _RESOLUTION).astype(np.int32)
    return shape.length, radii.tobytes()


def _belongs_to_an_earlier(scenario: Scenario, shape: ExosuitShape) -> bool:
    if not scenario.surface_varies:
        return False
    if shape.surface == TABLE_I.surface or (scenario.length_varies and shape.length == TABLE_I.length):
        return True
    radii = radius(shape.surface, _STATIONS)
    chord = radii[0] + (radii[-1] - radii[0]) * _STATIONS
    return scenario.family != "linear" and bool(np.all(np.abs(radii - chord) < _RESOLUTION))


def sample_shapes(per_scenario: int, seed: int) -> list[SampledShape]:
    """Draw the same number of distinct exosuit shapes for every scenario, scenario after scenario.

    per_scenario  shapes of each of the eleven scenarios, 1…401; the publication has 125
    seed          whole number ≥ 0; scenario k draws from SeedSequence(seed, spawn_key=(k,))

    Raises InputError if a scenario's grid does not hold that many shapes.
    """
    most = _grid_size(_LENGTHS)
    if not 1 <= per_scenario <= most:
        raise InputError(
            f"shapes per scenario: expected 1…{most}, the number of lengths that the scenario 'length' has, "
            f"got {per_scenario}"
        )
    if seed < 0:
        raise InputError(f"seed: expected a whole number ≥ 0, got {seed}")
    seen: set[tuple[float, bytes]] = set()
    sampled: list[SampledShape] = []
    for index, scenario in enumerate(SCENARIOS):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
        while len(sampled) < (index + 1) * per_scenario:
            shape = _draw(scenario, rng)
            found = geometry(shape)
            if found in seen or _belongs_to_an_earlier(scenario, shape):
                continue
            seen.add(found)
            sampled.append(SampledShape(shape, scenario=index, shape_id=len(sampled)))
    return sampled


def sampled_to_dict(sampled: SampledShape) -> dict[str, Any]:
    """The sampled shape as JSON values: shape_id, scenario (its name) and what `shape_to_dict` gives."""
    scenario = SCENARIOS[sampled.scenario].name
    return {"shape_id": sampled.shape_id, "scenario": scenario, **shape_to_dict(sampled.shape)}


def sampled_from_dict(values: dict[str, Any]) -> SampledShape:
    """The sampled shape that `sampled_to_dict` wrote.

    Raises InputError naming what is unknown, missing or out of range.
    """
    rest = dict(values)
    shape_id, name = rest.pop("shape_id", None), rest.pop("scenario", None)
    names = [scenario.name for scenario in SCENARIOS]
    if name not in names:
        raise InputError(f"shape: unknown scenario {name!r}; the scenarios are {', '.join(names)}")
    if not isinstance(shape_id, int) or shape_id < 0:
        raise InputError(f"shape: shape_id must be a whole number ≥ 0, got {shape_id!r}")
    return SampledShape(shape_from_dict(rest), names.index(name), shape_id)
