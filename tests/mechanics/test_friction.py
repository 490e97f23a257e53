"""Friction: derivatives, closed forms of stick and slip, and the balance of energy."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from backends import check
from compiled import walk

from exosight import lie
from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    DeadForce,
    Equilibria,
    Gauss,
    Link,
    NodalQuadratic,
    Prismatic,
    Revolute,
    Robot,
    Rod,
    SolverOptions,
    State,
    drive,
)
from exosight.mechanics.friction import SHEAR, Friction, Held, Slip, friction
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.rod import STRAINS
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surfaces import Plane, Solids, Tube
from exosight.mechanics.tree import Tree

MU, STIFFNESS, SPRING = 0.3, 2e4, 10.0
WEAK = 1.0
"""Stiffness that holds the block up where nothing presses it down [N/m]."""


@pytest.fixture(scope="module")
def block() -> Robot:
    """A capsule on a plane, drawn along it (channel 0) against a spring, and pressed on it (channel 1)."""
    site = np.zeros((1, 3))
    slider = Link("slider", 0.0, site, joint=Prismatic((1.0, 0.0, 0.0), stiffness=SPRING))
    up = Prismatic((0.0, 0.0, 1.0), stiffness=WEAK)
    mount = lie.translation(jnp.array([0.0, 0.0, 0.005]))
    capsule = Link("block", 0.03, site, parent="slider", joint=up, mount=mount)
    solids = Solids((("block", 0),), np.array([0.03]), np.array([[0.005, 0.005]]))
    contact = RigidContact(solids, Plane(None, np.zeros(3), np.array([0.0, 0.0, 1.0])), np.array(STIFFNESS))
    bodies = (slider, capsule)
    pulls = (
        DeadForce("block", 0, 0, jnp.array([1.0, 0, 0])),
        DeadForce("block", 0, 1, jnp.array([0, 0, -1.0])),
    )
    return Robot(bodies, (*pulls, contact, friction(contact, MU, Tree(bodies))))


def driven(robot: Robot, loads: list[tuple[float, float]], state: State | None = None) -> Equilibria:
    found = drive([robot], np.array(loads, float), state=state)
    assert found.converged.all()
    return found


def test_a_block_sticks_up_to_mu_n_and_slips_beyond(block: Robot) -> None:
    pulls = [0.0, 0.2, 0.299, 0.35, 0.5, 0.2, -0.05, -0.3]
    x = driven(block, [(pull, 1.0) for pull in pulls]).q[0, :, 0]
    normal = 1.0 / (1 + WEAK / (2 * STIFFNESS))  # what the weak spring leaves
    spring = SPRING + 2 * SHEAR * STIFFNESS  # both ends of the block
    assert x[:3] == pytest.approx(np.array(pulls[:3]) / spring, abs=1e-12)
    assert x[3:5] == pytest.approx((np.array(pulls[3:5]) - MU * normal) / SPRING, abs=1e-9)
    # Back: it sticks until the spring that it has stretched, and the pull, overcome 2 μ N.
    assert x[5:7] == pytest.approx(x[4] - (0.5 - np.array(pulls[5:7])) / spring, abs=1e-9)
    assert x[7] == pytest.approx((-0.3 + MU * normal) / SPRING, abs=1e-9)


def test_a_block_slips_where_the_normal_force_falls(block: Robot) -> None:
    x = driven(block, [(0.25, 1.0), (0.25, 0.5), (0.25, 0.1)]).q[0, :, 0]
    normal = np.array([0.5, 0.1]) / (1 + WEAK / (2 * STIFFNESS))
    assert x[1:] == pytest.approx((0.25 - MU * normal) / SPRING, abs=1e-9)


def test_work_is_stored_or_lost(block: Robot) -> None:
    """On a closed path: the work of the pull is what friction lost, which never falls."""
    way = np.concatenate(
        [np.linspace(0, 0.5, 26), np.linspace(0.5, -0.5, 51)[1:], np.linspace(-0.5, 0.5, 51)[1:]]
    )
    found = driven(block, [(0.0, 1.0), *((pull, 1.0) for pull in way)])
    x, lost = found.q[0, 1:, 0], Held.of(jnp.asarray(found.history[0][0, 1:]).reshape(-1, 12)).dissipated
    lost = np.asarray(lost).reshape(len(way), -1).sum(axis=1)
    assert (np.diff(lost) >= -1e-15).all()
    first, last = 25, len(way) - 1  # both at 0.5 N, slipping forward
    assert x[last] == pytest.approx(x[first], abs=1e-12)
    work = np.sum(0.5 * (way[first + 1 :] + way[first:-1]) * np.diff(x[first:]))
    # Steps of the path in which it begins to slip bend, so the trapezoidal rule is off by one part of each.
    slips = lost[last] - lost[first]
    normal = 1.0 / (1 + WEAK / (2 * STIFFNESS))
    exact = 2 * MU * normal * (x[first] - x.min() - 2 * MU * normal / (2 * SHEAR * STIFFNESS))
    assert slips == pytest.approx(exact, rel=1e-6)
    assert work == pytest.approx(exact, rel=0.02)


def test_a_path_goes_on_from_its_history(block: Robot) -> None:
    loads = [(0.0, 1.0), (0.5, 1.0), (0.2, 1.0), (0.3, 0.6)]
    whole = driven(block, loads)
    history = tuple(memory[:, 1] for memory in whole.history)
    rest = driven(block, loads[2:], State(whole.q[:, 1], np.array([loads[1]], float), history))
    np.testing.assert_allclose(rest.q, whole.q[:, 2:], atol=1e-12)
    with pytest.raises(InputError, match=r"state.history: expected one array for each term with a memory"):
        drive([block], np.array(loads[2:], float), state=State(whole.q[:, 1], np.array([loads[1]], float)))


@pytest.mark.parametrize("least", [np.inf, 0.0], ids=["on the way", "at the end of a step"])
def test_programs_evaluate_friction(block: Robot, least: float) -> None:
    check(block, size=0.005, least=jnp.array(least))


@pytest.mark.parametrize("moved", [1e-4, 1e-2])
def test_derivatives_where_points_stick_and_slip(moved: float, evaluate: Callable) -> None:
    """∂(gradient)/∂q against central differences, with round-off of 1e-16/step."""
    points = Gauss(2, 4)
    radius = np.linspace(0.005, 0.004, points.size)
    rod = Rod(
        "rod", 0.09, Circular(radius), young=3e5, strains={name: NodalQuadratic(2) for name in STRAINS},
        quadrature=points, mount=lie.translation(jnp.array([0.0, 0.001, 0.0155])),
    )  # fmt: skip
    site = np.zeros((1, 3))
    upper = Link("upper", 0.045, site, joint=Revolute((0.0, 1.0, 0.0), stiffness=0.04))
    lower = Link("lower", 0.025, site, parent="upper", joint=Revolute((0.0, 0.6, 0.8), stiffness=0.03))
    sizes = np.array([0.045, 0.025]), np.array([[0.011, 0.009], [0.009, 0.006]])
    contact = SolidContact(Tube("rod", radius), Solids((("upper", 0), ("lower", 0)), *sizes), np.array(3e5))
    bodies = (rod, upper, lower)
    robot = Robot(bodies, (contact, friction(contact, 0.4, Tree(bodies))))
    q = np.random.default_rng(7).normal(size=robot.dofs) * 0.02
    q[-1] = -0.03
    remember = eqx.filter_jit(lambda robot, q: robot.remember(walk(robot, q), jnp.zeros(0)))
    robot = robot.with_memories(remember(robot, jnp.asarray(q)))
    q = q + moved * np.random.default_rng(1).normal(size=robot.dofs)
    term = robot.terms[1]
    assert isinstance(term, Friction)

    @eqx.filter_jit
    def slipped(term: Friction, robot: Robot, q: jax.Array) -> Slip:
        motion = walk(robot, q)
        return term.slip(robot, motion, contact.pressing(robot, motion).force)

    slip = slipped(term, robot, jnp.asarray(q))
    pressed = np.asarray(slip.length) * np.asarray(slip.held) > 0
    assert (np.asarray(slip.held)[pressed] < 1).any() == (moved > 1e-3)
    here, step = evaluate(robot, q, np.zeros(0))[0].jacobian, 1e-7
    for i, e in enumerate(step * np.eye(robot.dofs)):
        ahead, behind = (evaluate(robot, q + sign * e, np.zeros(0))[0].gradient for sign in (1, -1))
        np.testing.assert_allclose(here[:, i], (ahead - behind) / (2 * step), atol=1e-8 * np.abs(here).max())


def test_friction_goes_on_from_one_link_to_the_next() -> None:
    """A rod drawn along two links in a row: all its points hold back by μ N, also those that change links."""
    points = Gauss(2, 4)
    radius = np.full(points.size, 0.005)
    rod = Rod(
        "rod", 0.03, Circular(radius), young=3e5, strains={"bend_y": NodalQuadratic(2)}, quadrature=points,
        joint=Prismatic((1.0, 0.0, 0.0)), mount=lie.translation(jnp.array([0.03, 0.0, 0.0145])),
    )  # fmt: skip
    site = np.zeros((1, 3))
    links = (
        Link("one", 0.045, site),
        Link("two", 0.045, site, mount=lie.translation(jnp.array([0.045, 0.0, 0.0]))),
    )
    solids = Solids((("one", 0), ("two", 0)), np.array([0.045, 0.045]), np.full((2, 2), 0.01))
    contact = SolidContact(Tube("rod", radius), solids, np.array(3e5))
    bodies = (rod, *links)
    robot = Robot(bodies, (contact, friction(contact, MU, Tree(bodies))))

    @eqx.filter_jit
    def at(robot: Robot, x: float) -> tuple:
        motion = walk(robot, jnp.zeros(robot.dofs).at[0].set(x))
        term = robot.terms[1]
        assert isinstance(term, Friction)
        pressed = contact.pressing(robot, motion).force
        return term.forces(robot, motion), pressed, robot.remember(motion, jnp.zeros(0))

    partners = []
    # Half a millimetre is more than the springs hold, a tenth is less.
    for x in (0.0, *np.arange(5e-4, 5e-3, 1e-4)):
        forces, pressed, memories = at(robot, x)
        robot = robot.with_memories(memories)
        partners.append(np.asarray(Held.of(memories[0]).partner))
        if x > 0:
            np.testing.assert_allclose(forces[:, 0], -MU * pressed, rtol=1e-9)
    assert (partners[0] != partners[-1]).any()


def test_what_slips_around_a_drum_goes_on_to_slip() -> None:
    """At the end of each step the surface has turned by a degree; at that pose the force is μ N still, and
    the point at its limit, so that Newton's method goes on with a force of given size."""
    across = lie.exp(jnp.array([0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0]))
    drum = Link("drum", 0.1, np.zeros((1, 3)), mount=lie.translation(jnp.array([0.0, -0.05, 0.0])) @ across)
    arm = Link("arm", 0.0, np.zeros((1, 3)), joint=Revolute((0.0, 1.0, 0.0)))
    block = Link(
        "block", 0.02, np.zeros((1, 3)), parent="arm", mount=lie.translation(jnp.array([-0.01, 0.0, 0.0249]))
    )
    on_arm = Solids((("block", 0),), np.array([0.02]), np.full((1, 2), 0.005))
    round_it = Solids((("drum", 0),), np.array([0.1]), np.full((1, 2), 0.02))
    contact = RigidContact(on_arm, round_it, np.array(STIFFNESS))
    bodies = (drum, arm, block)
    robot = Robot(bodies, (contact, friction(contact, MU, Tree(bodies))))
    for angle in np.deg2rad(np.arange(20.0)):
        motion = walk(robot, jnp.array([angle]))
        term = robot.terms[1]
        assert isinstance(term, Friction)
        push = contact.pressing(robot, motion).force
        before = np.linalg.norm(term.forces(robot, motion), axis=1)
        robot = robot.with_memories(robot.remember(motion, jnp.zeros(0)))
        term = robot.terms[1]
        assert isinstance(term, Friction)
        if angle > 0:
            np.testing.assert_allclose(before, MU * push, rtol=1e-9)
            np.testing.assert_allclose(np.linalg.norm(term.forces(robot, motion), axis=1), before, rtol=1e-9)
            assert (np.asarray(term.slip(robot, motion, push).held) < 1).all()
    assert push[0] == pytest.approx(STIFFNESS * 1e-4, rel=0.01)


