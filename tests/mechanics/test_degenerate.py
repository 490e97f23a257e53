"""Poses and robots at the edge of what the formulas allow: finite, exact, or said to be without an answer."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.mechanics import (
    Circular,
    DeadForce,
    Gauss,
    Gravity,
    Legendre,
    Link,
    Revolute,
    Robot,
    Rod,
    drive,
    walk,
)
from exosight.mechanics.contact import SphereContact, Spheres
from exosight.mechanics.rod import STRAINS

STEP = 1e-6
# Central differences over 1e-6: round-off of 1e-16 of some joules, and the square of the step.
CLOSE = 1e-8


def check_derivatives(
    evaluate: Callable, robot: Robot, q: np.ndarray, loads: np.ndarray, curvature: float = 1e-7
) -> None:
    """Gradient and Hessian are finite and match differences, the latter to `curvature` of its largest."""
    here = evaluate(robot, q, loads)[0]
    assert np.isfinite(here.gradient).all()
    assert np.isfinite(here.hessian).all()
    for i, unit in enumerate(np.eye(robot.dofs)):
        ahead, behind = (evaluate(robot, q + s * STEP * unit, loads)[0] for s in (1, -1))
        slope = (ahead.energy - behind.energy) / (2 * STEP)
        assert float(here.gradient[i]) == pytest.approx(float(slope), rel=CLOSE, abs=CLOSE)
        rates = (np.asarray(ahead.gradient) - np.asarray(behind.gradient)) / (2 * STEP)
        largest = np.abs(here.hessian).max()
        np.testing.assert_allclose(here.hessian[:, i], rates, rtol=1e-6, atol=curvature * largest + 1e-8)


@pytest.mark.parametrize("q", [0.0, 1e-9, 1e-4])
def test_zero_strain_and_zero_load(tree: Robot, evaluate: Callable, q: float) -> None:
    check_derivatives(evaluate, tree, np.full(tree.dofs, q), np.zeros(2))


# The Hessian leaves out θ⁵/7! of the wrench, θ being the rotation between neighbouring points: at 0.8 rad
# 1e-5 of it, at 2 rad some percent, of which the elastic part of the Hessian has no share.
@pytest.mark.parametrize(("turns", "curvature"), [(1.0, 1e-7), (2.5, 1e-3)])
def test_rods_wound_up_beyond_a_full_turn(evaluate: Callable, turns: float, curvature: float) -> None:
    """A rod bent and twisted through several turns, at most a third of one between neighbouring points."""
    points = Gauss(4, 4)
    rod = Rod(
        "rod",
        0.1,
        Circular(np.full(points.size, 0.004)),
        young=3e5,
        density=1000.0,
        strains=dict.fromkeys(STRAINS, Legendre(1)),
        quadrature=points,
    )
    robot = Robot((rod,), (Gravity(jnp.array([1.0, 2.0, -9.81])), DeadForce("rod", -1, 0, jnp.ones(3))))
    q = np.random.default_rng(0).normal(size=rod.dofs) * 0.1
    q[0] += np.pi * turns  # twist
    q[2] += 2 * np.pi * turns  # bending
    check_derivatives(evaluate, robot, q, np.array([0.2]), curvature)


def test_a_hinge_turned_beyond_a_full_turn(chain: Robot, evaluate: Callable) -> None:
    check_derivatives(evaluate, chain, np.array([7.0, -13.0, 20.0]), np.zeros(0))


def touching(gap: float) -> Robot:
    """An arm whose sphere stands `gap` [m] above a post's: at rest at q = 0 without any load."""
    arm = Link("arm", 0.05, jnp.array([[0.05, 0.0, 0.0]]), joint=Revolute(stiffness=0.01))
    post = Link("post", 0.0, jnp.array([[0.05, 0.0, -0.02 - gap]]))
    spheres = [Spheres(((name, 0),), jnp.array([0.01])) for name in ("arm", "post")]
    return Robot(
        (arm, post), (SphereContact(*spheres, jnp.array(1000.0)), DeadForce("arm", 0, 0, -jnp.eye(3)[2]))
    )


@pytest.mark.parametrize("gap", [0.0, 1e-15, -1e-15, 1e-9])
def test_touching_without_pressing(evaluate: Callable, gap: float) -> None:
    """Where a contact is about to be made the second derivative jumps, and nothing worse happens."""
    robot = touching(gap)
    here = evaluate(robot, np.zeros(1), np.zeros(1))[0]
    assert abs(float(here.energy)) < 1e-20
    assert abs(float(here.gradient[0])) < 1e-12
    assert 0.0099 < float(here.hessian[0, 0]) < 0.01 + 1000 * 0.05**2 + 1e-6
    found = drive([robot], np.array([[0.0], [0.1]]))
    assert found.converged.all()
    # Pressed by 0.1 N, spring and contact share the load: 0.05 · 0.1 N m over k + K l², up to the change of
    # the lever with the angle, which is its square.
    angle = 0.05 * 0.1 / (0.01 + 1000 * 0.05**2)
    assert found.q[0, 1, 0] == pytest.approx(angle, rel=0.01)


def test_a_free_hinge_hangs_down() -> None:
    """No spring at all: the weight alone decides, and the residual is measured in newton metres."""
    arm = Link("arm", 0.1, jnp.array([[0.1, 0.0, 0.0]]), joint=Revolute(), mass=jnp.array([0.1]))
    robot = Robot((arm,), (Gravity(jnp.array([0.0, 0.0, -9.81])),))
    found = drive([robot], np.zeros((1, 1)))
    assert found.converged.all()
    assert found.q[0, 0, 0] == pytest.approx(np.pi / 2, abs=1e-8)


def test_where_nothing_holds_a_joint_there_is_no_stable_pose() -> None:
    """A hinge without spring, weight or load is in equilibrium everywhere: that is said, without a NaN."""
    arm = Link("arm", 0.1, jnp.array([[0.1, 0.0, 0.0]]), joint=Revolute())
    held = Link("held", 0.1, jnp.array([[0.1, 0.0, 0.0]]), joint=Revolute(stiffness=0.1))
    found = drive([Robot((held, arm))], np.zeros((2, 1)))
    assert not found.converged.any()
    assert np.isfinite(found.q).all()
    assert np.all(np.abs(found.min_eigenvalue) < 1e-6)


def test_a_direction_nearly_without_stiffness() -> None:
    """A rod a million times softer in shear than in bending still finds its equilibrium."""
    points = Gauss(2, 4)
    thin = Rod(
        "rod",
        0.1,
        Circular(np.full(points.size, 1e-4)),  # EI/L² is 1e-6 of GA
        young=3e5,
        strains={"bend_y": Legendre(2), "shear_z": Legendre(1)},
        quadrature=points,
    )
    force = 0.1 * 3e5 * np.pi * 1e-4**4 / 4 / 0.1**2
    robot = Robot((thin,), (DeadForce("rod", -1, 0, jnp.array([0.0, 0.0, force])),))
    found = drive([robot], np.array([[0.0], [1.0]]))
    assert found.converged.all()
    # Euler–Bernoulli, F L³ / 3EI, off by the square of the slope (5 %).
    tip = 0.1 * 0.1 / 3
    height = eqx.filter_jit(walk)(robot, jnp.asarray(found.q[0, 1])).position[-1, 2]
    assert float(height) == pytest.approx(tip, rel=0.01)
