"""Bushings: energy, tangent, and loops that they close against the same loops without them."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from backends import check
from scipy.integrate import solve_bvp
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from exosight import lie
from exosight.errors import InputError
from exosight.mechanics import (
    Bushing,
    Circular,
    DeadForce,
    Gauss,
    JointTorque,
    Link,
    NodalQuadratic,
    Revolute,
    Robot,
    Rod,
    drive,
    potential,
)

STIFF = np.array([0.3, 0.5, 0.2, 40.0, 90.0, 60.0])


@pytest.fixture(scope="module")
def joined(tree: Robot) -> Robot:
    """The tree with a bushing between two of its branches, and nothing else on it."""
    rest = lie.exp(jnp.array([0.2, -0.4, 0.3, 0.05, -0.02, 0.03]))
    return Robot(tree.bodies, (Bushing(("lower", 1), ("branch", 3), STIFF, rest),))


def test_energy_is_that_of_turn_and_shift_from_rest(
    joined: Robot, tree_pose: tuple, evaluate: Callable
) -> None:
    """With θ n the turn from rest, and d the shift seen along half of it: ½ Σ k e²."""
    q = tree_pose[0]
    here, motion = evaluate(joined, q, np.zeros(0))
    free, _ = evaluate(
        Robot(joined.bodies, (Bushing(("lower", 1), ("branch", 3), np.zeros(6)),)), q, np.zeros(0)
    )
    pose = np.asarray(motion.pose)
    rest = np.asarray(joined.terms[0].rest)
    moved = np.linalg.inv(pose[joined.frame("lower", 1)] @ rest) @ pose[joined.frame("branch", 3)]
    turn = Rotation.from_matrix(moved[:3, :3]).as_rotvec()
    # V = ∫₀¹ exp(s θ n) ds, by Gauss's rule: exact to 1e-15 for turns below π.
    nodes, weights = np.polynomial.legendre.leggauss(20)
    v = sum(
        w / 2 * Rotation.from_rotvec((s + 1) / 2 * turn).as_matrix()
        for s, w in zip(nodes, weights, strict=True)
    )
    gap = np.concatenate([turn, np.linalg.solve(v, moved[:3, 3])])
    assert np.linalg.norm(turn) > 0.3
    assert float(here.energy - free.energy) == pytest.approx(0.5 * STIFF @ gap**2, rel=1e-12)


def test_derivatives_match_differences(joined: Robot, tree_pose: tuple, evaluate: Callable) -> None:
    q, step, none = tree_pose[0], 1e-6, np.zeros(0)
    here, _ = evaluate(joined, q, none)
    around = [[evaluate(joined, q + s * e, none)[0] for s in (1, -1)] for e in step * np.eye(joined.dofs)]
    by_energy = np.array([(a.energy - b.energy) / (2 * step) for a, b in around])
    by_gradient = np.array([(a.gradient - b.gradient) / (2 * step) for a, b in around])
    # Round-off 1e-16·Π/h and the square of the step, as for the other energies of the tree.
    np.testing.assert_allclose(here.gradient, by_energy, atol=1e-8)
    np.testing.assert_allclose(here.hessian, by_gradient, atol=1e-8)


def test_has_a_program_that_agrees_with_xla(joined: Robot) -> None:
    check(joined)


# A four-bar linkage: crank, coupler and rocker on the ground line of length GROUND [m]; angles from it.
GROUND, CRANK, COUPLER, ROCKER = 0.1, 0.04, 0.09, 0.07
SPRINGS = 0.5, 0.3
"""Of the crank and the rocker against their angles at rest [N m/rad]."""
AT_REST = 1.0


def other_angles(crank: float) -> tuple[float, float]:
    """Coupler's and rocker's angle at a crank's: where two circles meet, above the ground."""
    tip = CRANK * np.array([np.cos(crank), np.sin(crank)])
    across = np.array([GROUND, 0.0]) - tip
    d = np.linalg.norm(across)
    along = (COUPLER**2 - ROCKER**2 + d**2) / (2 * d)
    up = np.array([-across[1], across[0]]) / d
    meeting = tip + along * across / d + np.sqrt(COUPLER**2 - along**2) * up
    coupler, rocker = meeting - tip, meeting - [GROUND, 0.0]
    return np.arctan2(coupler[1], coupler[0]), np.arctan2(rocker[1], rocker[0])


def four_bar(stiffness: float) -> Robot:
    """In the x–z plane; hinges about −y, so that angles count from x towards z."""
    coupler, rocker = other_angles(AT_REST)
    hinge = {"axis": (0.0, -1.0, 0.0)}

    def turned(angle: float, x: float = 0.0) -> np.ndarray:
        return lie.translation(jnp.array([x, 0.0, 0.0])) @ lie.exp(
            jnp.array([0.0, -angle, 0.0, 0.0, 0.0, 0.0])
        )

    def end(length: float) -> np.ndarray:
        return np.array([[length, 0.0, 0.0]])

    bodies = (
        Link(
            "crank", CRANK, end(CRANK), mount=turned(AT_REST), joint=Revolute(stiffness=SPRINGS[0], **hinge)
        ),
        Link(
            "coupler",
            COUPLER,
            end(COUPLER),
            parent="crank",
            mount=turned(coupler - AT_REST),
            joint=Revolute(**hinge),
        ),
        Link(
            "rocker",
            ROCKER,
            end(ROCKER),
            mount=turned(rocker, GROUND),
            joint=Revolute(stiffness=SPRINGS[1], **hinge),
        ),
    )
    pin = Bushing(
        ("coupler", 0),
        ("rocker", 0),
        np.array([1.0, 0.0, 1.0, stiffness, stiffness, stiffness]),
        lie.exp(jnp.array([0.0, coupler - rocker, 0.0, 0.0, 0.0, 0.0])),
    )
    return Robot(bodies, (pin, JointTorque("crank", 0)))


