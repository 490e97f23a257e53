"""Motions in contact with damping and friction, against closed forms; the balance of energy.

One structure of a robot, compiled once: a capsule over a plane, on slides along x and z and free to roll
about its own axis, which is x for a block and y for a roller.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from exosight import lie
from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    Gauss,
    Gravity,
    Legendre,
    Link,
    MotionOptions,
    Prismatic,
    Revolute,
    Robot,
    Rod,
    Trajectories,
    evolve,
)
from exosight.mechanics.contact_damping import ContactDamping
from exosight.mechanics.friction import SHEAR, friction
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surfaces import Plane, Solids, Tube
from exosight.mechanics.tree import Tree

G, MASS, RADIUS, LENGTH = 9.81, 0.1, 0.005, 0.03
MU, STIFFNESS = 0.3, 2e4
TIME = np.linspace(0.0, 0.2, 21)
BLOCK, ROLLER = np.zeros(3), np.array([0.0, 0.0, np.pi / 2])
"""Rotation of the capsule's axis."""


def capsule(
    axis: np.ndarray = BLOCK, slope: float = 0.0, gravity: float = G, damping: float = 0.0, mu: float = MU
) -> Robot:
    """It has a ball's moment of inertia; the slope falls along x."""
    x, z = Prismatic((1.0, 0.0, 0.0)), Prismatic((0.0, 0.0, 1.0))
    middle = np.array([[0.0, 0.0, 0.0], [LENGTH / 2, 0.0, 0.0]])
    turned = lie.exp(jnp.concatenate([axis, np.zeros(3)])) @ lie.translation(jnp.array([-LENGTH / 2, 0, 0]))
    above = lie.translation(jnp.array([0.0, 0.0, RADIUS]))
    bodies = (
        Link("slider", 0.0, np.zeros((1, 3)), joint=x),
        Link("lift", 0.0, np.zeros((1, 3)), parent="slider", joint=z, mount=above),
        Link(
            "capsule",
            LENGTH,
            middle,
            parent="lift",
            joint=Revolute((1.0, 0.0, 0.0)),
            mount=turned,
            mass=np.array([0.0, MASS]),
            inertia=np.array([0.0, 0.4 * MASS * RADIUS**2])[:, None, None] * np.eye(3),
        ),
    )
    solids = Solids((("capsule", 0),), np.array([LENGTH]), np.array([[RADIUS, RADIUS]]))
    contact = RigidContact(solids, Plane(None, np.zeros(3), np.array([0.0, 0.0, 1.0])), np.array(STIFFNESS))
    weight = Gravity(gravity * jnp.array([np.sin(slope), 0.0, -np.cos(slope)]))
    terms = weight, contact, ContactDamping(contact, damping), friction(contact, mu, Tree(bodies))
    return Robot(bodies, terms)


def moved(robots: list[Robot], q: list, velocity: list, tolerance: float = 1e-9) -> Trajectories:
    """The motion of four robots."""
    found = evolve(robots, TIME, q=np.array(q), velocity=np.array(velocity), options=MotionOptions(tolerance))
    assert found.converged.all()
    assert (np.diff(found.dissipated) >= -1e-15).all()
    return found


def test_restitution_is_that_of_hunt_and_crossley() -> None:
    """And what overlaps at first and leaves fast is never pulled: it keeps its speed."""
    damping, speed = np.array([0.0, 0.5, 4.0]), 0.5
    robots = [capsule(gravity=0.0, damping=d, mu=0.0) for d in (*damping, 4.0)]
    start = [[0.0, 1e-3, 0.0]] * 3 + [[0.0, -1e-3, 0.0]]
    found = moved(robots, start, [[0.0, -speed, 0.0]] * 3 + [[0.0, speed, 0.0]], 1e-12)

    def exact(d: float) -> float:
        """d v (1 + e) = log((1 + d v)/(1 − d e v))."""
        x = d * speed
        return brentq(lambda e: x * (1 + e) - np.log1p(x) + np.log1p(-x * e), 1e-3, min(1.0, (1 - 1e-12) / x))

    expected = [1.0, *(exact(d) for d in damping[1:])]
    assert expected[2] < 0.5
    np.testing.assert_allclose(found.velocity[:3, -1, 1] / speed, expected, rtol=1e-5)
    np.testing.assert_allclose(found.velocity[3, :, 1], speed, rtol=1e-9)
    total = (found.kinetic + found.potential + found.dissipated)[:3]
    np.testing.assert_allclose(total, 0.5 * MASS * speed**2, rtol=1e-5)


