"""The pressure line on a uniform rod, where stretch and curvature are constant and known exactly.

Its energy per length is ½ EA ε² + ½ EI κ² − u (1 + ε + κ_y d_z − κ_z d_y): a line at a constant offset d has
exactly that stretch. So ε = u/EA and EI κ = u · offset, at any load.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from exosight.mechanics import Circular, Gauss, NodalQuadratic, PressureLine, Robot, Rod

LENGTH, RADIUS, YOUNG = 0.1, 0.005, 3e5
AREA, MOMENT = np.pi * RADIUS**2, np.pi * RADIUS**4 / 4
POINTS = Gauss(2, 3)


def actuated(offset: tuple[float, float], slope: tuple[float, float] = (0.0, 0.0)) -> Robot:
    """A rod that bends both ways and stretches, with a line at (y, z) = offset [m] at the base."""
    bases = {name: NodalQuadratic(2) for name in ("bend_y", "bend_z", "stretch_x")}
    rod = Rod(
        "rod", LENGTH, Circular(jnp.full(POINTS.size, RADIUS)), young=YOUNG, strains=bases, quadrature=POINTS
    )
    d_prime = np.tile([0.0, *slope], (POINTS.size, 1))
    d = np.array([0.0, *offset]) + d_prime * LENGTH * POINTS.points[:, None]
    return Robot((rod,), (PressureLine("rod", 0, jnp.asarray(d), jnp.asarray(d_prime)),))


def uniform(offset: tuple[float, float], u: float) -> tuple[float, float, float]:
    """κ_y, κ_z [1/m] and ε [-] of the closed form."""
    return u * offset[1] / (YOUNG * MOMENT), -u * offset[0] / (YOUNG * MOMENT), u / (YOUNG * AREA)


def coordinates(offset: tuple[float, float], u: float) -> np.ndarray:
    """The closed form in nodes: angular strains times the length, then the stretch."""
    kappa_y, kappa_z, epsilon = uniform(offset, u)
    return np.repeat([kappa_y * LENGTH, kappa_z * LENGTH, epsilon], 5)


@pytest.mark.parametrize("u", [2.0, -1.0])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.0, 0.005), (0.003, -0.004), (0.005, 0.0)])
def test_constant_stretch_and_curvature_are_the_equilibrium(
    evaluate: Callable, offset: tuple[float, float], u: float
) -> None:
    here, _ = evaluate(actuated(offset), coordinates(offset, u), np.array([u]))
    # Against the force of the line itself, u · ∂ℓ/∂q, at most u · L.
    np.testing.assert_allclose(here.gradient, 0.0, atol=1e-14 * abs(u))
    assert np.linalg.eigvalsh(here.hessian).min() > 0


@pytest.mark.parametrize("u", [2.0, -1.0])
def test_the_line_is_as_long_as_its_stretch(evaluate: Callable, u: float) -> None:
    offset = (0.003, -0.004)
    kappa_y, kappa_z, epsilon = uniform(offset, u)
    here, _ = evaluate(actuated(offset), coordinates(offset, u), np.array([u]))
    length = LENGTH * (1 + epsilon + kappa_y * offset[1] - kappa_z * offset[0])
    assert float(here.load_energy[0]) == pytest.approx(-length, rel=1e-13)


def test_a_slanted_line_on_the_straight_rod(evaluate: Callable) -> None:
    """A line that closes in on the axis is the hypotenuse."""
    here, _ = evaluate(actuated((0.0, 0.005), (0.0, -0.03)), np.zeros(15), np.array([1.0]))
    assert float(here.energy) == pytest.approx(-LENGTH * np.hypot(1.0, 0.03), rel=1e-14)


def test_pushing_bends_away_from_the_line(evaluate: Callable) -> None:
    """The tip runs on a circle away from the line: x = (1 + ε) sin κL / κ, z = −(1 + ε)(1 − cos κL)/κ."""
    offset, u = (0.0, 0.005), 1.0
    _, motion = evaluate(actuated(offset), coordinates(offset, u), np.array([u]))
    kappa, _, epsilon = uniform(offset, u)
    assert kappa * LENGTH == pytest.approx(3.4, rel=0.01)  # bent through more than half a turn
    x, z = np.sin(kappa * LENGTH) / kappa, -(1 - np.cos(kappa * LENGTH)) / kappa
    np.testing.assert_allclose(motion.position[-1], (1 + epsilon) * np.array([x, 0.0, z]), atol=1e-14)


def test_pulling_bends_towards_the_line(evaluate: Callable) -> None:
    offset, u = (0.0, 0.005), -0.3
    _, motion = evaluate(actuated(offset), coordinates(offset, u), np.array([u]))
    assert float(motion.position[-1, 2]) > 0.01
