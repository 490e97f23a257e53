"""Rods in contact, by exosight and by PyElastica: a belt on a drum with friction, and a rod against itself.

`python -m benchmarks.belt`, with the extra `compare` installed, writes docs/results/belt.json, which
docs/validation.md shows. Times as in `benchmarks.neighbours`; `benchmarks.strands` and `benchmarks.twist` are
rods against themselves.

The belt lies a quarter turn around a fixed drum, bent to it without stress, with straight ends. Where all of
it slips, the tensions at the ends of the arc are T₁/T₀ = e^{μθ} if friction acts on the axis of the belt, and
e^{μθ R/(R + r)} if it acts on the drum's surface, as the force's lever to the drum's centre is R then.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import elastica
import jax.numpy as jnp
import numpy as np

from benchmarks.neighbours import RESULTS, Case, write
from benchmarks.rest import Simulator
from benchmarks.strands import strands
from benchmarks.twist import twists
from exosight import lie
from exosight.mechanics import (
    Circular,
    DeadForce,
    Gauss,
    Link,
    NodalQuadratic,
    Robot,
    Rod,
    drive,
)
from exosight.mechanics.friction import friction
from exosight.mechanics.kinematics import walk
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surfaces import Solids, Tube
from exosight.mechanics.tree import Tree

MU, ANGLE = 0.3, np.pi / 2
DRUM, RADIUS, LEAD = 0.02, 5e-4, 0.01
"""Radii of drum and belt, and length of each straight end [m]."""
YOUNG, DENSITY, PULL = 1e7, 5000.0, 0.05
"""[Pa], [kg/m³]; the smaller tension, roughly [N]. Only the slow motion of PyElastica knows the density."""
ARC = ANGLE * (DRUM + RADIUS)
LENGTH = ARC + 2 * LEAD

SPEED = 5e-3
"""Of the pulled end in PyElastica [m/s]."""
RAMP, UNTIL = 0.05, 0.1
"""Weight and speed have risen by then; the tensions are read then [s]. Twice as late they are the same to
0.03 %."""
BRAKE, DRAG = 250.0, 20.0
"""PyElastica's `velocity_damping_coefficient` over an element's length, several times what reaches μ N at
SPEED [N s/m²]; damping of all motion [1/s]."""


@dataclass(frozen=True)
class Exosight:
    """Clamped at one end, pulled at the other, at rest: the belt stretches and slips all along the drum."""

    elements: int
    stiffness: float

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
        contact = SolidContact(Tube("belt", np.full(points.size, RADIUS)), solids, np.array(self.stiffness))
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


class _Pulled(elastica.ConstraintBase):
    """The last node moves downwards, at a speed that rises over RAMP."""

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
    """A weight at one end, the other one pulled slowly: in PyElastica only what moves is held by friction.

    stiffness   of contact, a length and a depth [N/m²]
    """

    elements: int
    stiffness: float
    speed: float = SPEED

    exact = float(np.exp(MU * ANGLE))

    def __call__(self) -> float:
        """T₁/T₀."""
        size = LENGTH / self.elements
        place = _axis(size * np.arange(self.elements + 1))
        tangent = np.diff(place, axis=1)
        tangent /= np.linalg.norm(tangent, axis=0)
        side = np.tile([[0.0], [1.0], [0.0]], (1, self.elements))
        rod = elastica.CosseratRod.straight_rod(
            self.elements, place[:, 0], tangent[:, 0], side[:, 0], LENGTH, RADIUS, DENSITY,
            youngs_modulus=YOUNG, shear_modulus=28 / 27 * YOUNG / 3, position=place,
            directors=np.stack([np.cross(side, tangent, axis=0), side, tangent]),
        )  # fmt: skip
        rod.rest_kappa[:] = rod.kappa
        drum = elastica.Cylinder(
            np.array([0.0, -0.05, 0.0]), np.array([0.0, 1, 0]), np.array([0.0, 0, 1]), 0.1, DRUM, DENSITY
        )
        step = 0.2 * size / np.sqrt(YOUNG / DENSITY)
        simulator = Simulator()
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
            k=self.stiffness * size,
            nu=0.0,
            velocity_damping_coefficient=BRAKE * size,
            friction_coefficient=MU,
        )
        simulator.finalize()
        stepper, now = elastica.PositionVerlet(), np.float64(0.0)
        while now < UNTIL:
            now = stepper.step(simulator, now, step)
        tension = rod.shear_matrix[2, 2] * (rod.sigma[2] - rod.rest_sigma[2]) / rod.dilatation
        return float(tension[-3] / tension[2])


def _axis(s: np.ndarray) -> np.ndarray:
    """Places (3, points) of the belt's axis at arc lengths."""
    turn = np.clip((s - LEAD) / (DRUM + RADIUS), 0.0, ANGLE)
    before, after = np.minimum(s - LEAD, 0.0), np.maximum(s - LEAD - ARC, 0.0)
    x = before + (DRUM + RADIUS) * np.sin(turn) + after * np.cos(ANGLE)
    z = (DRUM + RADIUS) * np.cos(turn) - after * np.sin(ANGLE)
    return np.stack([x, np.zeros_like(x), z])


def belts() -> list[Case]:
    """Ratio of the tensions against that of the program's own belt, relative."""

    def off(exact: float) -> Callable[[float], float]:
        return lambda found: abs(found / exact - 1)

    ours = [Exosight(n, k) for n, k in ((10, 1e6), (20, 1e6), (10, 1e5))]
    theirs = [PyElastica(n, k) for n, k in ((52, 1e6), (104, 1e6), (52, 1e5))]
    slow = PyElastica(52, 1e5, SPEED / 10)
    return [
        *(Case("belt", "exosight", _setting(w), w, off(w.exact)) for w in ours),
        *(Case("belt", "PyElastica", _setting(w), w, off(w.exact)) for w in theirs),
        Case("belt", "PyElastica", f"{_setting(slow)}, 0.5 mm/s", slow, off(slow.exact)),
    ]


def _setting(work: Exosight | PyElastica) -> str:
    return f"{work.elements} elements, {work.stiffness:.0e} N/m²"


def main() -> None:
    """Measure anew and write the numbers of docs/validation.md."""
    packages = ("exosight", "pyelastica", "jax", "numba", "numpy")
    write(RESULTS.with_name("belt.json"), [*belts(), *strands(), *twists()], packages)


if __name__ == "__main__":
    main()
