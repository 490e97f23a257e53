"""Sections: closed forms against integrals over the area, and rods that show what their sections are."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    DeadForce,
    Elliptic,
    Gauss,
    Gaussian,
    Gravity,
    Legendre,
    Link,
    Rectangular,
    Robot,
    Rod,
    Section,
    drive,
)
from exosight.mechanics.rod import STRAIGHT

SIZES = st.floats(1e-4, 0.1)
quickly = settings(deadline=None, max_examples=30)


def one(number: float) -> np.ndarray:
    return np.array([number])


def numbers(section: Section) -> np.ndarray:
    """Area, I_y, I_z and J of a section at one point."""
    return np.array([section.area(), *section.moments(), section.torsion()])[:, 0]


def test_stiffness_of_a_round_bar() -> None:
    """(G·2I, E·I, E·I, E·A, G·A, G·A) with A = πr², I = πr⁴/4, G = E/2(1 + ν)."""
    r, young, poisson = 0.01, 1e6, 0.25
    area, moment, shear = np.pi * r**2, np.pi * r**4 / 4, young / 2.5
    expected = [2 * shear * moment, *[young * moment] * 2, young * area, *[shear * area] * 2]
    section = Circular(one(r))
    np.testing.assert_allclose(
        section.stiffness(jnp.array(young), jnp.array(poisson))[0], expected, rtol=1e-14
    )
    np.testing.assert_allclose(section.rotary()[0], [2 * moment, moment, moment], rtol=1e-14)


@quickly
@given(SIZES)
def test_an_ellipse_with_equal_axes_is_a_circle(radius: float) -> None:
    ellipse = Elliptic(one(radius), one(radius))
    np.testing.assert_allclose(numbers(ellipse), numbers(Circular(one(radius))), rtol=1e-13)


@quickly
@given(SIZES, SIZES)
def test_moments_are_integrals_over_the_area(y: float, z: float) -> None:
    """∫ dA, ∫ z² dA and ∫ y² dA by Gauss's rule over strips of z, which is exact up to degree 2·64 − 1."""
    t, w = np.polynomial.legendre.leggauss(64)
    # Half width of the ellipse at height z·sin φ, of the rectangle at any: strips z cos φ dφ are smooth.
    phi = np.pi / 2 * t
    strips = (
        (Elliptic(one(y), one(z)), z * np.sin(phi), y * np.cos(phi), z * np.cos(phi) * np.pi / 2 * w),
        (Rectangular(one(2 * y), one(2 * z)), z * t, np.full(64, y), z * w),
    )
    for section, height, half, thickness in strips:
        area = np.sum(2 * half * thickness)
        about_y, about_z = np.sum(2 * half * height**2 * thickness), np.sum(2 / 3 * half**3 * thickness)
        np.testing.assert_allclose(numbers(section)[:3], [area, about_y, about_z], rtol=1e-12)


@quickly
@given(SIZES, SIZES)
def test_turning_a_section_by_a_quarter_swaps_its_moments(y: float, z: float) -> None:
    for family in (Elliptic, Rectangular):
        upright, flat = numbers(family(one(y), one(z))), numbers(family(one(z), one(y)))
        np.testing.assert_allclose(flat, upright[[0, 2, 1, 3]], rtol=1e-13)


@pytest.mark.parametrize(
    ("ratio", "factor"),
    [(1.0, 0.1406), (1.5, 0.1958), (2.0, 0.2287), (4.0, 0.2808), (10.0, 0.3123)],
)
def test_torsion_constant_of_rectangles_is_the_published_one(ratio: float, factor: float) -> None:
    """J/ab³. Source: Roark's Formulas for Stress and Strain (and any handbook), to four digits."""
    found = Rectangular(one(ratio * 0.01), one(0.01)).torsion()[0] / (ratio * 0.01**4)
    assert float(found) == pytest.approx(factor, abs=6e-5)


@quickly
@given(SIZES, st.floats(1.0, 50.0))
def test_torsion_constant_of_a_rectangle_is_its_whole_series(side: float, ratio: float) -> None:
    """500 terms of it: what is left then is below 1e-13 of the sum."""
    n = np.arange(1, 1001, 2)
    series = 64 / np.pi**5 / ratio * np.sum(np.tanh(n * np.pi * ratio / 2) / n**5)
    found = Rectangular(one(ratio * side), one(side)).torsion()[0]
    assert float(found) == pytest.approx(ratio * side**4 * (1 / 3 - series), rel=1e-11)


