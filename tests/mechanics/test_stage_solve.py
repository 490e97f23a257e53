"""One stage of a step: exact where the equation of motion is linear, solved by iteration where it is not."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from exosight.mechanics import Gravity, Link, Prismatic, Revolute, Robot
from exosight.mechanics.equation_of_motion import equation_of_motion
from exosight.mechanics.joint import Joint
from exosight.mechanics.stage_solve import (
    NewtonState,
    NewtonStep,
    Stage,
    begin_newton,
    newton_point,
    newton_step,
    next_newton,
    stage_of,
)
from exosight.mechanics.step_control import step_error
from exosight.mechanics.tableau import ARK4_IMPLICIT as METHOD

MASS, STIFFNESS, DAMPING = 2.0, 50.0, 3.0
OSCILLATOR = np.array([[0.0, 1.0], [-STIFFNESS / MASS, -DAMPING / MASS]])
"""L of dy/dt = L y, y = (q, v)."""


def one_mass(joint: Joint, mass: float = MASS, gravity: float = 0.0) -> Robot:
    link = Link("mass", 1.0, np.array([[1.0, 0.0, 0.0]]), mass=np.array([mass]), joint=joint)
    return Robot((link,), (Gravity(jnp.array([0.0, 0.0, -gravity])),))


@pytest.fixture(scope="module")
def solve() -> Callable[..., tuple[NewtonStep, NewtonState, jax.Array]]:
    """(robot, stage, state, tolerance) -> the Newton step, the state after it, and the residual before it."""

    def once(robot: Robot, stage: Stage, state: NewtonState, tolerance: float) -> tuple:
        q, v, eta = newton_point(stage, state.a)
        here = equation_of_motion(robot)(q, v, jnp.asarray(state.a), jnp.zeros(0), eta)
        found = newton_step(stage, here, state, jnp.asarray(tolerance))
        return found, next_newton(state, found), here.residual

    return eqx.filter_jit(once, compiler_options={"xla_backend_optimization_level": "0"})


def linear_slopes(solve: Callable, step: float, start: np.ndarray) -> np.ndarray:
    """f(Y) of the stages of one step of the oscillator, each by one Newton step."""
    robot = one_mass(Prismatic((1.0, 0.0, 0.0), stiffness=STIFFNESS, damping=DAMPING))
    slopes, state = np.zeros((METHOD.stages, 2, 1)), begin_newton(np.zeros(1))
    for i in range(METHOD.stages):
        stage = stage_of(METHOD, np.array(i), np.array(step), jnp.asarray(start[:, None]), slopes)
        found, state, _ = solve(robot, stage, state, 1e-9)
        slopes[i] = np.stack([found.v, found.a])
    return slopes


def test_stages_of_a_linear_system_make_the_rational_function_of_the_method(solve: Callable) -> None:
    """R(hL) = 1 + (bᵀ ⊗ hL) (1 − A ⊗ hL)⁻¹ (1 ⊗ 1), at steps up to where the damper is stiff."""
    start = np.array([0.3, -1.0])
    a = METHOD.lower + np.diag([0.0, *[METHOD.diagonal] * (METHOD.stages - 1)])
    for step in (0.01, 0.2, 3.0):
        slopes = linear_slopes(solve, step, start)
        stages = np.kron(np.ones(METHOD.stages), start)
        stages = np.linalg.solve(np.eye(len(stages)) - np.kron(a, step * OSCILLATOR), stages)
        expected = stages.reshape(METHOD.stages, 2) @ OSCILLATOR.T
        np.testing.assert_allclose(slopes[..., 0], expected, rtol=1e-10, atol=1e-11)
        end = start + step * METHOD.weights @ slopes[..., 0]
        np.testing.assert_allclose(end, stages[-2:], atol=1e-11)


def test_the_estimate_falls_at_fourth_order_and_is_above_the_error_of_a_step(solve: Callable) -> None:
    """The error of one step, which the exact solution tells, falls at fifth order."""
    start = np.array([0.3, -1.0])
    estimates, errors = [], []
    for step in (0.02, 0.01):
        slopes = linear_slopes(solve, step, start)
        estimate = step_error(METHOD, jnp.asarray(slopes), jnp.array(step), lambda x: jnp.abs(x[0]))
        end = start + step * METHOD.weights @ slopes[..., 0]
        off = np.abs(end - expm(step * OSCILLATOR) @ start)
        estimates.append(float(estimate))
        errors.append(max(off[0], step * off[1]))
    assert np.log2(estimates[0] / estimates[1]) == pytest.approx(4, abs=0.2)
    assert np.log2(errors[0] / errors[1]) > 4.8
    assert np.all(np.array(errors) < estimates)


def test_the_acceleration_at_the_start_is_force_by_mass(solve: Callable) -> None:
    robot = one_mass(Prismatic((1.0, 0.0, 0.0), stiffness=STIFFNESS, damping=DAMPING))
    stage = Stage(jnp.array([0.3]), jnp.array([-1.0]), jnp.array(0.0), jnp.array(True))
    found, _, _ = solve(robot, stage, begin_newton(np.zeros(1)), 1e-9)
    assert found.converged
    assert float(found.a[0]) == pytest.approx((-STIFFNESS * 0.3 + DAMPING) / MASS, rel=1e-12)
    assert (float(found.q[0]), float(found.v[0])) == (0.3, -1.0)


def test_a_stage_of_a_pendulum_is_solved_to_a_hundredth_of_the_tolerance(solve: Callable) -> None:
    """g cos(Q) = A at Q = q* + η V, V = v* + η A, for a point mass at 1 m that swings fast."""
    robot = one_mass(Revolute(), gravity=9.81)
    eta, tolerance = 0.1, 1e-6
    stage = Stage(jnp.array([0.2]), jnp.array([2.0]), jnp.array(eta), jnp.array(False))
    state, steps = begin_newton(np.zeros(1)), 0
    found, state, _ = solve(robot, stage, state, tolerance)
    while not found.converged:
        assert not found.diverged
        found, state, _ = solve(robot, stage, state, tolerance)
        steps += 1
    assert 0 < steps < 5
    q, v, a = (float(x[0]) for x in (found.q, found.v, found.a))
    assert v == pytest.approx(2.0 + eta * a, rel=1e-12)
    assert q == pytest.approx(0.2 + eta * v, rel=1e-12)
    # δQ [m at 1 m] is η² δA.
    assert abs(a - 9.81 * np.cos(q)) * eta**2 < 1e-2 * tolerance
    assert int(state.iterations) == 0  # ready for the next stage


def test_what_has_no_solution_diverges(solve: Callable) -> None:
    """A coordinate that moves no mass has no acceleration; a stage that stays unsolved is given up."""
    spring = Prismatic((1.0, 0.0, 0.0), stiffness=STIFFNESS, damping=DAMPING)
    start = Stage(jnp.array([0.3]), jnp.array([0.0]), jnp.array(0.0), jnp.array(True))
    found, _, _ = solve(one_mass(spring, mass=0.0), start, begin_newton(np.zeros(1)), 1e-9)
    assert found.diverged
    assert not found.converged
    robot, state = one_mass(Revolute(), gravity=9.81), begin_newton(np.zeros(1))
    stage = Stage(jnp.array([0.2]), jnp.array([2.0]), jnp.array(0.1), jnp.array(False))
    steps = 0
    while not found.diverged or not steps:
        found, state, _ = solve(robot, stage, state, 0.0)  # no error is below zero
        steps += 1
    assert 1 < steps <= 10
    assert not found.converged
