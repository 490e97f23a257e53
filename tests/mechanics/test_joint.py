"""Every joint: poses against the matrix exponential, derivatives against differences, statics in closed form.

One arm has a link on each kind of joint, one behind the other, so that it is compiled once.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from exosight import lie
from exosight.errors import InputError
from exosight.mechanics import (
    Cylindrical,
    Fixed,
    Free,
    Gravity,
    Helical,
    Joint,
    Link,
    Planar,
    Prismatic,
    Revolute,
    Robot,
    Spherical,
    Universal,
    drive,
)

N = (0.36, 0.48, 0.8)
"""A direction along none of the axes."""
PITCH = 0.03

STOPS = {"limits": (-0.2, 0.3), "limit_stiffness": 2.0}
JOINTS: dict[str, Joint] = {
    "fixed": Fixed(),
    "revolute": Revolute(N, stiffness=0.1, **STOPS),
    "prismatic": Prismatic(N, stiffness=3.0, limits=(-0.01, 0.01), limit_stiffness=20.0),
    "helical": Helical(N, PITCH, stiffness=0.2),
    "cylindrical": Cylindrical(
        N, stiffness=(0.1, 4.0), limits=((-1.0, 1.0), (-0.01, 0.01)), limit_stiffness=3.0
    ),
    "planar": Planar((0.0, 0.6, 0.8), stiffness=(0.3, 5.0, 6.0)),
    "spherical": Spherical(stiffness=(0.1, 0.2, 0.3), **STOPS),
    "universal": Universal((0.0, 0.6, 0.8), N, stiffness=(0.2, 0.1)),
    "free": Free(stiffness=(0.1, 0.2, 0.3, 4.0, 5.0, 6.0)),
}
NORMAL = (0.0, 0.6, 0.8)
# Written out once more: the rows of each exponential's twists, angular first.
TWISTS: dict[str, list[list[tuple[float, ...]]]] = {
    "fixed": [],
    "revolute": [[(*N, 0, 0, 0)]],
    "prismatic": [[(0, 0, 0, *N)]],
    "helical": [[(*N, *(PITCH * np.array(N)))]],
    "cylindrical": [[(*N, 0, 0, 0), (0, 0, 0, *N)]],
    "planar": [[(*NORMAL, 0, 0, 0), (0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 0.8, -0.6)]],
    "spherical": [[(1, 0, 0, 0, 0, 0), (0, 1, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0)]],
    "universal": [[(*NORMAL, 0, 0, 0)], [(*N, 0, 0, 0)]],
    "free": [[tuple(row) for row in np.eye(6)]],
}


@pytest.fixture(scope="module")
def arm() -> Robot:
    """A link of 50 mm on each joint, with 20 and 50 g away from its axis, hanging out of the vertical."""
    sites = jnp.array([[0.0, 0.0, 0.0], [0.02, 0.01, -0.015], [0.05, -0.01, 0.0]])
    links, before = [], None
    for i, (name, joint) in enumerate(JOINTS.items()):
        links.append(
            Link(
                name,
                0.05,
                sites,
                parent=before,
                mount=lie.exp(jnp.array([0.1, -0.2, 0.3, 0.01, 0.0, 0.02]) * (i + 1)),
                joint=joint,
                mass=jnp.array([0.0, 0.02, 0.05]),
            )
        )
        before = name
    return Robot(tuple(links), (Gravity(jnp.array([0.5, 1.0, -9.81])),))


def near() -> np.ndarray:
    return np.random.default_rng(5).normal(size=19) * 0.4


def far() -> np.ndarray:
    """More than one turn where turning has no end; three radians in the ball, four in the free joint."""
    q = {
        "revolute": [8.0],
        "prismatic": [0.05],
        "helical": [-9.0],
        "cylindrical": [14.0, -0.03],
        "planar": [5.0, 0.02, -0.04],
        "spherical": [1.0, -2.0, 2.0],
        "universal": [7.0, -8.5],
        "free": [2.0, -3.0, 2.0, 0.05, -0.1, 0.2],
    }
    return np.concatenate([q.get(name, []) for name in JOINTS])


POSES = pytest.mark.parametrize("pose", [near, far])
# Central differences: round-off of 1e-16 in numbers of order one over a step of 1e-6, and the square of the
# step times third derivatives of up to some ten.
STEP, DIFFERENCE = 1e-6, 2e-9


def matrix(twist: np.ndarray) -> np.ndarray:
    """The 4×4 matrix of a twist."""
    (a, b, c), v = twist[:3], twist[3:]
    return np.array([[0, -c, b, v[0]], [c, 0, -a, v[1]], [-b, a, 0, v[2]], [0, 0, 0, 0]])


@POSES
def test_pose_is_the_exponential_of_the_twists(arm: Robot, evaluate: Callable, pose: Callable) -> None:
    q = pose()
    found = evaluate(arm, q, np.zeros(0))[1]
    g = np.eye(4)
    for name, groups in TWISTS.items():
        g = g @ np.asarray(arm[name].mount)
        at = arm.dof_slice(name).start
        for group in groups:
            twist = np.array(group).T @ q[at : at + len(group)]
            g, at = g @ expm(matrix(twist)), at + len(group)
        assert at == arm.dof_slice(name).stop
        # Nine products of numbers of order one, turned by up to 14 rad.
        np.testing.assert_allclose(found[name].pose[0], g, atol=1e-13, err_msg=name)
        g = g @ np.block([[np.eye(3), np.array([[0.05], [0], [0]])], [np.zeros((1, 3)), 1.0]])


@POSES
def test_derivatives_match_differences(arm: Robot, evaluate: Callable, pose: Callable) -> None:
    """Gradient of the energy, Hessian of the gradient, Jacobian of the poses."""
    q, none = pose(), np.zeros(0)
    here, motion = evaluate(arm, q, none)
    for k, unit in enumerate(STEP * np.eye(arm.dofs)):
        (ahead, there), (behind, back) = (evaluate(arm, q + s * unit, none) for s in (1, -1))
        force = (ahead.energy - behind.energy) / (2 * STEP)
        np.testing.assert_allclose(here.gradient[k], force, atol=DIFFERENCE)
        change = (ahead.gradient - behind.gradient) / (2 * STEP)
        np.testing.assert_allclose(here.hessian[k], change, atol=DIFFERENCE)
        spatial = np.asarray(there.pose - back.pose) / (2 * STEP) @ np.linalg.inv(motion.pose)
        expected = [spatial[:, 2, 1], spatial[:, 0, 2], spatial[:, 1, 0], *spatial[:, :3, 3].T]
        np.testing.assert_allclose(motion.jacobian[:, :, k], np.stack(expected, axis=1), atol=DIFFERENCE)


def test_springs_and_stops_are_each_coordinates_own(arm: Robot, evaluate: Callable) -> None:
    """Without weight Π = ½ Σ k q² + ½ Σ k_limit (what is beyond the range)²."""
    q = far()
    stiffness = [0.1, 3, 0.2, 0.1, 4, 0.3, 5, 6, 0.1, 0.2, 0.3, 0.2, 0.1, 0.1, 0.2, 0.3, 4, 5, 6]
    excess = 2 * 7.7**2 + 20 * 0.04**2 + 3 * (13**2 + 0.02**2) + 2 * (0.7**2 + 1.8**2 + 1.7**2)
    expected = 0.5 * np.array(stiffness) @ q**2 + 0.5 * excess
    here, motion = evaluate(arm, q, np.zeros(0))
    mass = np.concatenate([np.asarray(body.mass) for body in arm.bodies])
    weight = mass @ np.asarray(motion.position) @ np.array([0.5, 1.0, -9.81])
    assert float(here.energy) == pytest.approx(expected - weight, rel=1e-13)


def test_a_full_turn_of_a_ball_joint_is_singular_but_finite(arm: Robot, evaluate: Callable) -> None:
    """Rotation vectors of 2π are all the same pose: across it the Jacobian vanishes, as documented."""
    q = near()
    ball = arm.dof_slice("spherical")
    q[ball] = [0.0, 0.0, 2 * np.pi]
    here, motion = evaluate(arm, q, np.zeros(0))
    assert all(np.all(np.isfinite(part)) for part in jax.tree.leaves(here))
    columns = np.asarray(motion["spherical"].jacobian[0][:3])[:, -3:]
    np.testing.assert_allclose(np.linalg.svd(columns)[1], [1, 0, 0], atol=1e-12)


def test_joints_are_the_simpler_ones_they_are_made_of(evaluate: Callable) -> None:
    """A universal joint is two hinges, a cylindrical one a slide and a hinge, with massless links between."""
    site, heavy = jnp.array([[0.03, 0.01, -0.02]]), {"mass": jnp.array([0.1])}
    between = jnp.zeros((1, 3))
    first, second = (0.0, 0.6, 0.8), N
    robot = Robot(
        (
            Link("universal", 0.0, site, joint=Universal(first, second, stiffness=(0.1, 0.2)), **heavy),
            Link("outer", 0.0, between, joint=Revolute(first, stiffness=0.1)),
            Link("inner", 0.0, site, parent="outer", joint=Revolute(second, stiffness=0.2), **heavy),
            Link("cylindrical", 0.0, site, joint=Cylindrical(N, stiffness=(0.1, 2.0)), **heavy),
            Link("turn", 0.0, between, joint=Revolute(N, stiffness=0.1)),
            Link("slide", 0.0, site, parent="turn", joint=Prismatic(N, stiffness=2.0), **heavy),
        ),
        (Gravity(jnp.array([0.5, 1.0, -9.81])),),
    )
    whole, parts = slice(0, 2), slice(2, 4)
    for turned in (0.4, -7.0):
        here, motion = evaluate(robot, np.array([turned, 1.1, turned, 1.1] * 2), np.zeros(0))
        for one, other, at in (("universal", "inner", 0), ("cylindrical", "slide", 4)):
            np.testing.assert_allclose(motion[one].pose, motion[other].pose, atol=1e-14)
            gradient, hessian = here.gradient[at : at + 4], here.hessian[at : at + 4, at : at + 4]
            np.testing.assert_allclose(gradient[whole], gradient[parts], atol=1e-14)
            np.testing.assert_allclose(hessian[whole, whole], hessian[parts, parts], atol=1e-14)


def test_weights_settle_where_statics_says() -> None:
    """Each on its own joint beside the others; m g = 1 N.

    A slide and the sliding coordinates of a plane or a free body sink by mg/k. A screw of pitch p turns by
    mg p/k. A ball and a universal joint hold a weight at l, level at rest: k θ = mg l cos θ.
    """
    up, length, spring = (0.0, 0.0, 1.0), 0.1, 0.05
    weight = {"mass": jnp.array([1 / 9.81])}
    origin, tip = jnp.zeros((1, 3)), jnp.array([[length, 0.0, 0.0]])
    robot = Robot(
        (
            Link("prismatic", 0.0, tip, joint=Prismatic(up, stiffness=20.0), **weight),
            Link("helical", 0.0, tip, joint=Helical(up, PITCH, stiffness=spring), **weight),
            Link("planar", 0.0, origin, joint=Planar(stiffness=(0.1, 20.0, 30.0)), **weight),
            Link("free", 0.0, origin, joint=Free(stiffness=(0.1, 0.1, 0.1, 30.0, 30.0, 20.0)), **weight),
            Link("spherical", 0.0, tip, joint=Spherical(stiffness=spring), **weight),
            Link("universal", 0.0, tip, joint=Universal(up, (0.0, 1.0, 0.0), stiffness=spring), **weight),
        ),
        (Gravity(jnp.array([0.0, 0.0, -9.81])),),
    )
    found = drive([robot], np.zeros((1, 1)))
    assert found.converged.all()
    angle = brentq(lambda q: spring * q - length * np.cos(q), 0, np.pi / 2, xtol=1e-15)
    expected = {
        "prismatic": [-1 / 20],
        "helical": [-PITCH / spring],
        "planar": [0, -1 / 20, 0],
        "free": [0, 0, 0, 0, 0, -1 / 20],
        "spherical": [0, angle, 0],
        "universal": [0, angle],
    }
    # The solver's tolerance of 1e-10 of the energy norm of all joints, the softest of which is one of 20 N/m.
    np.testing.assert_allclose(found.q[0, 0], np.concatenate([*expected.values()]), atol=1e-8)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Revolute((0.0, 1.0, 1.0)), "joint axis: expected a unit vector, got .*; divide it"),
        (lambda: Prismatic((0.0, 0.0, 0.0)), "joint axis: expected a unit vector"),
        (lambda: Spherical(stiffness=-1.0), "Spherical stiffness: expected finite numbers of at least 0"),
        (lambda: Helical(stiffness=float("nan")), "Helical stiffness: expected finite numbers"),
        (lambda: Helical(pitch=float("inf")), "Helical pitch: expected a finite number of m/rad, got inf"),
        (lambda: Free(damping=(1.0, 2.0)), r"Free damping: expected one number or 6, got \(2,\)"),
        (lambda: Planar((float("nan"), 0.0, 1.0)), "joint axis: expected a unit vector"),
        (lambda: Revolute(limits=(1.0, -1.0)), "Revolute limits: expected lower < upper, one pair or 1"),
        (lambda: Revolute(limits=(0.5, 0.5)), "Revolute limits: expected lower < upper"),
        (lambda: Revolute(limits=(float("nan"), 1.0)), "Revolute limits: expected lower < upper"),
        (lambda: Spherical(limits=((-1.0, 1.0), (-1.0, 1.0))), "Spherical limits: .* or 3 of them"),
        (lambda: Revolute(limits=(-1.0, 1.0)), "Revolute limits: a range without limit_stiffness"),
        (lambda: Universal(N, N), "Universal axes: expected two directions"),
        (lambda: Universal((2.0, 0.0, 0.0), N), "joint axis: expected a unit vector"),
        (lambda: Joint([[(0.0, 0.0, 1.0, 0.0, 0.0)]]), "Joint twists: expected six finite numbers each"),
        (
            lambda: Joint([[(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * 2]),
            "Joint twists: expected directions that differ",
        ),
    ],
)
def test_impossible_joints_are_refused(make: Callable, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()
