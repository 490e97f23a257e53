"""A rod that is twisted, then shortened until it lies across itself in a loop: the moment at its ends.

Both ends are clamped on one line; the far one turns by TURNS about it and then comes nearer by SHORTER of the
length. Only the equilibrium is compared: there the moment follows from the rod's elasticity and from its
thickness where it crosses itself, and hardly depends on how stiff contact is (some micrometres of depth) or
how either program spreads it over elements.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import elastica
import jax.numpy as jnp
import numpy as np

from benchmarks.neighbours import Case
from benchmarks.rest import Simulator
from exosight import lie
from exosight.mechanics import (
    Bushing,
    Circular,
    Cylindrical,
    Gauss,
    JointTorque,
    Link,
    NodalQuadratic,
    Robot,
    Rod,
    drive,
)
from exosight.mechanics.rod import STRAINS
from exosight.mechanics.surfaces import Tube
from exosight.mechanics.tube_contact import TubeContact

RADIUS, LENGTH, YOUNG, DENSITY, STIFFNESS = 2e-3, 0.2, 1e6, 1000.0, 1e5
"""[m], [m], [Pa], [kg/m³], and of contact, a length and a depth [N/m²]."""
TURNS, SHORTER, BENT = 2.0, 0.5, 0.5
"""Turns of the far end, share of the length by which the ends approach, and the rod's own curvature, which
decides to which side it gives way [1/m]."""
BENDING = YOUNG * np.pi * RADIUS**4 / 4
TWISTED, TOGETHER, STILL, LONGEST, DRAG = 0.5, 2.5, 1e-5, 20.0, 5.0
"""PyElastica's rod is twisted by then and shortened by then [s], at rest below that speed [m/s], given up
after that [s]; its damping [1/s], with which it rests soonest of 5, 15 and 50. On 40 elements it never rests:
its strands slide from one element to the next."""


@dataclass(frozen=True)
class Exosight:
    """Bending, twist and stretch on so many nodal quadratic elements, the far end held by stiff springs."""

    elements: int

    def __call__(self) -> float:
        """[N m]"""
        points = Gauss(self.elements, 6)
        radius = np.full(points.size, RADIUS)
        natural = np.array([0.0, BENT, 0.0, 1.0, 0.0, 0.0])
        rod = Rod(
            "rod", LENGTH, Circular(radius), young=YOUNG, poisson=0.5, quadrature=points,
            strains=dict.fromkeys(STRAINS[:4], NodalQuadratic(self.elements)),
            natural=lambda x: np.tile(natural, (len(x), 1)),
        )  # fmt: skip
        turn, slide = 1e3 * BENDING / LENGTH, 1e5 * BENDING / LENGTH**3
        head = Link(
            "head", 0.0, np.zeros((1, 3)), mount=lie.translation(jnp.array([LENGTH, 0.0, 0.0])),
            joint=Cylindrical(stiffness=[turn, slide]),
        )  # fmt: skip
        held = 1e4 * BENDING / LENGTH * np.array([1.0, 1.0, 1.0, *np.full(3, LENGTH**-2)])
        terms = (
            JointTorque("head", 0, 0),
            JointTorque("head", 1, 1),
            Bushing(("head", 0), ("rod", -1), held),
            TubeContact(Tube("rod", radius), Tube("rod", radius), jnp.array(STIFFNESS)),
        )
        robot = Robot((rod, head), terms)
        angle, nearer = 2 * np.pi * TURNS * turn, SHORTER * LENGTH * slide
        first = np.linspace(0.0, 1.0, 11)[1:, None] * [angle, 0.0]
        then = np.array([angle, 0.0]) - np.linspace(0.0, 1.0, 51)[1:, None] * [0.0, nearer]
        found = drive([robot], np.concatenate([first, then]))
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        return float(angle - turn * found.q[0, -1, -2])


class _Moved(elastica.ConstraintBase):
    """The last element turns about the axis and comes nearer along it, its two nodes with it."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.place, self.frame = None, None

    def constrain_values(self, system: Any, time: np.float64) -> None:
        """Where it is at that time."""
        if self.place is None:
            self.place = system.position_collection[:, -2:].copy()
            self.frame = system.director_collection[..., -1].copy()
        angle = 2 * np.pi * TURNS * min(1.0, time / TWISTED)
        nearer = SHORTER * LENGTH * np.clip((time - TWISTED) / (TOGETHER - TWISTED), 0.0, 1.0)
        system.position_collection[:, -2:] = self.place - [[nearer], [0.0], [0.0]]
        c, s = np.cos(angle), np.sin(angle)
        about = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        system.director_collection[..., -1] = self.frame @ about.T

    def constrain_rates(self, system: Any, time: np.float64) -> None:
        """Only its place counts."""
        system.velocity_collection[:, -2:] = 0.0
        system.omega_collection[:, -1] = 0.0


@dataclass(frozen=True)
class PyElastica:
    """So many elements between the clamped ones' middles; each pair's contact is STIFFNESS times a length."""

    elements: int

    def __call__(self) -> float:
        """Let motion die away, then read [N m]."""
        size, count = LENGTH / self.elements, self.elements + 1
        rod = elastica.CosseratRod.straight_rod(
            count, np.array([-size / 2, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]),
            count * size, RADIUS, DENSITY, youngs_modulus=YOUNG, shear_modulus=YOUNG / 3,
        )  # fmt: skip
        rod.rest_kappa[0] = BENT
        step = 0.2 * size / np.sqrt(YOUNG / DENSITY)
        simulator = Simulator()
        simulator.append(rod)
        simulator.constrain(rod).using(
            elastica.FixedConstraint, constrained_position_idx=(0, 1), constrained_director_idx=(0,)
        )
        simulator.constrain(rod).using(_Moved)
        simulator.dampen(rod).using(
            elastica.AnalyticalLinearDamper, uniform_damping_constant=DRAG, time_step=step
        )
        simulator.detect_contact_between(rod, rod).using(elastica.RodSelfContact, k=STIFFNESS * size, nu=0.0)
        simulator.finalize()
        stepper, now, look = elastica.PositionVerlet(), np.float64(0.0), TOGETHER
        while look == TOGETHER or np.abs(rod.velocity_collection).max() > STILL:
            look += 0.05
            while now < look:
                now = stepper.step(simulator, now, step)
            if not (now < LONGEST and np.isfinite(rod.velocity_collection).all()):
                raise RuntimeError(f"PyElastica's rod did not come to rest within {LONGEST} s")
        return float(abs(rod.internal_couple[2, -1]))


@cache
def _fine() -> float:
    """exosight on twice as many elements as the finest that are compared."""
    return Exosight(24)()


def twists() -> list[Case]:
    """The moment against that of exosight's finest, relative."""

    def off(found: float) -> float:
        return abs(found / _fine() - 1)

    return [
        *(Case("twist", "exosight", f"{n} elements", Exosight(n), off) for n in (6, 8, 12)),
        *(Case("twist", "PyElastica", f"{n} elements", PyElastica(n), off) for n in (60, 80)),
    ]
