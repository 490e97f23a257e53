"""Stable equilibria of a cantilever: the elastica, Euler's column, and what a solve promises.

The rod only bends, so it is exactly the inextensible elastica; every robot here has a tip force as its one
load, in units of EI/L². Points at the element ends keep the kinks of the nodal basis out of the Magnus steps.
"""

from collections.abc import Callable
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    DeadForce,
    Equilibria,
    Gauss,
    NodalQuadratic,
    Robot,
    Rod,
    SolverOptions,
    State,
    advance,
    drive,
    initial_state,
)

LENGTH, RADIUS, YOUNG = 0.3, 0.01, 1e6
UNIT = YOUNG * np.pi * RADIUS**4 / 4 / LENGTH**2
"""EI/L² [N]."""
EULER = np.pi**2 / 4
"""Critical compression of the clamped column [EI/L²]."""

ACROSS, ALONG = (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)


def cantilever(elements: int, direction: tuple[float, float, float] = ACROSS) -> Robot:
    points = Gauss(elements, 3, element_ends=True)
    rod = Rod(
        "rod",
        LENGTH,
        Circular(jnp.full(points.size, RADIUS)),
        young=YOUNG,
        strains={"bend_y": NodalQuadratic(elements)},
        quadrature=points,
    )
    return Robot((rod,), (DeadForce("rod", -1, 0, UNIT * jnp.array(direction)),))


def solve(robot: Robot, loads: list[float] | np.ndarray, **given: object) -> Equilibria:
    """The path of one robot, without the leading axis of one."""
    found = drive([robot], np.asarray(loads, dtype=float)[:, None], **given)
    return jax.tree.map(lambda leaf: leaf[0], found)


def elastica(alpha: float) -> np.ndarray:
    """x/L, z/L and the slope of the tip under a transverse dead force of α EI/L².

    With k² = (1 + sin θ)/2 and sin φ = 1/(√2 k): √α = K(k) − F(φ, k), x = √(2 sin θ/α) and
    z = 1 − 2 (E(k) − E(φ, k))/√α. Source: Bisshopp and Drucker, Large deflection of cantilever beams, 1945.
    """

    def parts(theta: float) -> tuple[float, float]:
        m = (1 + np.sin(theta)) / 2
        return m, np.arcsin(1 / np.sqrt(2 * m))

    def excess(theta: float) -> float:
        m, phi = parts(theta)
        return ellipk(m) - ellipkinc(phi, m) - np.sqrt(alpha)

    theta = brentq(excess, 1e-9, np.pi / 2 - 1e-12, xtol=1e-15)
    m, phi = parts(theta)
    z = 1 - 2 / np.sqrt(alpha) * (ellipe(m) - ellipeinc(phi, m))
    return np.array([np.sqrt(2 * np.sin(theta) / alpha), z, theta])


def tip(motion: Callable, robot: Robot, q: np.ndarray) -> np.ndarray:
    """x/L, z/L and slope of the tip."""
    pose = np.asarray(motion(robot, q).pose[-1])
    return np.array([pose[0, 3] / LENGTH, pose[2, 3] / LENGTH, np.arctan2(pose[2, 0], pose[0, 0])])


def test_small_tip_load_matches_euler_bernoulli(motion: Callable) -> None:
    """z = P L³/3EI; what is left out is of relative order α²."""
    alpha = 1e-4
    found = solve(cantilever(4), [alpha])
    assert tip(motion, cantilever(4), found.q[0])[1] == pytest.approx(alpha / 3, rel=1e-7)


