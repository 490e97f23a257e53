"""Two strands of one rod, side by side and pressed into each other: the force between them in two programs.

The rod runs straight for SIDE, around a loop and straight back, with the strands' axes closer by DEPTH than
two radii. For a stiffness K, force a length and a depth, the force is K times the integral of the overlap.
The place of every node is given, so nothing has to be solved.
"""

from collections.abc import Callable
from dataclasses import dataclass

import elastica
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.neighbours import Case
from exosight.mechanics import Circular, Gauss, NodalQuadratic, Robot, Rod
from exosight.mechanics.surfaces import Tube
from exosight.mechanics.tube_contact import TubeContact

RADIUS, DEPTH, SIDE, LOOP = 2e-3, 1e-4, 0.05, 0.01
"""Radius of the rod, overlap of the strands, their length, and radius of the loop's axis [m]."""
STIFFNESS = 1e6
"""[N/m²]"""
HALF = RADIUS - DEPTH / 2
FLARE = np.arccos((LOOP + HALF) / (2 * LOOP))
"""Angle by which a strand first turns away from the other one [rad]."""
TURNS = np.array([-FLARE, np.pi + 2 * FLARE, -FLARE])
LENGTH = 2 * SIDE + LOOP * np.abs(TURNS).sum()
EXACT = STIFFNESS * DEPTH * (SIDE + 2 / 3 * np.sqrt(LOOP * DEPTH))
"""Between strands that part as s²/LOOP, the overlap goes on for √(LOOP · DEPTH) [N]."""


def axis(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (points, 3) of the axis at arc lengths, and unit tangents."""
    place, heading, begin = np.array([0.0, -HALF]), 0.0, 0.0
    found, along = np.zeros((len(s), 3)), np.zeros((len(s), 3))
    pieces = [(SIDE, 0.0), *((LOOP * abs(turn), np.sign(turn) / LOOP) for turn in TURNS), (SIDE, 0.0)]
    for size, bend in pieces:

        def at(way: np.ndarray, place=place, heading=heading, bend=bend) -> tuple[np.ndarray, np.ndarray]:
            angle = heading + bend * way
            if bend == 0:
                return place + way[:, None] * [np.cos(heading), np.sin(heading)], angle
            arc = np.stack([np.sin(angle) - np.sin(heading), np.cos(heading) - np.cos(angle)], axis=1)
            return place + arc / bend, angle

        inside = s >= begin
        found[inside, ::2], angle = at(s[inside] - begin)
        along[inside, ::2] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        (place,), (heading,) = at(np.array([size]))
        begin += size
    return found, along


class Exosight:
    """The rod with so many elements of eight points."""

    def __init__(self, elements: int) -> None:
        points = Gauss(elements, 8)
        radius = np.full(points.size, RADIUS)
        rod = Rod(
            "rod", LENGTH, Circular(radius), young=1e6, strains={"bend_y": NodalQuadratic(elements)},
            quadrature=points,
        )  # fmt: skip
        contact = TubeContact(Tube("rod", radius), Tube("rod", radius), jnp.array(STIFFNESS))
        robot = Robot((rod,), (contact,))
        place, along = axis(LENGTH * points.points)
        side = np.tile([0.0, 1.0, 0.0], (points.size, 1))
        pose = np.tile(np.eye(4), (points.size, 1, 1))
        pose[:, :3, :3] = np.stack([along, side, np.cross(along, side)], axis=2)
        pose[:, :3, 3] = place
        self._forces, self._pose = jax.jit(lambda pose: contact.forces(robot, pose)[0]), pose

    def __call__(self) -> float:
        """[N]"""
        return float(np.linalg.norm(np.asarray(self._forces(self._pose)).sum(axis=0)))


@dataclass(frozen=True)
class PyElastica:
    """The rod with so many elements, contact of each pair of them with stiffness `pair` [N/m]."""

    elements: int
    pair: float

    def __call__(self) -> float:
        """[N]"""
        place = axis(np.linspace(0.0, LENGTH, self.elements + 1))[0].T
        tangent = np.diff(place, axis=1)
        tangent /= np.linalg.norm(tangent, axis=0)
        side = np.tile([[0.0], [1.0], [0.0]], (1, self.elements))
        rod = elastica.CosseratRod.straight_rod(
            self.elements, place[:, 0], tangent[:, 0], side[:, 0], LENGTH, RADIUS, 1000.0,
            youngs_modulus=1e6, shear_modulus=1e6 / 3, position=place,
            directors=np.stack([np.cross(side, tangent, axis=0), side, tangent]),
        )  # fmt: skip
        elastica.RodSelfContact(k=self.pair, nu=0.0).apply_contact(rod, rod)
        return float(np.linalg.norm(rod.external_forces[:, : self.elements // 2].sum(axis=1)))


def strands() -> list[Case]:
    """The force against K times the integral of the overlap, relative."""

    def off(found: float) -> float:
        return abs(found / EXACT - 1)

    def pairs(n: int) -> Callable[[], float]:
        return PyElastica(n, STIFFNESS * LENGTH / n)

    return [
        *(Case("strands", "exosight", f"{n} elements", Exosight(n), off) for n in (5, 10, 20)),
        *(Case("strands", "PyElastica", f"{n} elements, k ~ 1/n", pairs(n), off) for n in (80, 160, 320)),
        *(
            Case(
                "strands", "PyElastica", f"{n} elements, k of 80", PyElastica(n, STIFFNESS * LENGTH / 80), off
            )
            for n in (160, 320)
        ),
    ]