def test_a_belt_on_a_drum_holds_by_the_power_of_its_angle() -> None:
    """T₁/T₀ = exp(μ θ R/(R + r)) for a belt of radius r whose friction acts on the drum's surface, radius R.

    What is left is how finely the ends of the contact are resolved.
    """
    radius, thin, lead = 0.02, 5e-4, 0.01
    around = np.pi * (radius + thin)
    points = Gauss(10, 8)

    def natural(x: np.ndarray) -> np.ndarray:
        s, strain = x * (around + 2 * lead), np.zeros((len(x), 6))
        strain[:, 1], strain[:, 3] = np.where((s > lead) & (s < lead + around), 1 / (radius + thin), 0.0), 1.0
        return strain

    belt = Rod(
        "belt", around + 2 * lead, Circular(np.full(points.size, thin)), young=1e8, poisson=0.5,
        strains={"bend_y": NodalQuadratic(10), "stretch_x": NodalQuadratic(10)}, quadrature=points,
        natural=natural, mount=lie.translation(jnp.array([-lead, 0.0, radius + thin - 2e-5])),
    )  # fmt: skip
    turn = np.array(
        [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, -0.05], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )
    drum = Link("drum", 0.1, np.zeros((1, 3)), mount=jnp.asarray(turn))
    solids = Solids((("drum", 0),), np.array([0.1]), np.array([[radius, radius]]))
    contact = SolidContact(Tube("belt", np.full(points.size, thin)), solids, np.array(2e6))
    bodies = (drum, belt)
    pull = DeadForce("belt", -1, 0, jnp.array([-1.0, 0.0, 0.0]))
    robot = Robot(bodies, (pull, contact, friction(contact, MU, Tree(bodies))))
    found = drive([robot], np.array([[1.0]]), options=SolverOptions(unrolled=False))
    assert found.converged.all()
    stretch = np.asarray(walk(robot, jnp.asarray(found.q[0, 0])).strain["belt"])[:, 3] - 1
    tension = 1e8 * np.pi * thin**2 * stretch
    assert tension[-2] / tension[1] == pytest.approx(np.exp(MU * np.pi * radius / (radius + thin)), rel=0.005)


@pytest.mark.parametrize("wrong", [-0.1, np.nan, np.inf])
def test_a_coefficient_is_a_number_of_at_least_zero(wrong: float, block: Robot) -> None:
    with pytest.raises(InputError, match="friction coefficient: expected a finite number of at least 0"):
        friction(block.terms[2], wrong, block)
