"""A coil of one and a half turns pressed together by a force at its tip, until its turns lie on each other.

Only equilibrium is compared: there the force between the turns follows from the coil's own elasticity, so
that it hardly depends on how either program spreads contact over its elements. The coil is clamped at its
base and free of stress as a helix whose turns do not touch.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import elastica
import jax.numpy as jnp
import numpy as np

from benchmarks.neighbours import Case
from exosight.mechanics import Circular, DeadForce, Gauss, NodalQuadratic, Robot, Rod, SolverOptions, drive
from exosight.mechanics.energy import stiffness
from exosight.mechanics.kinematics import walk
from exosight.mechanics.rod import STRAINS
from exosight.mechanics.surface_contact import Tube
from exosight.mechanics.tube_contact import TubeContact

RADIUS, COIL, PITCH, TURNS = 4e-3, 0.02, 0.012, 1.5
"""Radius of the rod, radius of the coil, advance a turn [m]; turns."""
YOUNG, DENSITY, FORCE, STIFFNESS = 1e6, 1000.0, 0.05, 1e5
"""[Pa], [kg/m³], [N], and of contact, a length and a depth [N/m²]."""
ADVANCE = PITCH / (2 * np.pi)
SPEED = np.hypot(COIL, ADVANCE)
LENGTH = 2 * np.pi * TURNS * SPEED
DAMPING, STILL, RAMP, LONGEST = 15.0, 1e-5, 0.2, 20.0
"""PyElastica's damping [1/s], near the best of 5, 15, 50; what counts as at rest [m/s]; its load is raised
over RAMP [s]."""


class Rest(NamedTuple):
    """The tip [m], the force of one turn on the next along the coil's axis [N], elastic energy [J]."""

    tip: np.ndarray
    push: float
    energy: float


def axis(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of the helix about z, unit tangents and inward normals at arc lengths: (points, 3) each."""
    angle, none = s / SPEED, np.zeros_like(s)
    place = np.stack([COIL * np.cos(angle), COIL * np.sin(angle), ADVANCE * angle], axis=1)
    tangent = np.stack([-COIL * np.sin(angle), COIL * np.cos(angle), none + ADVANCE], axis=1) / SPEED
    return place, tangent, -np.stack([np.cos(angle), np.sin(angle), none], axis=1)


@dataclass(frozen=True)
class Exosight:
    """All six strains on so many nodal quadratic elements."""

    elements: int

    def __call__(self) -> Rest:
        """Solve, read."""
        points = Gauss(self.elements, 12)
        natural = np.array([ADVANCE, COIL, 0.0, SPEED**2, 0.0, 0.0]) / SPEED**2
        place, tangent, inward = (each[0] for each in axis(np.zeros(1)))
        mount = np.eye(4)
        mount[:3, :3] = np.stack([tangent, np.cross(tangent, inward), -inward], axis=1)
        mount[:3, 3] = place
        radius = np.full(points.size, RADIUS)
        rod = Rod(
            "rod", LENGTH, Circular(radius), young=YOUNG, poisson=0.5, quadrature=points,
            strains=dict.fromkeys(STRAINS[:4], NodalQuadratic(self.elements)),
            natural=lambda x: np.tile(natural, (len(x), 1)), mount=jnp.asarray(mount),
        )  # fmt: skip
        contact = TubeContact(Tube("rod", radius), Tube("rod", radius), jnp.array(STIFFNESS))
        robot = Robot((rod,), (DeadForce("rod", -1, 0, jnp.array([0.0, 0.0, -1.0])), contact))
        found = drive([robot], np.array([[FORCE]]), options=SolverOptions(unrolled=False))
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        q = jnp.asarray(found.q[0, 0])
        motion = walk(robot, q)
        push = contact.forces(robot, motion.pose)[0]
        energy = 0.5 * q @ stiffness(robot) @ q
        return Rest(np.asarray(motion.position[-1]), -float(push[:, 2].sum()), float(energy))


class _Simulator(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping, elastica.Contact
):
    """PyElastica's way to say what a simulation may contain."""


@dataclass(frozen=True)
class PyElastica:
    """So many elements, half of the first in the clamp; each pair's contact is STIFFNESS times a length."""

    elements: int
    share: float = 1.0

    def __call__(self) -> Rest:
        """Let motion die away, read."""
        size = LENGTH / (self.elements - 0.5)
        nodes = size * (np.arange(self.elements + 1) - 0.5)
        place = axis(nodes)[0].T
        tangent = np.diff(place, axis=1)
        tangent /= np.linalg.norm(tangent, axis=0)
        inward = axis(nodes[:-1] + size / 2)[2].T
        inward -= (inward * tangent).sum(axis=0) * tangent
        inward /= np.linalg.norm(inward, axis=0)
        rod = elastica.CosseratRod.straight_rod(
            self.elements, place[:, 0], tangent[:, 0], inward[:, 0], self.elements * size, RADIUS, DENSITY,
            youngs_modulus=YOUNG, shear_modulus=28 / 27 * YOUNG / 3, position=place,
            directors=np.stack([inward, np.cross(tangent, inward, axis=0), tangent]),
        )  # fmt: skip
        rod.rest_kappa[:] = rod.kappa
        step = 0.2 * size / np.sqrt(YOUNG / DENSITY)
        simulator, pair = _Simulator(), self.share * STIFFNESS * size
        simulator.append(rod)
        simulator.constrain(rod).using(
            elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        force = np.array([0.0, 0.0, -FORCE])
        simulator.add_forcing_to(rod).using(elastica.EndpointForces, np.zeros(3), force, ramp_up_time=RAMP)
        simulator.dampen(rod).using(
            elastica.AnalyticalLinearDamper, uniform_damping_constant=DAMPING, time_step=step
        )
        simulator.detect_contact_between(rod, rod).using(elastica.RodSelfContact, k=pair, nu=0.0)
        simulator.finalize()
        stepper, now, look = elastica.PositionVerlet(), np.float64(0.0), 2 * RAMP
        while np.abs(rod.velocity_collection).max() > STILL or now < 2 * RAMP:
            look += 0.05
            while now < look:
                now = stepper.step(simulator, now, step)
            if not (now < LONGEST and np.isfinite(rod.velocity_collection).all()):
                raise RuntimeError(f"PyElastica's coil did not come to rest within {LONGEST} s")
        energy = rod.compute_bending_energy() + rod.compute_shear_energy()
        rod.external_forces[:] = 0.0
        elastica.RodSelfContact(k=pair, nu=0.0).apply_contact(rod, rod)
        push = float(rod.external_forces[2, self.elements // 2 :].sum())
        return Rest(rod.position_collection[:, -1].copy(), push, float(energy))
