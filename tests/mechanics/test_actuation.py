"""The pressure line on a uniform rod, where stretch and curvature are constant and known exactly.

Its energy per length is ½ EA ε² + ½ EI κ² − u (1 + ε + κ_y d_z − κ_z d_y): a line at a constant offset d has
exactly that stretch. So ε = u/EA and EI κ = u · offset, at any load.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    Gauss,
    Legendre,
    NodalQuadratic,
    PressureLine,
    Robot,
    Rod,
    drive,
    helix,
    straight,
)
from exosight.mechanics.rod import STRAINS

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


FINE = Gauss(2, 8)
TAPER = 0.03


def wound(path: Callable, taper: float = TAPER) -> Robot:
    """A tapered rod with every strain, constant or linear along it, and a line along a path."""
    rod = Rod(
        "rod",
        LENGTH,
        Circular(RADIUS - taper * LENGTH * FINE.points),
        young=YOUNG,
        strains=dict.fromkeys(STRAINS, Legendre(1)),
        quadrature=FINE,
    )
    return Robot((rod,), (PressureLine.along(rod, 0, path),))


def surface(x: jax.Array) -> jax.Array:
    """Radius of the tapered rod [m]."""
    return RADIUS - TAPER * LENGTH * x


LOAD = np.array([2.0])
BENT = np.array([0.6, -0.3, 0.9, 0.5, -0.7, 0.2, 0.1, 0.05, 0.08, -0.04, -0.06, 0.1])
"""Coordinates of `wound` with all strains at work."""


def test_a_straight_path_is_the_line_of_constant_offset() -> None:
    rod = wound(straight(0.003, -0.004))["rod"]
    line = PressureLine.along(rod, 0, straight(0.003, -0.004))
    np.testing.assert_array_equal(line.offset, np.tile([0.0, 0.003, -0.004], (FINE.size, 1)))
    np.testing.assert_array_equal(line.slope, 0.0)


def test_a_path_on_the_surface_closes_in_with_the_taper() -> None:
    """Without turns a helix of the rod's radius stays on one side, and its slope is the taper's."""
    rod = wound(straight(0.0, 0.0))["rod"]
    line = PressureLine.along(rod, 0, helix(surface, phase=np.pi / 2))
    expected = np.outer(rod.section.radius, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(line.offset, expected, atol=1e-18)
    np.testing.assert_allclose(line.slope, np.tile([0.0, 0.0, -TAPER], (FINE.size, 1)), atol=1e-16)


@pytest.mark.parametrize("turns", [0.5, -1.5])
def test_a_helix_on_the_straight_rod_is_as_long_as_unrolled(evaluate: Callable, turns: float) -> None:
    """ℓ = √(L² + (2π r n)²)."""
    here, _ = evaluate(wound(helix(0.004, turns)), np.zeros(12), LOAD)
    length = np.hypot(LENGTH, 2 * np.pi * 0.004 * turns)
    assert float(here.load_energy[0]) == pytest.approx(-length, rel=1e-14)


def test_a_wound_line_is_as_long_as_its_points_are_apart(evaluate: Callable, motion: Callable) -> None:
    """The line on the bent, twisted, stretched and sheared rod against points on it, in the world.

    The polygon through places x_i of the rod's frames is too short by its curvature, so a second rod with
    many points is walked; the length's quadrature of 16 points is what is tested.
    """
    path = helix(surface, 1.5, 0.4)
    here, _ = evaluate(wound(path), BENT, LOAD)
    many = Gauss(100, 8)
    rod = Rod(
        "rod",
        LENGTH,
        Circular(jnp.full(many.size, RADIUS)),
        young=YOUNG,
        strains=dict.fromkeys(STRAINS, Legendre(1)),
        quadrature=many,
    )
    pose = np.asarray(motion(Robot((rod,)), BENT).pose)
    y, z = (np.asarray(part) for part in path(jnp.asarray(many.points)))
    at = np.einsum("pij,pj->pi", pose[:, :3, :3], np.stack([0 * y, y, z], axis=1)) + pose[:, :3, 3]
    length = np.linalg.norm(np.diff(at, axis=0), axis=1).sum()
    # A polygon of 800 chords is short by (κ h)²/24 of it: κ of some 60/m, h up to 2e-4 m.
    assert -float(here.load_energy[0]) == pytest.approx(length, rel=1e-5)
    assert abs(length / LENGTH - 1) > 0.05


def test_derivatives_of_a_wound_line_match_differences(evaluate: Callable) -> None:
    robot, step = wound(helix(surface, 1.5, 0.4)), 1e-6
    here, _ = evaluate(robot, BENT, LOAD)
    around = [[evaluate(robot, BENT + s * e, LOAD)[0] for s in (1, -1)] for e in step * np.eye(12)]
    by_energy = [(a.energy - b.energy) / (2 * step) for a, b in around]
    by_gradient = [(a.gradient - b.gradient) / (2 * step) for a, b in around]
    by_load = [(a.load_energy - b.load_energy) / (2 * step) for a, b in around]
    # Round-off 1e-16·Π/h and the square of the step.
    np.testing.assert_allclose(here.gradient, by_energy, atol=1e-8)
    np.testing.assert_allclose(here.hessian, by_gradient, atol=1e-8)
    np.testing.assert_allclose(here.load_gradient[0], np.array(by_load)[:, 0], atol=1e-9)


@pytest.mark.parametrize("turns", [1.0, -1.0])
def test_a_wound_cable_untwists_itself(turns: float) -> None:
    """Pulling shortens the helix by unwinding it: a right-handed one turns the tip backwards about x.

    To first order in u its moment about the axis is u r sin β with tan β = 2π r n/L, constant along the rod;
    the tip of a uniform one turns by that times L/GJ, at ν = ½ with G = E/3 and J = 2 I.
    """
    u, radius = -1e-4, 0.004
    found = drive([wound(helix(radius, turns), taper=0.0)], np.array([[u], [1000 * u]]))
    assert found.converged.all()
    lead = 2 * np.pi * radius * turns / LENGTH
    twist = u * radius * lead / np.hypot(1.0, lead) * LENGTH / (YOUNG / 3 * 2 * MOMENT)
    assert twist * turns < 0
    # What is left out is of the order of the strains, below 1e-4 here.
    np.testing.assert_allclose(found.q[0, 0, :2], [twist, 0.0], rtol=1e-4, atol=1e-4 * abs(twist))
    assert found.q[0, 1, 0] * turns < 900 * twist * turns  # and so on at a thousand times the tension


def test_a_path_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InputError, match="finite y, z"):
        wound(lambda x: (jnp.sqrt(x - 0.5), x))
