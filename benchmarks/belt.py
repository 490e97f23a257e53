"""A belt on a drum with Coulomb friction, in exosight and PyElastica: the ratio of tensions where it slips.

The belt lies a quarter turn around a fixed drum, bent to it without stress, with straight ends. Where all of it
slips, the tensions at the ends of the arc are T₁/T₀ = e^{μθ} if friction acts on the axis of the belt, and
e^{μθ R/(R + r)} if it acts on the drum's surface, as the force's lever to the drum's centre is R then.
"""

from dataclasses import dataclass
from typing import Any

import elastica
import jax.numpy as jnp
import numpy as np

from exosight import lie
from exosight.mechanics import Circular, DeadForce, Gauss, Link, NodalQuadratic, Robot, Rod, drive
from exosight.mechanics.friction import friction
from exosight.mechanics.kinematics import walk
from exosight.mechanics.surface_contact import SolidContact, Solids, Tube
from exosight.mechanics.tree import Tree

MU, ANGLE = 0.3, np.pi / 2
DRUM, RADIUS, LEAD = 0.02, 5e-4, 0.01
"""Radii of drum and belt, and length of each straight end [m]."""
YOUNG, DENSITY, PULL = 1e7, 5000.0, 0.05
"""[Pa], [kg/m³]; the smaller tension, roughly [N]. Only the slow motion of PyElastica knows the density."""
STIFFNESS = 1e6
"""Of contact: force a length and a depth [N/m²]."""
ARC = ANGLE * (DRUM + RADIUS)
LENGTH = ARC + 2 * LEAD

SPEED = 5e-3
"""Of the pulled end in PyElastica [m/s]."""
RAMP, UNTIL = 0.05, 0.2
"""Weight and speed have risen by then; the tensions are read then [s]."""
BRAKE, DRAG = 0.25, 20.0
"""PyElastica's `velocity_damping_coefficient` [N s/m], and damping of all motion [1/s]."""


@dataclass(frozen=True)
class Exosight:
    """Clamped at one end and pulled at the other, at rest: the belt stretches, and slips all along the drum."""

    elements: int

    exact = float(np.exp(MU * ANGLE * DRUM / (DRUM + RADIUS)))

    def robot(self) -> Robot:
        """The belt from the clamp over the drum, whose centre is the origin."""
        points = Gauss(self.elements, 4)

        def natural(x: np.ndarray) -> np.ndarray:
            s, strain = x * LENGTH, np.zeros((len(x), 6))
            strain[:, 1] = np.where((s > LEAD) & (s < LEAD + ARC), 1 / (DRUM + RADIUS), 0.0)
            strain[:, 3] = 1.0
            return strain

        belt = Rod(
            "belt", LENGTH, Circular(np.full(points.size, RADIUS)), young=YOUNG, poisson=0.5,
            strains={"bend_y": NodalQuadratic(self.elements), "stretch_x": NodalQuadratic(self.elements)},
            quadrature=points, natural=natural,
            mount=lie.translation(jnp.array([-LEAD, 0.0, DRUM + RADIUS])),
        )  # fmt: skip
        across = np.array([[0.0, -1, 0, 0], [1, 0, 0, -0.05], [0, 0, 1, 0], [0, 0, 0, 1]])
        drum = Link("drum", 0.1, np.zeros((1, 3)), mount=jnp.asarray(across))
        solids = Solids((("drum", 0),), np.array([0.1]), np.array([[DRUM, DRUM]]))
        contact = SolidContact(Tube("belt", np.full(points.size, RADIUS)), solids, np.array(STIFFNESS))
        pull = DeadForce("belt", -1, 0, jnp.array([0.0, 0.0, -1.0]))
        bodies = (drum, belt)
        return Robot(bodies, (pull, contact, friction(contact, MU, Tree(bodies))))

    def __call__(self) -> float:
        """T₁/T₀."""
        robot = self.robot()
        found = drive([robot], np.array([[PULL * self.exact]]))
        if not found.converged.all():
            raise RuntimeError("exosight did not converge")
        stretch = np.asarray(walk(robot, jnp.asarray(found.q[0, 0])).strain["belt"])[:, 3] - 1
        return float(stretch[-2] / stretch[1])


