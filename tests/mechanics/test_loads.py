"""Loads from outside: what they do to every coordinate, tangents against differences, follower elasticas."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from backends import check
from scipy.integrate import solve_ivp

from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    DeadForce,
    DistributedForce,
    Gauss,
    JointTorque,
    Motion,
    NodalQuadratic,
    PointWrench,
    Robot,
    Rod,
    drive,
    potential,
)
from exosight.mechanics.energy import stiffness

STEP = 1e-6
WRENCH = np.array([0.02, -0.03, 0.05, 0.4, -0.3, 0.6])
SPREAD = np.random.default_rng(2).normal(size=(8, 3))
LOADS = np.array([1.5, -0.7, 1.2, 0.8, 2.0])
QUICKLY = {"xla_backend_optimization_level": "0"}


@pytest.fixture(scope="module")
def loaded(tree: Robot) -> Robot:
    """The tree under every kind of load without an energy, one in each channel, and a motor."""
    spread = jnp.asarray(SPREAD)
    terms = (
        PointWrench("rod", 3, 0, WRENCH),
        PointWrench("branch", -1, 1, WRENCH, follower=True),
        PointWrench("lower", 1, 2, WRENCH, follower=True),
        DistributedForce("rod", 3, spread, follower=True),
        DistributedForce("branch", 3, spread),
        JointTorque("lower", 4),
    )
    return Robot(tree.bodies, terms)


def test_programs_evaluate_loads(loaded: Robot) -> None:
    check(loaded)


@pytest.fixture(scope="module")
def here(loaded: Robot, tree_pose: tuple, evaluate: Callable) -> tuple:
    """Evaluation and Motion at the tree's pose."""
    return evaluate(loaded, tree_pose[0], LOADS)


@pytest.fixture(scope="module")
def around(loaded: Robot, tree_pose: tuple, evaluate: Callable) -> list:
    """Evaluations and Motions one step ahead and one behind, along each coordinate."""
    return [
        tuple(evaluate(loaded, tree_pose[0] + sign * e, LOADS) for sign in (1, -1))
        for e in STEP * np.eye(loaded.dofs)
    ]


def work_rates(around: list, pose: np.ndarray, wrenches: list[tuple[int, np.ndarray]]) -> np.ndarray:
    """Σ M · ω + F · v by each coordinate, from differences of the poses; wrenches in the world."""
    rates = []
    for (_, ahead), (_, behind) in around:
        change = (np.asarray(ahead.pose) - np.asarray(behind.pose)) / (2 * STEP)
        total = 0.0
        for i, wrench in wrenches:
            spin = change[i, :3, :3] @ pose[i, :3, :3].T
            total += wrench[:3] @ [spin[2, 1], spin[0, 2], spin[1, 0]] + wrench[3:] @ change[i, :3, 3]
        rates.append(total)
    return np.array(rates)


def test_loads_do_the_work_of_their_wrenches(
    loaded: Robot, tree_pose: tuple, here: tuple, around: list
) -> None:
    """−∂∇Π/∂u in each channel is the moment times the turning plus the force times the way."""
    pose = np.asarray(here[1].pose)
    turn = pose[:, :3, :3]
    rod, branch = loaded.frame_slice("rod"), loaded.frame_slice("branch")
    lower = loaded.frame("lower", 1)

    def follower(i: int, wrench: np.ndarray) -> tuple[int, np.ndarray]:
        return i, np.concatenate([turn[i] @ wrench[:3], turn[i] @ wrench[3:]])

    def along(name: str) -> list[np.ndarray]:
        weight = np.asarray(loaded[name].weights())[:, None]
        return list(np.concatenate([np.zeros((8, 3)), weight * SPREAD], axis=1))

    channels = [
        [(rod.start + 3, WRENCH)],
        [follower(branch.stop - 1, WRENCH)],
        [follower(lower, WRENCH)],
        [follower(rod.start + i, w) for i, w in enumerate(along("rod"))]
        + [(branch.start + i, w) for i, w in enumerate(along("branch"))],
    ]
    # Central differences of poses: round-off 1e-16/1e-6 and the square of the step, times wrenches below one.
    for wrenches, by_load in zip(channels, np.asarray(here[0].load_gradient), strict=False):
        assert np.abs(by_load).max() > 1e-4
        np.testing.assert_allclose(-by_load, work_rates(around, pose, wrenches), atol=1e-9)
    motor = np.zeros(loaded.dofs)
    motor[loaded.dof_slice("lower").start] = -1.0
    np.testing.assert_array_equal(here[0].load_gradient[4], motor)


