"""The cantilever of `planar` at rest, free and on the sphere: by exosight, and by PyElastica at its best.

PyElastica finds rest as its own examples do, by letting damped motion die away. Everything that is free to
choose is chosen in its favour: a damper near critical, the longest steps that are stable, an end as soon as
no node moves faster than 1e-5 m/s. Half of its first element stands in the wall, because its clamp holds a
whole element; its shear factor of 27/28 is divided out; the sphere is below the middle of an element.
"""

from dataclasses import dataclass

import elastica
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.planar import (
    AREA,
    CENTRE,
    DENSITY,
    EI,
    LENGTH,
    PRESS,
    PROP,
    RADIUS,
    SPHERE,
    SPRING,
    TIP_FORCE,
    YOUNG,
    Rest,
)
from exosight import lie
from exosight.mechanics import (
    Circular,
    DeadForce,
    Equilibria,
    Gauss,
    Link,
    NodalQuadratic,
    Robot,
    Rod,
    SphereContact,
    drive,
    walk,
)
from exosight.mechanics.contact import Spheres

UP = np.array([0.0, 0.0, 1.0])

RATE = 1.8751**2 * np.sqrt(EI / (DENSITY * AREA * LENGTH**4))
"""Angular frequency of the free cantilever's first mode [1/s]."""
STILL = 1e-5
"""Below this speed of every node PyElastica's rod counts as at rest [m/s]: some 2 µm before it."""
RAMP = 0.1
"""Its load is raised over this time [s]."""

_walk = jax.jit(walk)


@dataclass(frozen=True)
class Exosight:
    """Our cantilever: bending, stretch and shear on so many nodal quadratic elements, 3 Gauss points each."""

    elements: int
    sphere: bool

    def __call__(self) -> Rest:
        """Build, solve and read the tip and the sphere's load."""
        points = Gauss(self.elements, 3, element_ends=True)
        strains = dict.fromkeys(("bend_y", "stretch_x", "shear_z"), NodalQuadratic(self.elements))
        section = Circular(np.full(points.size, RADIUS))
        rod = Rod("rod", LENGTH, section, young=YOUNG, strains=strains, quadrature=points)
        if not self.sphere:
            robot = Robot((rod,), (DeadForce("rod", -1, 0, jnp.asarray(UP)),))
            found = drive([robot], np.array([[TIP_FORCE]]))
            return Rest(_converged_tip(robot, found), 0.0)
        at = int(np.argmin(np.abs(points.points - PROP / LENGTH)))
        mount = lie.translation(jnp.array([CENTRE[0], 0.0, CENTRE[1]]))
        contact = SphereContact(
            Spheres((("rod", at),), jnp.array([RADIUS])),
            Spheres((("sphere", 0),), jnp.array([SPHERE])),
            jnp.array(SPRING),
        )
        sphere = Link("sphere", 0.0, jnp.zeros((1, 3)), mount=mount)
        robot = Robot((rod, sphere), (DeadForce("rod", -1, 0, jnp.asarray(-UP)), contact))
        found = drive([robot], np.array([[PRESS]]))
        positions = _walk(robot, found.q[0, 0]).position
        push = float(jnp.linalg.norm(contact.forces(robot, positions)[1][0]))
        return Rest(_converged_tip(robot, found), push)


def _converged_tip(robot: Robot, found: Equilibria) -> np.ndarray:
    if not found.converged.all():
        raise RuntimeError("exosight did not converge")
    return np.asarray(_walk(robot, found.q[0, 0]).position[robot.frame("rod", -1), ::2])


class Simulator(
    elastica.BaseSystemCollection,
    elastica.Constraints,
    elastica.Forcing,
    elastica.Damping,
    elastica.Contact,
):
    """PyElastica's way to say what a simulation may contain."""


@dataclass(frozen=True)
class PyElastica:
    """Its cantilever on so many elements, half of the first in the wall."""

    elements: int
    sphere: bool

    @property
    def step(self) -> float:
        """Time step [s]: 0.02 s/m times the element's length, at most 0.4 ms; a quarter more is unstable."""
        return min(0.02 * LENGTH / (self.elements - 0.5), 4e-4)

    def __call__(self) -> Rest:
        """Build, let motion die away, read the tip and the sphere's load."""
        length = LENGTH / (self.elements - 0.5)
        rod = elastica.CosseratRod.straight_rod(
            self.elements,
            np.array([-length / 2, 0.0, 0.0]),
            np.array([1.0, 0.0, 0.0]),
            UP,
            self.elements * length,
            RADIUS,
            DENSITY,
            youngs_modulus=YOUNG,
            shear_modulus=28 / 27 * YOUNG / 3,
        )
        sphere = elastica.Sphere(np.array([CENTRE[0], 0.0, CENTRE[1]]), SPHERE, DENSITY)
        simulator, held = Simulator(), [rod, sphere] if self.sphere else [rod]
        for system in held:
            simulator.append(system)
        for system in held:
            simulator.constrain(system).using(
                elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
            )
        force = (-PRESS if self.sphere else TIP_FORCE) * UP
        simulator.add_forcing_to(rod).using(elastica.EndpointForces, np.zeros(3), force, ramp_up_time=RAMP)
        # Critical for the free rod's lowest mode; the one on the sphere is stiffer and rests soonest with 4.
        damping = (4 if self.sphere else 2) * RATE
        simulator.dampen(rod).using(
            elastica.AnalyticalLinearDamper, uniform_damping_constant=damping, time_step=self.step
        )
        contact = elastica.RodSphereContact(k=SPRING, nu=0.0)
        if self.sphere:
            simulator.detect_contact_between(rod, sphere).using(elastica.RodSphereContact, k=SPRING, nu=0.0)
        simulator.finalize()
        _settle(simulator, rod, self.step)
        if not self.sphere:
            return Rest(rod.position_collection[::2, -1].copy(), 0.0)
        sphere.external_forces[:] = 0.0
        contact.apply_contact(rod, sphere)
        push = float(np.linalg.norm(sphere.external_forces))
        return Rest(rod.position_collection[::2, -1].copy(), push)


def _settle(simulator: Simulator, rod: elastica.CosseratRod, step: float, longest: float = 10.0) -> None:
    """Steps until nothing moves, looked at every 0.05 s."""
    stepper, now, look = elastica.PositionVerlet(), np.float64(0.0), RAMP
    while now < longest:
        now = stepper.step(simulator, now, step)
        if now >= look:
            look += 0.05
            speed = np.abs(rod.velocity_collection).max()
            if not np.isfinite(speed):
                break
            if speed < STILL:
                return
    raise RuntimeError(f"PyElastica's rod did not come to rest within {longest} s")