def test_torsion_constant_of_a_thin_strip_is_a_third_of_ab3() -> None:
    """1 − 0.63 b/a of it, to the next order."""
    found = Rectangular(one(0.001), one(1.0)).torsion()[0]
    assert float(found) == pytest.approx(1e-9 / 3 * (1 - 0.63025e-3), rel=1e-8)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda: Circular(one(0.0)),
            "Circular radius: expected finite numbers above 0 m, one a point, got 0",
        ),
        (lambda: Circular(one(np.nan)), "Circular radius: expected finite numbers above 0 m"),
        (lambda: Elliptic(one(1.0), one(-1.0)), "Elliptic semi_z: expected .* got -1"),
        (lambda: Rectangular(one(np.inf), one(1.0)), "Rectangular width: expected finite"),
    ],
)
def test_impossible_sections_are_refused(make: Callable, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()


# Rods that turn and bend: one structure, whatever their section's sizes and natural strain.
LENGTH, YOUNG = 0.2, 1e6
POINTS = Gauss(2, 5)
ANGULAR = ("torsion_x", "bend_y", "bend_z")


def beam(
    section: Section | None = None, natural: Callable | None = None, pull: tuple = (0.0, 0.0, 0.0)
) -> Robot:
    """A cantilever with a dead force [N] at its tip."""
    flat = Rectangular(np.full(POINTS.size, 0.02), np.full(POINTS.size, 0.005))
    rod = Rod(
        "rod",
        LENGTH,
        section or flat,
        young=YOUNG,
        poisson=0.3,
        strains={name: Legendre(3) for name in ANGULAR},
        quadrature=POINTS,
        natural=natural,
    )
    return Robot((rod,), (DeadForce("rod", -1, 0, jnp.array(pull)),))


def test_a_flat_rod_bends_differently_about_its_two_axes(evaluate: Callable) -> None:
    """P L³/3EI either way: 20 mm by 5 mm bends sixteen times as easily about y as about z."""
    about_y, about_z = 0.02 * 0.005**3 / 12, 0.02**3 * 0.005 / 12
    force = np.array([1e-4 * YOUNG * about_y / LENGTH**2])
    for axis, moment in ((2, about_y), (1, about_z)):
        robot = beam(pull=tuple(np.eye(3)[axis]))
        q = np.zeros(robot.dofs)
        for _ in range(3):
            here = evaluate(robot, q, force)[0]
            q = q - np.linalg.solve(here.hessian, here.gradient)
        deflection = np.eye(3)[axis] * force * LENGTH**3 / (3 * YOUNG * moment)
        tip = np.asarray(evaluate(robot, q, force)[1].position[-1])
        # What Euler and Bernoulli leave out is of relative order (P L²/EI)², 1e-8.
        np.testing.assert_allclose(tip[1:], deflection[1:], atol=1e-7 * deflection.max())


def constant(*angular: float) -> Callable:
    """A natural strain that turns alike everywhere [1/m]."""
    return lambda x: np.tile(STRAIGHT + np.array([*angular, 0, 0, 0]), (len(x), 1))


def matrix(twist: np.ndarray) -> np.ndarray:
    """The 4×4 matrix of a twist."""
    (a, b, c), v = twist[:3], twist[3:]
    return np.array([[0, -c, b, v[0]], [c, 0, -a, v[1]], [-b, a, 0, v[2]], [0, 0, 0, 0]])


def test_a_curved_rod_at_rest_is_a_circular_arc(evaluate: Callable) -> None:
    """Radius 1/κ, no energy, no force; made straight it stores ½ EI κ² L."""
    curvature = 12.0  # two fifths of a full turn
    robot, none = beam(natural=constant(0, curvature, 0)), np.zeros(1)
    rest, motion = evaluate(robot, np.zeros(robot.dofs), none)
    s = LENGTH * POINTS.points
    arc = np.stack([np.sin(curvature * s), 0 * s, np.cos(curvature * s) - 1], axis=1) / curvature
    np.testing.assert_allclose(motion.position, arc, atol=1e-14)
    assert float(rest.energy) == 0
    np.testing.assert_array_equal(rest.gradient, 0.0)

    straight = np.zeros(robot.dofs)
    straight[4] = -curvature * LENGTH  # the constant of bend_y
    there, motion = evaluate(robot, straight, none)
    np.testing.assert_allclose(motion.position[-1], [LENGTH, 0, 0], atol=1e-14)
    stored = 0.5 * YOUNG * 0.02 * 0.005**3 / 12 * curvature**2 * LENGTH
    assert float(there.energy) == pytest.approx(stored, rel=1e-12)


def test_a_rod_with_natural_twist_and_curvature_is_a_helix(evaluate: Callable) -> None:
    """Of radius κ/(κ² + τ²) about an axis along the strain, rising by τ/√(κ² + τ²) of its length."""
    twist, curvature = 20.0, 30.0
    robot = beam(natural=constant(twist, 0, curvature))
    rest, motion = evaluate(robot, np.zeros(robot.dofs), np.zeros(1))
    strain = constant(twist, 0, curvature)(np.zeros(1))[0]
    poses = [expm(s * matrix(strain)) for s in LENGTH * POINTS.points]
    np.testing.assert_allclose(motion.pose, poses, atol=1e-13)
    assert float(rest.energy) == 0
    total = np.hypot(twist, curvature)
    axis, centre = np.array([twist, 0, curvature]) / total, np.array([0, curvature, 0]) / total**2
    position = np.asarray(motion.position)
    np.testing.assert_allclose(position @ axis, LENGTH * POINTS.points * twist / total, atol=1e-14)
    np.testing.assert_allclose(
        np.linalg.norm(np.cross(axis, position - centre), axis=1), curvature / total**2, atol=1e-14
    )


def test_derivatives_of_a_curved_rod_match_differences(evaluate: Callable) -> None:
    """Natural strain that varies along the rod, bent out of it, with a force at its tip."""
    robot = beam(
        natural=lambda x: STRAIGHT + np.outer(np.sin(3 * x), [9.0, -14.0, 5.0, 0, 0, 0]),
        pull=(1.0, 2.0, -3.0),
    )
    q, load, step = np.random.default_rng(4).normal(size=robot.dofs), np.array([0.05]), 1e-6
    here = evaluate(robot, q, load)[0]
    for k, unit in enumerate(step * np.eye(robot.dofs)):
        ahead, behind = (evaluate(robot, q + s * unit, load)[0] for s in (1, -1))
        force = (ahead.energy - behind.energy) / (2 * step)
        np.testing.assert_allclose(here.gradient[k], force, atol=1e-9)  # round-off of 1e-16 J over the step
        change = (ahead.gradient - behind.gradient) / (2 * step)
        # Steps turn by up to half a radian here, where the Hessian leaves out 1e-5 of the wrenches.
        np.testing.assert_allclose(here.hessian[k], change, atol=1e-5 * np.abs(here.hessian).max())


class Strap(Section):
    """A user's own section: a strap that resists bending about y and turning, not bending about z."""

    bending: jnp.ndarray

    def area(self) -> jnp.ndarray:
        return 1e-4 * jnp.ones_like(self.bending)

    def moments(self) -> tuple[jnp.ndarray, jnp.ndarray]:
        return self.bending, jnp.zeros_like(self.bending)

    def torsion(self) -> jnp.ndarray:
        return self.bending


def test_a_rod_without_stiffness_in_one_direction_needs_a_load_that_holds_it() -> None:
    """A hanging strap is held straight by its weight; without gravity nothing holds it, and it says so."""

    def strap(gravity: float) -> Robot:
        rod = Rod(
            "rod",
            LENGTH,
            Strap(jnp.full(POINTS.size, 1e-10)),
            young=YOUNG,
            density=1000.0,
            strains={"bend_y": Legendre(1), "bend_z": Legendre(1)},
            quadrature=POINTS,
        )
        return Robot((rod,), (Gravity(jnp.array([gravity, 0.0, 0.0])),))

    found = drive([strap(9.81), strap(0.0)], np.zeros((1, 1)))
    assert all(np.all(np.isfinite(getattr(found, name))) for name in ("q", "energy", "min_eigenvalue"))
    np.testing.assert_allclose(found.q, 0.0, atol=1e-12)  # it left the saddle and came back
    np.testing.assert_array_equal(found.converged[:, 0], [True, False])
    assert found.min_eigenvalue[0, 0] > 0
    assert found.min_eigenvalue[1, 0] == pytest.approx(0, abs=1e-12)


def test_bumps_that_overlap_as_much_as_is_allowed_still_bend_right() -> None:
    """½ P² L³/3EI is stored under a small force: from K⁻¹, of condition 1e9 here."""
    section = Circular(np.full(POINTS.size, 0.005))
    rod = Rod("rod", LENGTH, section, young=YOUNG, strains={"bend_y": Gaussian(6, 0.3)}, quadrature=POINTS)
    stiffness = np.asarray(rod.stiffness())
    # A force of 1 N bends by the moment L (1 − X): its work on each bump is ∫ (1 − X) φ dX · L.
    work = LENGTH * POINTS.weights @ ((1 - POINTS.points)[:, None] * Gaussian(6, 0.3).evaluate(POINTS.points))
    stored = 0.5 * work @ np.linalg.solve(stiffness, work)
    exact = 0.5 * LENGTH**3 / (3 * YOUNG * np.pi * 0.005**4 / 4)
    assert stored == pytest.approx(exact, rel=1e-4)


def test_a_body_keeps_its_numbers_whatever_becomes_of_the_arrays_given() -> None:
    radius, mass, inertia = np.full(4, 0.01), np.ones(1), np.eye(3)[None]
    section = Circular(radius)
    link = Link("link", 0.1, np.zeros((1, 3)), mass=mass, inertia=inertia)
    for array in (radius, mass, inertia):
        array *= 2
    np.testing.assert_array_equal(section.radius, 0.01)
    np.testing.assert_array_equal(link.mass, 1)
    np.testing.assert_array_equal(link.inertia[0], np.eye(3))