def test_rod_converges_to_the_elastica_at_fourth_order(motion: Callable) -> None:
    """Twice as many elements, a sixteenth of the error at the tip.

    Quadratic strains alone would give a higher order at the tip; the Magnus steps are of fourth.
    """
    loads = [1.0, 2.0, 5.0]
    exact = np.array([elastica(alpha) for alpha in loads])
    errors = []
    for elements in (1, 2, 4):
        robot = cantilever(elements)
        found = solve(robot, loads)
        assert found.converged.all()
        errors.append(np.abs([tip(motion, robot, q) for q in found.q] - exact).max(axis=1))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # The worst case here, one element bent by 1.2 rad, is where small steps begin.
    assert np.all(orders > 3.5), orders
    # Four elements: 5e-7 of the length at α = 2, where the deflection is half of it.
    assert errors[-1][1] < 1e-6


def test_a_compressed_column_stays_straight_below_euler() -> None:
    """The smallest eigenvalue of ∇²Π against the elastic stiffness is 1 − P/P_cr: what is left of it."""
    below = np.array([0.0, 0.25, 0.5, 0.9, 0.99])
    found = solve(cantilever(4, ALONG), below * EULER)
    assert found.converged.all()
    np.testing.assert_array_equal(found.q, 0.0)
    # Four elements overestimate P_cr by 1e-5; the metric carries a millionth more than the stiffness.
    np.testing.assert_allclose(found.min_eigenvalue, 1 - below, atol=3e-5)


@pytest.mark.parametrize("path", [[1.05], [0.5, 1.05], [0.5, 0.99, 1.01, 1.05]])
def test_beyond_euler_the_straight_column_is_no_answer(motion: Callable, path: list[float]) -> None:
    """There it is an equilibrium still, but a saddle. The bent one has √α = K(k) and z/L = 2k/√α."""
    robot, alpha = cantilever(4, ALONG), 1.05 * EULER
    found = solve(robot, np.array(path) * EULER)
    assert found.converged.all()
    assert found.min_eigenvalue[-1] > 0.01
    modulus = np.sqrt(brentq(lambda m: ellipk(m) - np.sqrt(alpha), 1e-12, 0.9, xtol=1e-15))
    # The critical load is off by 1e-5, and the deflection goes with the root of the distance to it, 5 %.
    assert abs(tip(motion, robot, found.q[-1])[1]) == pytest.approx(2 * modulus / np.sqrt(alpha), rel=1e-3)


def test_at_rest_every_mode_has_its_own_stiffness() -> None:
    found = solve(cantilever(4), [0.0])
    assert found.converged[0]
    assert found.min_eigenvalue[0] == pytest.approx(1.0, abs=1e-4)  # a millionth of the mean stands beside it
    np.testing.assert_array_equal(found.q, 0.0)


def test_newton_converges_quadratically() -> None:
    """From a pose nearby, each residual is at most a constant times the square of the one before."""
    robot = cantilever(4)
    start = State(solve(robot, [2.0]).q, np.array([[2.5]]))
    residuals = [
        solve(
            robot, [2.5], state=start, options=SolverOptions(tolerance=1e-15, max_iterations=steps)
        ).residual[0]
        for steps in range(1, 6)
    ]
    assert residuals[0] > 1e-2
    for before, after in pairwise(residuals):
        assert after < max(3 * before**2, 1e-14), residuals
    assert residuals[-1] < 1e-14


def test_an_unfinished_solve_says_so() -> None:
    found = solve(cantilever(4), [5.0, 0.0], options=SolverOptions(max_iterations=2))
    assert not found.converged[0]
    assert found.residual[0] > 1e-6
    assert found.iterations[0] == 2
    assert np.isfinite(found.q).all()


def test_what_is_reported_is_that_of_the_pose(evaluate: Callable) -> None:
    """Energy, residual and smallest eigenvalue again, from one evaluation and SciPy."""
    robot = cantilever(4)
    metric = np.asarray(robot["rod"].stiffness())
    found = solve(robot, [1.0, 2.0], options=SolverOptions(tolerance=1e-4))
    assert np.all(found.residual > 1e-12)  # stopped early, so that there is something to compare
    small = 0.01 * np.sqrt(np.trace(metric) / len(metric))
    for i, load in enumerate([1.0, 2.0]):
        q = found.q[i]
        here, _ = evaluate(robot, q, np.array([load]))
        assert float(here.energy) == pytest.approx(found.energy[i], rel=1e-13)
        # The solver's metric has a millionth of the mean added to the stiffness.
        size = np.sqrt(here.gradient @ np.linalg.solve(metric, here.gradient))
        assert size / (np.sqrt(q @ metric @ q) + small) == pytest.approx(found.residual[i], rel=1e-3)
        lowest = eigh(here.hessian, metric, eigvals_only=True)[0]
        assert lowest == pytest.approx(found.min_eigenvalue[i], rel=1e-4)