@pytest.mark.parametrize("torque", [0.6, -0.4])
def test_four_bar_linkage_closes_as_its_stiffness(torque: float) -> None:
    """A motor turns the crank against springs on crank and rocker: ½ k₁ φ² + ½ k₂ ψ(φ)² − u φ, one angle.

    ψ(φ) in closed form. The gap, and with it the error of every angle, is the loop's force over stiffness.
    """
    rest = other_angles(AT_REST)

    def turns(crank: float) -> np.ndarray:
        coupler, rocker = other_angles(AT_REST + crank)
        return np.array([crank, coupler - rest[0] - crank, rocker - rest[1]])

    def energy(crank: float) -> float:
        return 0.5 * SPRINGS[0] * crank**2 + 0.5 * SPRINGS[1] * turns(crank)[2] ** 2 - torque * crank

    exact = turns(minimize_scalar(energy, bracket=(-0.1, 0.1), tol=1e-12).x)
    stiffnesses = np.array([1e3, 1e4, 1e5, 1e6])
    found = drive([four_bar(k) for k in stiffnesses], np.array([[torque / 2], [torque]]))
    assert found.converged.all()
    assert abs(exact[0]) > 0.4
    errors = np.abs(found.q[:, -1] - exact).max(axis=1)
    assert errors[-1] < 1e-4
    # Ten times stiffer, a tenth of the error; at 1e3 N/m terms of second order still show.
    np.testing.assert_allclose(errors[:-1] / errors[1:], 10.0, rtol=0.1)


LENGTH, RADIUS, YOUNG = 0.1, 0.01, 3e5
AREA, MOMENT = np.pi * RADIUS**2, np.pi * RADIUS**4 / 4
UNIT = YOUNG * MOMENT / LENGTH**2
"""EI/L² [N]."""


def both_ends_clamped() -> Robot:
    """Two rods face each other from clamps 2 L apart; their joined tips are pushed across, u EI/L² each."""
    points = Gauss(4, 3, element_ends=True)
    half_turn = lie.exp(jnp.array([0.0, 0.0, np.pi, 0.0, 0.0, 0.0]))
    mounts = {"left": jnp.eye(4), "right": lie.translation(jnp.array([2 * LENGTH, 0.0, 0.0])) @ half_turn}
    bases = dict.fromkeys(("bend_y", "stretch_x"), NodalQuadratic(4))
    rods = tuple(
        Rod(
            name,
            LENGTH,
            Circular(jnp.full(points.size, RADIUS)),
            young=YOUNG,
            strains=bases,
            quadrature=points,
            mount=mount,
        )
        for name, mount in mounts.items()
    )
    weld = Bushing(("left", -1), ("right", -1), np.array([200.0] * 3 + [1e6] * 3), half_turn)
    push = DeadForce("left", -1, 0, 2 * UNIT * jnp.array([0.0, 0.0, 1.0]))
    return Robot(rods, (weld, push))


def guided(alpha: float) -> float:
    """Rise of the tip, over L, of one half: its tip stays level at x = L and is pushed by α EI/L² across.

    With lengths in L and forces in EI/L²: φ′ = κ, κ′ = (1 + ε)(N sin φ − α cos φ), x′ = (1 + ε) cos φ,
    z′ = (1 + ε) sin φ and ε = (N cos φ + α sin φ) EI/EAL²; the tension N is unknown.
    """
    slender = MOMENT / (AREA * LENGTH**2)

    def slope(_: np.ndarray, state: np.ndarray, tension: np.ndarray) -> np.ndarray:
        kappa, c, s = state[1], np.cos(state[0]), np.sin(state[0])
        stretch = 1 + slender * (tension * c + alpha * s)
        return np.stack([kappa, stretch * (tension * s - alpha * c), stretch * c, stretch * s])

    def ends(base: np.ndarray, tip: np.ndarray, _: np.ndarray) -> np.ndarray:
        return np.array([base[0], base[2], base[3], tip[0], tip[2] - 1])

    x = np.linspace(0, 1, 50)
    found = solve_bvp(slope, ends, x, np.stack([0 * x, 0 * x, x, 0 * x]), p=[0.0], tol=1e-6)
    assert found.success, found.message
    return found.y[3, -1]


def test_two_rods_joined_at_their_tips_are_a_clamped_beam(motion: Callable) -> None:
    """Against one half, guided at the middle: P L³/12EI for small forces, an elastica for large ones."""
    robot = both_ends_clamped()
    loads = [1e-3, 5.0, 20.0]
    found = drive([robot], np.array(loads)[:, None])
    assert found.converged.all()
    rise = np.array([motion(robot, q)["left"].pose[-1, 2, 3] for q in found.q[0]]) / LENGTH
    assert rise[-1] > 0.3
    # A weld of 1e6 N/m and 200 N m/rad holds to 1e-3 and 1e-4 of what EA/L and EI/L of the halves do.
    np.testing.assert_allclose(rise, [guided(alpha) for alpha in loads], rtol=1e-3)
    assert rise[0] == pytest.approx(loads[0] / 12, rel=1e-3)


@pytest.mark.parametrize("stiffness", [np.full(6, -1.0), np.full(6, np.inf)])
def test_an_impossible_stiffness_is_refused(stiffness: np.ndarray) -> None:
    with pytest.raises(InputError, match="6 finite numbers of at least 0"):
        Bushing(("a", 0), ("b", 0), stiffness)


def test_a_frame_is_not_joined_to_itself(tree: Robot) -> None:
    with pytest.raises(InputError, match="two frames"):
        potential(Robot(tree.bodies, (Bushing(("upper", 1), ("upper", -1), np.ones(6)),)))
