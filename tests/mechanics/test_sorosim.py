"""Static solutions of SoRoSim on the same points, weights and bases (see tests/reference/README.md).

SoRoSim's exponential is a truncated series below 0.01 rad, which moves a tip by up to 4e-9 m; coordinates are
of order one. So both must agree to SAME, and a solution of the continuous rod only to the errors of its mesh.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from exosight import lie
from exosight.mechanics import (
    Circular,
    DeadForce,
    Gauss,
    Gravity,
    Legendre,
    Link,
    NodalQuadratic,
    PointWrench,
    PressureLine,
    Revolute,
    Robot,
    Rod,
    SphereContact,
    drive,
)
from exosight.mechanics.contact import Spheres
from exosight.mechanics.rod import STRAINS

SAME = 1e-8
"""Agreement on the same discretisation: positions [m], coordinates [rad] or [-]."""

FEM = Gauss(5, 3, element_ends=True)
UP = jnp.array([0.0, 0.0, 1.0])


def planar_rod(of: dict, points: Gauss, basis: Any, radius: jnp.ndarray, height: float = 0.0) -> Rod:
    np.testing.assert_allclose(points.points, of["points"], atol=1e-15)
    return Rod(
        "rod",
        of["length"],
        Circular(radius),
        young=float(of["young"]),
        strains={"bend_y": basis, "stretch_x": basis},
        quadrature=points,
        mount=lie.translation(height * UP),
    )


def taper(of: dict) -> jnp.ndarray:
    return jnp.asarray(of["r_base"] + (of["r_tip"] - of["r_base"]) * FEM.points)


def surface_line(of: dict) -> PressureLine:
    """Along the upper surface of the tapered rod."""
    slope = (of["r_tip"] - of["r_base"]) / of["length"]
    return PressureLine("rod", 0, taper(of)[:, None] * UP, jnp.tile(slope * UP, (FEM.size, 1)))


def links(
    lengths: list[float], stiffness: list[float], sites: Callable[[float], list[float]]
) -> tuple[Link, ...]:
    """Links on hinges about y, from the origin along x, with sites along them."""
    chain = []
    for i, (length, spring) in enumerate(zip(lengths, stiffness, strict=True)):
        at = jnp.array([[x, 0.0, 0.0] for x in sites(length)])
        parent = f"link_{i - 1}" if i else None
        chain.append(Link(f"link_{i}", length, at, parent=parent, joint=Revolute(stiffness=spring)))
    return tuple(chain)


def newton_step(
    evaluate: Callable, robot: Robot, q: list[float], load: list[float]
) -> tuple[np.ndarray, Any]:
    """How far the nearest minimum of our energy is from q, to first order, and the motion at q.

    A minimum it is: the Hessian has a Cholesky factor.
    """
    here, motion = evaluate(robot, np.array(q), np.array(load, dtype=float))
    np.linalg.cholesky(here.hessian)
    return -np.linalg.solve(here.hessian, here.gradient), motion


def exact_tip(length: float, young: float, radius: float, force: float) -> np.ndarray:
    """x, z of the tip of the extensible elastica under a transverse dead force.

    The axis rises at φ and stretches by 1 + ε, EA ε = P sin φ; EI φ″ = −(1 + ε) P cos φ, φ(0) = 0, φ′(L) = 0.
    Integrated from the tip, whose slope is the unknown.
    """
    area = np.pi * radius**2

    def slope(_: float, state: np.ndarray) -> list[float]:
        phi, curvature = state[:2]
        stretch = 1 + force * np.sin(phi) / (young * area)
        bend = -stretch * force * np.cos(phi) / (young * area * radius**2 / 4)
        return [curvature, bend, stretch * np.cos(phi), stretch * np.sin(phi)]

    def base(tip_slope: float) -> np.ndarray:
        start = [tip_slope, 0.0, 0.0, 0.0]
        return solve_ivp(slope, (length, 0), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]

    return -base(brentq(lambda tip_slope: base(tip_slope)[0], 1e-6, np.pi / 2 - 1e-6, xtol=1e-12))[2:]


@pytest.mark.parametrize(
    ("name", "points", "basis", "mesh"),
    [
        ("sorosim_cantilever_nodal", FEM, NodalQuadratic(5), 7e-7),
        ("sorosim_cantilever_legendre", Gauss(1, 6), Legendre(5), 3.1e-5),
    ],
)
def test_cantilever(
    evaluate: Callable, reference: Callable, name: str, points: Gauss, basis: Any, mesh: float
) -> None:
    """Case 1: dead tip forces of up to 11.5 EI/L², where the tip points almost along the force."""
    of = reference(name)
    rod = planar_rod(of, points, basis, jnp.full(points.size, of["radius"]))
    robot = Robot((rod,), (DeadForce("rod", -1, 0, UP),))
    for case in of["cases"]:
        step, motion = newton_step(evaluate, robot, case["q"], [case["tip_force"]])
        np.testing.assert_allclose(step, 0.0, atol=SAME)
        np.testing.assert_allclose(motion.position[:, ::2], case["xz"], atol=SAME)
        np.testing.assert_allclose(motion.pose[-1], case["tip"], atol=SAME)
        exact = exact_tip(of["length"], of["young"], of["radius"], case["tip_force"])
        np.testing.assert_allclose(motion.position[-1, ::2], exact, atol=mesh)


def test_tapered_rod_with_a_line(reference: Callable, motion: Callable) -> None:
    """Case 2, found by following the loads: pushed up to 4 N and pulled down to −2 N, in a few large steps.

    At 4 N the rod is wound up by 26 rad, 1.9 rad from one point to the next.
    """
    of = reference("sorosim_tapered_line")
    robot = Robot((planar_rod(of, FEM, NodalQuadratic(5), taper(of)),), (surface_line(of),))
    loads = np.array([case["u"] for case in of["cases"]])
    # Pushing and pulling each start from rest.
    parts = [drive([robot], part[:, None]) for part in (loads[loads > 0], loads[loads < 0])]
    assert all(part.converged.all() for part in parts)
    for q, case in zip(np.concatenate([part.q[0] for part in parts]), of["cases"], strict=True):
        np.testing.assert_allclose(q, case["q"], rtol=SAME, atol=SAME)
        at = motion(robot, q)
        np.testing.assert_allclose(at.position[:, ::2], case["xz"], atol=SAME)
        np.testing.assert_allclose(at.pose[-1], case["tip"], atol=SAME)
        if "exact_tip_xz" in case:
            assert case["rotation_per_step"] < 0.7
            # The error of this mesh against the ordinary differential equation.
            np.testing.assert_allclose(at.position[-1, ::2], case["exact_tip_xz"], atol=6e-7)


@pytest.mark.parametrize("follower", [False, True])
def test_spatial_cantilever(reference: Callable, motion: Callable, follower: bool) -> None:
    """Case 3: all six strains, weight and a tip wrench without an energy, found from rest in one load."""
    of = reference("sorosim_spatial")
    points = Gauss(1, 6)
    np.testing.assert_allclose(points.points, of["points"], atol=1e-15)
    rod = Rod(
        "rod",
        of["length"],
        Circular(jnp.full(points.size, of["radius"])),
        young=float(of["young"]),
        poisson=of["poisson"],
        density=float(of["density"]),
        strains=dict.fromkeys(STRAINS, Legendre(3)),
        quadrature=points,
    )
    wrench = PointWrench("rod", -1, 0, np.array(of["tip_wrench"]), follower=follower)
    robot = Robot((rod,), (Gravity(jnp.array(of["gravity"], dtype=float)), wrench))
    found = drive([robot], np.array([[1.0]]))
    assert found.converged.all()
    (case,) = (case for case in of["cases"] if case["follower"] == follower)
    np.testing.assert_allclose(found.q[0, 0], case["q"], atol=SAME)
    np.testing.assert_allclose(motion(robot, found.q[0, 0]).pose[:, :3], case["poses"], atol=SAME)


def test_hinged_chain(evaluate: Callable, reference: Callable) -> None:
    """Case 4: three links, tip forces up to 1 N in several directions; no rod, so no truncated series."""
    of = reference("sorosim_chain")
    bodies = links(of["lengths"], of["stiffness"], lambda length: [length / 2, length])
    for case in of["cases"]:
        robot = Robot(bodies, (DeadForce("link_2", 1, 0, jnp.array(case["tip_force"], dtype=float)),))
        step, motion = newton_step(evaluate, robot, case["q"], [1.0])
        np.testing.assert_allclose(step, 0.0, atol=1e-13)
        np.testing.assert_allclose(motion.position[::2, ::2], case["centres_xz"], atol=1e-14)
        np.testing.assert_allclose(motion.pose[-1], case["tip"], atol=1e-14)


def test_contact(evaluate: Callable, reference: Callable) -> None:
    """Case 5: the rod of case 2 pressed onto the chain of case 4 by up to 0.8 N."""
    of = reference("sorosim_contact")
    rod = planar_rod(of, FEM, NodalQuadratic(5), taper(of), of["height"])
    bodies = links(of["link_lengths"], of["joint_stiffness"], lambda length: [length / 2, length])
    on_rod = Spheres(tuple(("rod", i) for i in range(1, FEM.size)), taper(of)[1:])
    on_links = Spheres(tuple((b.name, i) for b in bodies for i in (0, 1)), jnp.full(6, of["sphere_radius"]))
    contact = SphereContact(on_rod, on_links, jnp.array(float(of["contact_stiffness"])))
    robot = Robot((rod, *bodies), (surface_line(of), contact))
    for case in of["cases"]:
        step, motion = newton_step(evaluate, robot, case["q"], [case["u"]])
        np.testing.assert_allclose(step, 0.0, atol=SAME)
        np.testing.assert_allclose(motion.position[: FEM.size, ::2], case["xz"], atol=SAME)
        np.testing.assert_allclose(motion.position[-1, ::2], case["finger_tip_xz"], atol=SAME)
        overlap = np.asarray(contact.pairs(robot, motion.position)[0])
        first, second, depth, *force = case["pair"]
        assert [tuple(pair) for pair in np.argwhere(overlap > 0)] == [(first - 1, second - 1)]
        assert overlap.max() == pytest.approx(depth, abs=SAME)
        # The reference lists what acts on the rod. 1000 N/m times the errors of both positions.
        on_links_now = np.asarray(contact.forces(robot, motion.position)[1])
        np.testing.assert_allclose(on_links_now[int(second) - 1], -np.array(force), atol=1000 * SAME)