def test_loads_are_linear_and_nothing_else_is_there(loaded: Robot, tree_pose: tuple, here: tuple) -> None:
    """∇Π − K q − limits = Σ u ∂∇Π/∂u."""
    q = tree_pose[0]
    elastic = np.asarray(stiffness(loaded)) @ q
    for name in ("upper", "lower"):  # limits −0.1…0.2 rad, 5 N m/rad beyond them
        i = loaded.dof_slice(name).start
        elastic[i] += 5.0 * (max(q[i] - 0.2, 0.0) + min(q[i] + 0.1, 0.0))
    np.testing.assert_allclose(here[0].gradient - elastic, LOADS @ here[0].load_gradient, atol=1e-13)


def test_tangent_matches_differences_of_the_gradient(here: tuple, around: list) -> None:
    """Unsymmetric, as a follower makes it."""
    differences = np.array([(a[0].gradient - b[0].gradient) / (2 * STEP) for a, b in around]).T
    hessian = np.asarray(here[0].hessian)
    assert np.abs(hessian - hessian.T).max() > 1e-3
    # Round-off 1e-16·‖∇Π‖/h and the square of the step, as for the energies of the tree.
    np.testing.assert_allclose(hessian, differences, atol=1e-8)


@pytest.fixture(scope="module")
def expansion(tree: Robot) -> Callable:
    """A term's own Expansion on the tree."""
    return eqx.filter_jit(lambda term, *at: term.bind(tree)(*at), compiler_options=QUICKLY)


@pytest.fixture(scope="module")
def at(tree_pose: tuple, here: tuple) -> tuple[np.ndarray, Motion, np.ndarray]:
    return tree_pose[0], here[1], LOADS


def test_a_dead_wrench_without_moment_is_a_dead_force(expansion: Callable, at: tuple) -> None:
    force = WRENCH[3:]
    wrench = PointWrench("branch", 2, 1, np.array([0.0, 0.0, 0.0, *force]))
    assert wrench.conservative
    one, other = expansion(wrench, *at), expansion(DeadForce("branch", 2, 1, jnp.asarray(force)), *at)
    for name in one._fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_spread_dead_force_has_the_energy_of_its_resultants(
    tree: Robot, expansion: Callable, at: tuple
) -> None:
    """−u ∫ f · p ds; a constant force adds up to f times the length."""
    force = np.array([0.3, -0.2, 0.9])
    load = DistributedForce("branch", 0, jnp.tile(jnp.asarray(force), (8, 1)))
    assert load.conservative
    found = expansion(load, *at)
    own = tree.frame_slice("branch")
    position, weights = np.asarray(at[1].position)[own], np.asarray(tree["branch"].weights())
    expected = -LOADS[0] * weights @ position @ force
    assert float(found.energy) == pytest.approx(expected, rel=1e-13)
    np.testing.assert_allclose(found.wrench[:, 3:].sum(0), -LOADS[0] * 0.05 * force, rtol=1e-13)


def test_what_has_no_energy_says_so(loaded: Robot) -> None:
    assert [term.conservative for term in loaded.terms] == [False, False, False, False, True, True]
    assert not loaded.conservative
    assert loaded.loads == 5


def test_a_motor_works_over_its_angle(tree_pose: tuple, loaded: Robot, here: tuple) -> None:
    """Λ = −q; what has no energy has no share."""
    angle = tree_pose[0][loaded.dof_slice("lower").start]
    np.testing.assert_allclose(
        np.asarray(here[0].load_energy)[[0, 1, 2, 4]], [0.0, 0.0, 0.0, -angle], rtol=1e-15
    )


