"""Viscoelastic rods against the closed forms of the standard linear solid, and the balance of energy."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from backends import check
from scipy.linalg import expm

from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    DeadForce,
    Gauss,
    Legendre,
    Link,
    MotionOptions,
    Robot,
    Rod,
    drive,
    evolve,
)
from exosight.mechanics.relaxation import relaxation
from exosight.mechanics.tree import Tree

RIGIDITY, LENGTH, MASS = 1e6 * np.pi * 0.01**2, 0.1, 0.2
SHARE, TAU = 0.4, 2.0
RATIO = SHARE / (1 - SHARE)
"""Stiffness of the relaxing spring over that of the one that stays."""


@pytest.fixture(scope="module")
def bar() -> Robot:
    """A bar that stretches evenly, a mass at its end, a pull there (channel 0) and the time (channel 1).

    Two modes of the same time are one.
    """
    points = Gauss(1, 1)
    rod = Rod(
        "bar",
        LENGTH,
        Circular(np.full(points.size, 0.01)),
        young=1e6,
        strains={"stretch_x": Legendre(0)},
        quadrature=points,
    )
    bodies = (rod, Link("end", 0.0, np.zeros((1, 3)), parent="bar", mass=np.array([MASS])))
    pull = DeadForce("end", 0, 0, jnp.array([1.0, 0.0, 0.0]))
    return Robot(bodies, (pull, relaxation("bar", [0.3, SHARE - 0.3], [TAU, TAU], 1, Tree(bodies))))


def test_programs_evaluate_relaxation(bar: Robot) -> None:
    check(bar, least=jnp.array(0.0))


def test_a_bar_creeps_as_a_standard_linear_solid(bar: Robot) -> None:
    """F/EA · (1 − c/(1 + c) e^(−t/τ(1 + c))): instantaneous at first, its own modulus in the end."""
    time = np.concatenate([[0.0], np.linspace(0.0, 6.0, 1501)])
    found = drive([bar], np.stack([np.where(np.arange(len(time)) > 0, 3.0, 0.0), time], axis=1))
    assert found.converged.all()
    exact = 3.0 / RIGIDITY * (1 - RATIO / (1 + RATIO) * np.exp(-time[1:] / (TAU * (1 + RATIO))))
    np.testing.assert_allclose(found.q[0, 1:, 0], exact, rtol=1e-6)


def test_stress_relaxes_exactly_in_steps_of_any_length(bar: Robot, evaluate: Callable) -> None:
    """EA ε (1 + Σ c e^(−t/τ)) at a constant strain; forces on the coordinate are L times that."""
    strain, times = np.array([0.01]), np.array([TAU, 0.2])
    bar = Robot(bar.bodies, (bar.terms[0], relaxation("bar", [0.3, 0.1], times.tolist(), 1, bar)))
    for time in (0.0, 1e-6, 0.3, 4.0, 1e3):
        loads = np.array([0.0, time])
        here, motion = evaluate(bar, strain, loads)
        exact = LENGTH * RIGIDITY * 0.01 * (1 + np.exp(-time / times) @ [0.3, 0.1] / 0.6)
        assert float(here.gradient[0]) == pytest.approx(exact, rel=1e-12)
        bar = bar.with_memories(bar.remember(motion, jnp.asarray(loads)))
    # The spring's energy, and all of it, is what the damper took.
    assert float(bar.dissipated()) == pytest.approx(0.5 * RATIO * LENGTH * RIGIDITY * 0.01**2, rel=1e-12)


def test_work_is_stored_or_taken_by_the_dampers(bar: Robot) -> None:
    """Over two cycles of the load, at whose ends it is zero: what is stored is then all of the energy."""
    time = np.linspace(0.0, 4.0, 4001)
    pull = 2 * np.sin(np.pi * time)
    found = drive([bar], np.stack([pull, time], axis=1))
    assert found.converged.all()
    dissipated = np.array([bar.with_memories((row,)).dissipated() for row in found.history[0][0, ::200]])
    assert (np.diff(dissipated) > 0).all()
    work = np.sum(0.5 * (pull[1:] + pull[:-1]) * LENGTH * np.diff(found.q[0, :, 0]))
    assert work == pytest.approx(dissipated[-1] + found.energy[0, -1], rel=1e-6)


def test_a_mass_on_a_viscoelastic_bar_swings_by_its_three_rates(bar: Robot) -> None:
    """d(ε, ε′, h)/dt is linear; errors fall at second order with the step, and steps keep the tolerance."""
    stiffness = RIGIDITY / (LENGTH * MASS)
    rates = np.array([[0.0, 1.0, 0.0], [-stiffness, 0.0, -RATIO * stiffness], [0.0, 1.0, -1 / 0.02]])
    fast = Robot(bar.bodies, (bar.terms[0], relaxation("bar", [0.3, SHARE - 0.3], [0.02, 0.02], 1, bar)))
    time = np.linspace(0.0, 0.1, 3)
    loads = np.stack([0 * time, time], axis=1)
    exact = [(expm(t * rates) @ [0.01, 0.0, 0.01])[0] for t in time]
    errors = []
    for options in (MotionOptions(1e-10, step=2e-4), MotionOptions(1e-10, step=1e-4), MotionOptions(1e-8)):
        found = evolve([fast], time, loads, q=np.array([[0.01]]), options=options)
        errors.append(np.abs(found.q[0, :, 0] - exact).max())
        total = (found.kinetic + found.potential + found.dissipated)[0]
        np.testing.assert_allclose(total, total[0], rtol=1e-3)
        assert (np.diff(found.dissipated[0]) > 0).all()
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)
    assert errors[1] < 1e-7
    assert LENGTH * errors[2] < found.steps[0, -1] * 1e-8


@pytest.mark.parametrize(
    ("share", "time", "message"),
    [
        ([0.5, 0.5], [1.0, 2.0], "share"),
        ([], [], "share"),
        ([0.1], [0.0], "time"),
        ([0.1], [1.0, 2.0], "time"),
    ],
)
def test_shares_and_times_that_make_no_solid_are_named(
    bar: Robot, share: list[float], time: list[float], message: str
) -> None:
    with pytest.raises(InputError, match=f"relaxation, {message}: expected"):
        relaxation("bar", share, time, 0, bar)


def test_time_that_runs_backward_or_not_as_the_motion_does_is_named(bar: Robot) -> None:
    with pytest.raises(InputError, match=r"channel 1 holds the time \[s\]; expected it never to fall"):
        drive([bar], np.array([[0.0, 1.0], [0.0, 0.5]]))
    with pytest.raises(InputError, match=r"channel 1 holds the time \[s\]; expected it to run as `times`"):
        evolve([bar], np.array([0.0, 1.0]), np.zeros((2, 2)))