def test_batch_matches_loop() -> None:
    """More robots than lanes, so that lanes are used again; thicknesses from half to twice."""
    robots = [cantilever(1, direction) for direction in ((0.0, 0.0, s) for s in (0.5, 1.0, 1.5, 2.0, -1.0))]
    loads = np.array([0.5, 1.0, 3.0])
    batch = drive(robots, loads[:, None], options=SolverOptions(lanes=2))
    assert batch.q.shape == (5, 3, 3)
    for i, robot in enumerate(robots):
        alone = solve(robot, loads)
        # The same steps with sums in another order: both within the tolerance of 1e-10 of the minimum.
        np.testing.assert_allclose(batch.q[i], alone.q, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(batch.min_eigenvalue[i], alone.min_eigenvalue, rtol=1e-9)
        np.testing.assert_array_equal(batch.iterations[i], alone.iterations)
        assert alone.converged.all()
        assert batch.converged[i].all()


def test_changed_numbers_of_a_robot_are_solved_anew() -> None:
    """What is kept of robots from solve to solve is of their numbers, not of the objects that hold them."""
    robot, loads = cantilever(1), np.array([[2.0]])
    start = State(np.zeros((1, robot.dofs)), np.zeros((1, 1)))
    first = advance([robot], start, loads)[1].q
    robot.bodies[0].young[...] *= 2  # in place
    stiffer = advance([robot], start, loads)[1].q
    robot.bodies[0].young[...] /= 2
    again = advance([robot], start, loads)[1].q
    assert np.abs(stiffer).max() < 0.9 * np.abs(first).max()
    np.testing.assert_array_equal(again, first)


def test_single_loads_in_any_order_give_the_same() -> None:
    """More robots than lanes on ways of different lengths, which are taken in the order of these."""
    robots = [cantilever(1, (0.0, 0.0, s)) for s in (0.5, 1.0, 1.5, 2.0, -1.0)]
    loads = np.array([[0.1], [2.0], [0.0], [1.0], [3.0]])
    start = State(np.zeros((5, robots[0].dofs)), np.zeros((5, 1)))
    found = advance(robots, start, loads, SolverOptions(lanes=2))[1]
    backwards = advance(robots[::-1], start, loads[::-1], SolverOptions(lanes=2))[1]
    np.testing.assert_array_equal(backwards.q[::-1], found.q)
    for i, robot in enumerate(robots):
        np.testing.assert_allclose(found.q[i], solve(robot, loads[i]).q[0], rtol=1e-9, atol=1e-12)


def test_smallest_eigenvalues_are_found_unless_left_out() -> None:
    """Without them the same stable poses, also beyond Euler's load, where the straight one is not stable."""
    robots = [cantilever(1, ALONG)]
    start = State(np.zeros((1, robots[0].dofs)), np.zeros((1, 1)))
    for load in (0.5 * EULER, 1.5 * EULER):
        _, found = advance(robots, start, np.array([[load]]))
        _, short = advance(robots, start, np.array([[load]]), SolverOptions(eigenvalues=False))
        np.testing.assert_array_equal(short.q, found.q)
        assert found.min_eigenvalue[0] > 0
        assert np.isnan(short.min_eigenvalue[0])
        assert short.converged[0]
        assert found.converged[0]
    assert np.abs(found.q).max() > 0.1  # it has left the straight pose


def test_every_robot_is_reported_once() -> None:
    """Whichever thread comes first: a hundred times, as some orders are rare."""
    robots = [cantilever(1, (0.0, 0.0, s)) for s in (0.5, 1.0, 1.5, 2.0, -1.0)]
    for _ in range(100):
        told: list[int] = []
        drive(robots, np.ones((3, 1)), options=SolverOptions(lanes=2), done=told.append)
        assert sum(told) == 5


def test_advance_repeated_is_drive() -> None:
    """Two robots on ways of their own: step by step, along the path, and in one step to its end."""
    robots = [cantilever(4), cantilever(4, (-1.0, 0.0, 0.01))]
    loads = np.array([[[1.0], [4.0], [2.0]], [[1.0], [3.0], [1.2]]])
    path = drive(robots, loads)
    state = initial_state(robots)
    for k in range(3):
        state, found = advance(robots, state, loads[:, k])
        assert found.converged.all()
        np.testing.assert_array_equal(state.loads, loads[:, k])
        np.testing.assert_allclose(state.q, path.q[:, k], rtol=1e-9, atol=1e-9)  # ten times that of a solve
    start = State(path.q[:, 1], loads[:, 1])
    once, _ = advance(robots, start, loads[:, 2])
    np.testing.assert_allclose(once.q, state.q, rtol=1e-9, atol=1e-9)


def test_a_branch_is_kept_until_it_ends() -> None:
    """A column pushed 1 % askew bends to its side; on the other it stays while that is stable."""
    robot = cantilever(4, (-1.0, 0.0, 0.01))
    easy = solve(robot, np.array([0.5, 1.3]) * EULER).q[1]
    loads = np.array([[1.3], [1.25], [0.3], [1.3]]) * EULER
    found = drive([robot], loads, state=State(-easy[None], loads[:1]))
    assert found.converged.all()
    # It starts on the other side, and loses that side for good when unloaded.
    side = np.sign(found.q[0].sum(axis=1) * easy.sum())
    np.testing.assert_array_equal(side, [-1, -1, 1, 1])
    np.testing.assert_array_equal(found.snapped[0], [False, False, True, False])
    np.testing.assert_allclose(found.q[0, 3], easy, rtol=1e-7)  # soft modes cost a factor of a hundred


def test_a_path_starts_where_its_state_is() -> None:
    robot = cantilever(4)
    there = solve(robot, [3.0])
    again = solve(robot, [3.0], state=State(there.q, np.array([[3.0]])))
    assert again.iterations[0] <= 2
    np.testing.assert_allclose(again.q, there.q, rtol=1e-9)


ZERO = np.zeros((1, 1))
NAN = np.array([[0.0], [np.nan]])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"loads": NAN}, "loads: expected finite numbers"),
        ({"loads": np.zeros((0, 1))}, "loads: expected"),
        (
            {"loads": ZERO, "state": State(np.full((1, 9), np.nan), ZERO)},
            "q: expected finite numbers",
        ),
        (
            {"loads": ZERO, "state": State(np.zeros((1, 8)), ZERO)},
            r"q: expected finite numbers of shape \(1, 9\)",
        ),
    ],
)
def test_bad_input_is_refused(arguments: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        drive([cantilever(4)], **arguments)


def test_what_does_not_fit_the_robot_is_refused() -> None:
    robot = cantilever(2)
    with pytest.raises(InputError, match="need 1 channels, got 0"):
        drive([robot], np.zeros((2, 0)))
    with pytest.raises(InputError, match="at least one, got none"):
        drive([], np.zeros((2, 1)))
    with pytest.raises(InputError, match="NaN or infinity"):
        drive([robot], np.array([[np.nan]]))
    with pytest.raises(InputError, match="above 0"):
        SolverOptions(lanes=0)
    with pytest.raises(InputError, match="one structure"):
        drive([robot, Robot(robot.bodies)], np.zeros((1, 1)))
