"""Fingers and exosuits that differ from the nominal one: dimensions, stiffness, modulus and mounting.

Needs NumPy only; `exosight.exosuit.assembly.varied` makes the exosuit that a `Variant` describes.
"""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.errors import InputError
from exosight.validation import rising

Factor = Annotated[float, Field(ge=0.1, le=10.0)]
Angle = Annotated[float, Field(ge=-0.5, le=0.5)]
Distance = Annotated[float, Field(ge=-0.02, le=0.02)]


Factors = Annotated[tuple[Factor, Factor], AfterValidator(rising)]
Angles = Annotated[tuple[Angle, Angle], AfterValidator(rising)]
Distances = Annotated[tuple[Distance, Distance], AfterValidator(rising)]
Friction = Annotated[float, Field(ge=-2.0, le=2.0)]
Frictions = Annotated[tuple[Friction, Friction], AfterValidator(rising)]
Clearances = Annotated[
    tuple[Annotated[float, Field(ge=0.0, le=0.1)], Annotated[float, Field(ge=0.0, le=0.1)]],
    AfterValidator(rising),
]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class PlantVariation:
    """Between which limits exosuits and fingers differ; what is None does not vary.

    Factors are drawn evenly in their logarithm, angles and distances evenly. Every switch has draws of its
    own: turning one on or off leaves the others as they were.
    """

    link_length: Factors | None = None
    """factor on the length of each link of the finger, each on its own"""
    finger_radius: Factors | None = None
    """factor on the finger's radius, one for the whole finger"""
    joint_stiffness: Factors | None = None
    """factor on the stiffness of each joint, each on its own"""
    young: Factors | None = None
    """factor on the exosuit's Young's modulus"""
    contact_stiffness: Factors | None = None
    """factor on the penalty stiffness of contact"""
    gap: Clearances | None = None
    """further clearance at the base [m]"""
    mount_angle: Angles | None = None
    """inclination of the exosuit at its base [rad], positive away from the finger"""
    mount_offset: Distances | None = None
    """distance of the exosuit's base from the finger's, along the finger [m]"""
    friction: Frictions | None = None
    """change of the coefficient of friction, in systems with friction [-]; of index-friction by default −0.3
    to 0.3, which makes it 0 to 0.6"""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Variant:
    """How one worn exosuit differs from the nominal one; by default in nothing."""

    link_length: tuple[Factor, Factor, Factor, Factor] = (1.0, 1.0, 1.0, 1.0)
    """Factor on the length of each link [-]."""
    finger_radius: Factor = 1.0
    """Factor on every radius of the finger [-]."""
    joint_stiffness: tuple[Factor, Factor, Factor] = (1.0, 1.0, 1.0)
    """Factor on the stiffness of each joint [-]."""
    young: Factor = 1.0
    """Factor on the exosuit's Young's modulus [-]."""
    contact_stiffness: Factor = 1.0
    """Factor on the penalty stiffness of contact [-]."""
    gap: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    """Clearance at the base beyond the nominal one [m]."""
    mount_angle: Angle = 0.0
    """Inclination of the exosuit at its base beyond the nominal one [rad]."""
    mount_offset: Distance = 0.0
    """Distance of its base along the finger beyond the nominal one [m]."""
    friction: Friction = 0.0
    """Coefficient of friction beyond the nominal one [-]."""


NOMINAL = Variant()
"""The exosuit as it is configured."""

_STREAM = 100
"""First spawn key of the draws here; the scenarios of shapes use 0 to 10."""


def draw_variant(variation: PlantVariation, seed: int, shape_id: int) -> Variant:
    """The variant of one exosuit of a dataset; it depends on its number and the seed alone.

    Raises InputError for a negative seed or number.
    """
    if seed < 0 or shape_id < 0:
        raise InputError(f"seed and shape_id: expected whole numbers ≥ 0, got {seed} and {shape_id}")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM, shape_id)))
    share = rng.random(14).tolist()  # always all of them, so that the switches do not disturb each other

    def factor(limits: tuple[float, float] | None, at: float) -> float:
        return 1.0 if limits is None else _between(limits, limits[0] * (limits[1] / limits[0]) ** at)

    def amount(limits: tuple[float, float] | None, at: float) -> float:
        return 0.0 if limits is None else _between(limits, limits[0] + (limits[1] - limits[0]) * at)

    first, second, third, fourth = (factor(variation.link_length, at) for at in share[:4])
    near, middle, far = (factor(variation.joint_stiffness, at) for at in share[4:7])
    return Variant(
        link_length=(first, second, third, fourth),
        joint_stiffness=(near, middle, far),
        finger_radius=factor(variation.finger_radius, share[7]),
        young=factor(variation.young, share[8]),
        contact_stiffness=factor(variation.contact_stiffness, share[9]),
        gap=amount(variation.gap, share[10]),
        mount_angle=amount(variation.mount_angle, share[11]),
        mount_offset=amount(variation.mount_offset, share[12]),
        friction=amount(variation.friction, share[13]),
    )


def _between(limits: tuple[float, float], value: float) -> float:
    """The value without the round-off that would take it past a limit."""
    return min(max(value, limits[0]), limits[1])