class _Simulator(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping, elastica.Contact
):
    """PyElastica's way to say what a simulation may contain."""


class _Pulled(elastica.ConstraintBase):
    """The last node moves downwards, at a speed that rises to SPEED."""

    def __init__(self, speed: float, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.speed = speed

    def constrain_values(self, system: Any, time: np.float64) -> None:
        """Its place follows from its speed."""

    def constrain_rates(self, system: Any, time: np.float64) -> None:
        """Along −z."""
        system.velocity_collection[:, -1] = 0.0
        system.velocity_collection[2, -1] = -self.speed * min(1.0, time / RAMP)


@dataclass(frozen=True)
class PyElastica:
    """A weight at one end, the other one pulled slowly: in PyElastica only what moves is held by friction."""

    elements: int
    speed: float = SPEED
    until: float = UNTIL

    exact = float(np.exp(MU * ANGLE))

    def __call__(self) -> float:
        """T₁/T₀."""
        nodes = np.linspace(0.0, LENGTH, self.elements + 1)
        middle = nodes[:-1] + LENGTH / self.elements / 2
        place, turn = self._axis(nodes)[0], self._axis(middle)[1]
        tangent = np.diff(place, axis=1)
        tangent /= np.linalg.norm(tangent, axis=0)
        side = np.tile([[0.0], [1.0], [0.0]], (1, self.elements))
        directors = np.stack([np.cross(side, tangent, axis=0), side, tangent])
        rod = elastica.CosseratRod.straight_rod(
            self.elements, place[:, 0], tangent[:, 0], np.array([0.0, 1.0, 0.0]), LENGTH, RADIUS, DENSITY,
            youngs_modulus=YOUNG, shear_modulus=28 / 27 * YOUNG / 3, position=place, directors=directors,
        )  # fmt: skip
        del turn
        rod.rest_kappa[:] = rod.kappa
        drum = elastica.Cylinder(
            np.array([0.0, -0.05, 0.0]), np.array([0.0, 1, 0]), np.array([0.0, 0, 1]), 0.1, DRUM, DENSITY
        )
        step = 0.2 * LENGTH / self.elements / np.sqrt(YOUNG / DENSITY)
        simulator = _Simulator()
        for system in (rod, drum):
            simulator.append(system)
        simulator.constrain(drum).using(
            elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        simulator.constrain(rod).using(_Pulled, speed=self.speed)
        weight = np.array([-PULL, 0.0, 0.0])
        simulator.add_forcing_to(rod).using(elastica.EndpointForces, weight, np.zeros(3), ramp_up_time=RAMP)
        simulator.dampen(rod).using(
            elastica.AnalyticalLinearDamper, uniform_damping_constant=DRAG, time_step=step
        )
        simulator.detect_contact_between(rod, drum).using(
            elastica.RodCylinderContact,
            k=STIFFNESS * LENGTH / self.elements,
            nu=0.0,
            velocity_damping_coefficient=BRAKE * LENGTH / self.elements / 1e-3,
            friction_coefficient=MU,
        )
        simulator.finalize()
        stepper, now = elastica.PositionVerlet(), np.float64(0.0)
        while now < self.until:
            now = stepper.step(simulator, now, step)
        tension = rod.shear_matrix[2, 2] * (rod.sigma[2] - rod.rest_sigma[2]) / rod.dilatation
        return float(tension[-3] / tension[2])

    @staticmethod
    def _axis(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (3, points) of the belt's axis at arc lengths, and how far it has turned there [rad]."""
        turn = np.clip((s - LEAD) / (DRUM + RADIUS), 0.0, ANGLE)
        before, after = np.minimum(s - LEAD, 0.0), np.maximum(s - LEAD - ARC, 0.0)
        x = before + (DRUM + RADIUS) * np.sin(turn) + after * np.cos(ANGLE)
        z = (DRUM + RADIUS) * np.cos(turn) - after * np.sin(ANGLE)
        return np.stack([x, np.zeros_like(x), z]), turn