LENGTH, RADIUS, YOUNG = 0.3, 0.01, 1e6
UNIT = YOUNG * np.pi * RADIUS**4 / 4 / LENGTH**2
"""EI/L² [N]."""


def cantilever(force: tuple[float, float, float]) -> Robot:
    """A rod that only bends, with a follower force at its tip [EI/L²]."""
    points = Gauss(4, 3, element_ends=True)
    rod = Rod(
        "rod",
        LENGTH,
        Circular(jnp.full(points.size, RADIUS)),
        young=YOUNG,
        strains={"bend_y": NodalQuadratic(4)},
        quadrature=points,
    )
    wrench = np.array([0.0, 0.0, 0.0, *force]) * UNIT
    return Robot((rod,), (PointWrench("rod", -1, 0, wrench, follower=True),))


def follower_elastica(alpha: float) -> np.ndarray:
    """x/L, z/L and slope of the tip under a follower force of α EI/L² across it.

    With φ the slope against the tip's and s from the base, φ″ = −α cos φ, φ(1) = φ′(1) = 0: the force is
    constant seen from the tip, so it is integrated from there, and turned to stand on the base.
    """

    def slope(_: float, state: np.ndarray) -> list[float]:
        phi, curvature = state[:2]
        return [curvature, -alpha * np.cos(phi), np.cos(phi), np.sin(phi)]

    end = solve_ivp(slope, (1, 0), np.zeros(4), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    c, s = np.cos(end[0]), np.sin(end[0])
    x, z = -end[2:]
    return np.array([c * x + s * z, -s * x + c * z, -end[0]])


def test_a_follower_bends_the_cantilever_as_its_elastica(motion: Callable) -> None:
    """From rest to where the tip points back, 3.1 rad, in four loads."""
    loads = np.array([1.0, 4.0, 10.0, 16.0])
    robot = cantilever((0.0, 0.0, 1.0))
    found = drive([robot], loads[:, None])
    assert found.converged.all()
    tips = np.array([motion(robot, q).pose[-1] for q in found.q[0]])
    exact = np.array([follower_elastica(alpha) for alpha in loads])
    # Four elements bent by up to 1.5 rad each: 1.1e-4 of the length at the last load, 3e-7 at the first.
    np.testing.assert_allclose(tips[:, [0, 2], 3] / LENGTH, exact[:, :2], atol=2e-4)
    turned = np.unwrap(np.arctan2(tips[:, 2, 0], tips[:, 0, 0]))
    np.testing.assert_allclose(turned, exact[:, 2], atol=2e-4)


def test_a_follower_along_the_column_does_not_buckle_it() -> None:
    """Beck's column has no other equilibrium than the straight one, at any load; Euler's buckles at π²/4."""
    found = drive([cantilever((-1.0, 0.0, 0.0))], np.array([[2.0], [4.0], [15.0]]))
    assert found.converged.all()
    np.testing.assert_allclose(found.q, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("term", "sentence"),
    [
        (
            lambda: DistributedForce("rod", 0, jnp.zeros((5, 3))),
            r"DistributedForce on 'rod': expected .*\(8, 3\)",
        ),
        (lambda: DistributedForce("upper", 0, jnp.zeros((2, 3))), "DistributedForce: 'upper' is a link"),
        (lambda: JointTorque("upper", 0, 1), "has 1 coordinates, got number 1"),
        (lambda: JointTorque("branch", 0), "has 0 coordinates, got number 0"),
        (lambda: PointWrench("upper", 7, 0, WRENCH), "body 'upper' has frames 0…1, got 7"),
    ],
)
def test_what_does_not_fit_the_tree_is_refused(tree: Robot, term: Callable, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        potential(Robot(tree.bodies, (term(),)))


def test_a_wrench_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InputError, match="expected 6 finite numbers"):
        PointWrench("rod", -1, 0, np.array([0.0, 0.0, 0.0, np.nan, 0.0, 0.0]))
