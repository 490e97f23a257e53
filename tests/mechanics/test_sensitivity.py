"""Derivatives of equilibria: against differences of solved ones, under transformations, and at a snap."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import simpson

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics import (
    Circular,
    Gauss,
    Gravity,
    Link,
    NodalQuadratic,
    PressureLine,
    Revolute,
    Robot,
    Rod,
    SphereContact,
    State,
    differentiable,
    drive,
    walk,
)
from exosight.mechanics.contact import Spheres

LOADS = np.arange(0.0, 1.05, 0.1)[:, None]
POINTS = Gauss(3, 3)


@pytest.fixture(scope="module")
def pressed() -> Robot:
    """A rod that its pressure line bends onto a sprung link below it."""
    radius = np.full(POINTS.size, 0.006)
    rod = Rod(
        "rod",
        0.1,
        Circular(radius),
        young=3e5,
        strains={"bend_y": NodalQuadratic(3), "stretch_x": NodalQuadratic(3)},
        quadrature=POINTS,
        mount=lie.translation(jnp.array([0.0, 0.0, 0.016])),
    )
    sites = jnp.array([[0.03, 0.0, 0.0], [0.06, 0.0, 0.0]])
    link = Link("link", 0.08, sites, joint=Revolute(stiffness=0.03))
    line = PressureLine("rod", 0, jnp.asarray(radius[:, None] * [0, 0, 1.0]), jnp.zeros((POINTS.size, 3)))
    contact = SphereContact(
        Spheres(tuple(("rod", i) for i in range(POINTS.size)), jnp.asarray(radius)),
        Spheres((("link", 0), ("link", 1)), jnp.array([0.01, 0.01])),
        jnp.array(1000.0),
    )
    return Robot((rod, link), (line, contact))


@eqx.filter_jit
def net_force(robot: Robot, q: AnyArray) -> jax.Array:
    contact = robot.terms[1]
    assert isinstance(contact, SphereContact)
    _, force = contact.forces(robot, walk(robot, jnp.asarray(q)).position)
    return jnp.sum(jnp.sqrt(jnp.sum(force**2, axis=-1) + 1e-20))


@pytest.fixture(scope="module")
def solved(pressed: Robot) -> np.ndarray:
    found = drive([pressed], LOADS)
    assert found.converged.all()
    assert not found.snapped.any()
    assert float(net_force(pressed, found.q[0, -1])) > 0.05  # in contact, or the test would show little
    return np.asarray(found.q[0])


LEAVES: dict[str, Callable[[Robot], jax.Array]] = {
    "young": lambda robot: robot.bodies[0].young,
    "length": lambda robot: robot.bodies[0].length,
    "spring": lambda robot: robot.bodies[1].joint.stiffness,
    "contact stiffness": lambda robot: robot.terms[1].stiffness,
    "radius": lambda robot: robot.bodies[0].section.radius,
    "mount": lambda robot: robot.bodies[0].mount,
}


@pytest.fixture(scope="module")
def gradient(pressed: Robot, solved: np.ndarray) -> tuple[jax.Array, Robot]:
    """∂F/∂u and ∂F/∂(every number of the robot) at the last load, in one reverse pass."""

    def force(loads: jax.Array, robot: Robot) -> jax.Array:
        return net_force(robot, differentiable(robot, loads, solved[-1]))

    return eqx.filter_jit(jax.grad(force, argnums=(0, 1)))(jnp.asarray(LOADS[-1]), pressed)


def resolved(robot: Robot, q: np.ndarray, load: float) -> float:
    """The force after solving again from nearby."""
    found = drive([robot], np.array([[load]]), state=State(q[None], np.array([[load]])))
    assert found.converged.all()
    return float(net_force(robot, found.q[0, 0]))


# A difference of two solved forces over ±1e-5 of the number itself: the residual of 1e-10 leaves about 1e-5
# of the derivative, the square of the step less.
NEAR = 1e-4


def test_by_load(pressed: Robot, solved: np.ndarray, gradient: tuple) -> None:
    step = 1e-5
    ahead, behind = (resolved(pressed, solved[-1], LOADS[-1, 0] + s) for s in (step, -step))
    assert float(gradient[0][0]) == pytest.approx((ahead - behind) / (2 * step), rel=NEAR)
    assert abs(float(gradient[0][0])) > 1e-2


@pytest.mark.parametrize("name", LEAVES)
def test_by_material_and_shape(pressed: Robot, solved: np.ndarray, gradient: tuple, name: str) -> None:
    """Along one direction in each group of numbers: all of them scaled alike (the mount: raised)."""
    leaf = np.asarray(LEAVES[name](pressed), dtype=float)
    direction = np.zeros((4, 4)) if name == "mount" else leaf
    if name == "mount":
        direction[2, 3] = 0.01
    forces = []
    for sign in (1, -1):
        changed = eqx.tree_at(LEAVES[name], pressed, jnp.asarray(leaf + sign * 1e-5 * direction))
        forces.append(resolved(changed, solved[-1], LOADS[-1, 0]))
    expected = (forces[0] - forces[1]) / 2e-5
    assert abs(expected) > 1e-5  # the force does depend on it
    found = float(np.sum(np.asarray(LEAVES[name](gradient[1])) * direction))
    assert found == pytest.approx(expected, rel=NEAR, abs=1e-6)


compiled = eqx.filter_jit(differentiable)


def test_the_value_is_the_pose_itself(pressed: Robot, solved: np.ndarray) -> None:
    q = compiled(pressed, jnp.asarray(LOADS[-1]), solved[-1])
    np.testing.assert_array_equal(q, solved[-1])


def test_a_whole_path_at_once(pressed: Robot, solved: np.ndarray) -> None:
    """Under vmap, dq/du at every load; integrated along the path it gives the change of q back."""
    fine = np.linspace(0.5, 0.6, 9)[:, None]
    found = drive([pressed], fine, state=State(solved[5][None], LOADS[5:6]))
    assert found.converged.all()
    slope = jax.jacfwd(lambda loads, q: differentiable(pressed, loads, q))
    slopes = np.asarray(eqx.filter_jit(jax.vmap(slope))(jnp.asarray(fine), found.q[0]))[..., 0]
    # Simpson's rule: no contact opens or closes between these loads, so its error is far below this.
    change = simpson(slopes, x=fine[:, 0], axis=0)
    np.testing.assert_allclose(change, found.q[0, -1] - found.q[0, 0], rtol=1e-5, atol=1e-7)


def test_a_pose_that_is_no_equilibrium_has_no_derivative(pressed: Robot, solved: np.ndarray) -> None:
    with pytest.raises(RuntimeError, match="no equilibrium of this robot"):
        compiled(pressed, jnp.asarray(LOADS[-1]), solved[-1] + 0.01)


def test_a_pose_that_snaps_has_no_derivative() -> None:
    """An inverted pendulum whose spring just no longer holds it: upright is an equilibrium, but unstable."""
    for spring, stable in ((0.2, True), (0.0981, False), (0.05, False)):
        arm = Link(
            "arm",
            0.1,
            jnp.array([[0.1, 0.0, 0.0]]),
            joint=Revolute(stiffness=spring),
            mass=jnp.array([0.1]),
            mount=lie.exp(jnp.array([0.0, -np.pi / 2, 0.0, 0.0, 0.0, 0.0])),
        )
        robot = Robot((arm,), (Gravity(jnp.array([0.0, 0.0, -9.81])),))
        if stable:
            assert float(differentiable(robot, jnp.zeros(1), np.zeros(1))[0]) == 0
        else:
            with pytest.raises(RuntimeError, match="snaps or is unstable"):
                differentiable(robot, jnp.zeros(1), np.zeros(1))