@pytest.fixture(scope="module")
def sliding() -> Trajectories:
    """A block at rest on two slopes, one that starts sliding on level ground, and a roller that does."""
    slopes = np.arctan(MU * np.array([0.8, 1.5, 0.0, 0.0]))
    robots = [capsule(axis, slope) for axis, slope in zip([BLOCK, BLOCK, BLOCK, ROLLER], slopes, strict=True)]
    pressed = -MASS * G * np.cos(slopes) / (2 * STIFFNESS)
    velocity = np.zeros((4, 3))
    velocity[2:, 0] = 0.3
    return moved(robots, [[0.0, z, 0.0] for z in pressed], velocity.tolist())


GRIP = MU * MASS * G / (2 * SHEAR * STIFFNESS)
"""How far the springs of both ends give before they slip on level ground [m]."""


def test_a_block_sticks_on_a_slope_below_atan_mu(sliding: Trajectories) -> None:
    """It swings on the springs that hold it; once they have swung in, nothing slips and nothing creeps."""
    assert sliding.dissipated[0, -1] == sliding.dissipated[0, 10] > 0
    assert sliding.q[0, 10:, 0].max() < 3 * GRIP


def test_a_block_slides_on_a_slope_above_atan_mu(sliding: Trajectories) -> None:
    slope = np.arctan(1.5 * MU)
    rate = np.diff(sliding.velocity[1, 5:, 0]) / np.diff(TIME[5:])
    np.testing.assert_allclose(rate, G * (np.sin(slope) - MU * np.cos(slope)), rtol=1e-10)


def test_a_sliding_block_stops_where_friction_has_taken_its_energy(sliding: Trajectories) -> None:
    """After v²/2μg; then it swings on the springs, which hold the rest."""
    way = 0.3**2 / (2 * MU * G)
    np.testing.assert_allclose(sliding.q[2, 15:, 0], way, atol=2 * GRIP)
    assert sliding.dissipated[2, -1] == sliding.dissipated[2, 15]
    assert sliding.dissipated[2, -1] == pytest.approx(MASS * 0.3**2 / 2, rel=1e-3)


def test_what_starts_sliding_goes_over_to_rolling(sliding: Trajectories) -> None:
    """5/7 of its speed is left; friction acts half an overlap, 2.5 ‰ of the radius, from the surface."""
    speed = np.diff(sliding.q[3, :, 0])[10:].mean() / np.diff(TIME)[0]
    turning = np.diff(sliding.q[3, :, 2])[10:].mean() / np.diff(TIME)[0]
    assert speed == pytest.approx(5 / 7 * 0.3, rel=3e-3)
    assert turning * RADIUS == pytest.approx(speed, rel=4e-3)


def test_energy_of_sliding_is_kept_or_lost_to_friction(sliding: Trajectories) -> None:
    total = sliding.kinetic + sliding.potential + sliding.dissipated
    # Of 4.5e-3 J; lost sight of where a spring begins to slip, in steps that end up to 1e-9 m beyond.
    np.testing.assert_allclose(total, np.broadcast_to(total[:, :1], total.shape), atol=5e-6)


def test_a_tube_is_damped_along_its_length(motion: Callable) -> None:
    """k (L + r/2) δ d dδ/dt on a plane; the quadrature's end points stand for no length."""
    points, depth, speed, line = Gauss(1, 2), 1e-4, 0.2, 3e5
    radius = np.full(points.size, RADIUS)
    rod = Rod(
        "rod",
        0.1,
        Circular(radius),
        young=3e5,
        strains={"bend_y": Legendre(0)},
        quadrature=points,
        joint=Prismatic((0.0, 0.0, 1.0)),
        mount=lie.translation(jnp.array([0.0, 0.0, RADIUS])),
    )
    plane = Plane(None, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    contact = SolidContact(Tube("rod", radius), plane, np.array(line))
    robot = Robot((rod,), (contact, ContactDamping(contact, 2.0)))
    at = motion(robot, np.array([-depth, 0.0]))
    found = robot.terms[1].resistance(robot, at, jnp.array([-speed, 0.0]))
    expected = -line * (0.1 + RADIUS / 2) * depth * 2.0 * speed
    assert float(found.force[0]) == pytest.approx(expected, rel=1e-12)
    assert float(found.by_velocity[0, 0]) == pytest.approx(-expected / speed, rel=1e-12)


@pytest.mark.parametrize("wrong", [-0.1, np.nan, np.inf])
def test_a_damping_is_a_number_of_at_least_zero(wrong: float) -> None:
    with pytest.raises(InputError, match="contact damping: expected finite, at least 0 s/m"):
        capsule(damping=wrong)
