"""Contact of rigid solids: distances against an independent minimiser, derivatives, capsules at rest."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from backends import check
from compiled import walk
from scipy.optimize import minimize

from exosight import lie
from exosight.mechanics import Gravity, Link, Prismatic, Revolute, Robot, drive
from exosight.mechanics.cones import Cones, between, closest_pair
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.surfaces import Plane, Solids

STIFFNESS = 2e4
COUNT = 48


@pytest.fixture(scope="module")
def cones() -> tuple[Cones, Cones]:
    """Pairs of tapered solids, every fourth of them nearly parallel, some crossing each other."""
    random = np.random.default_rng(0)
    sides = []
    for _ in range(2):
        along = 0.02 * random.normal(size=(COUNT, 3))
        radius = random.uniform(0.002, 0.01, COUNT)
        if sides:
            tilt = 10.0 ** random.uniform(-9, -3, (COUNT // 4, 1)) * random.normal(size=(COUNT // 4, 3))
            along[::4] = sides[0][1][::4] * random.uniform(0.5, 1.5, (COUNT // 4, 1)) + 0.02 * tilt
        taper = random.uniform(-0.9, 0.9, COUNT) * np.minimum(np.linalg.norm(along, axis=1), radius)
        sides.append((0.01 * random.normal(size=(COUNT, 3)) - along / 2, along, radius, taper))
    first, second = (Cones(*map(jnp.asarray, side)) for side in sides)
    return first, second


def test_the_closest_pair_is_the_closest(cones: tuple[Cones, Cones]) -> None:
    """Against L-BFGS-B; f is convex, so round-off is all that is between them."""
    s, t = jax.jit(closest_pair)(*cones)
    ours = [_gap(cones, i, np.array([s[i], t[i]])) for i in range(COUNT)]
    assert sum(0 < float(x) < 1 and 0 < float(y) < 1 for x, y in zip(s, t, strict=True)) >= 6

    def least(i: int) -> float:
        def scaled(z: np.ndarray) -> float:
            return 1e3 * _gap(cones, i, z)

        options = {"ftol": 1e-16, "gtol": 1e-9}
        # From the middle alone it stops 1 mm too early for one pair, on some processors.
        starts = ([0.5, 0.5], [0.0, 0.0], [1.0, 1.0])
        bounds = [(0, 1)] * 2
        return min(minimize(scaled, x, bounds=bounds, method="L-BFGS-B", options=options).fun for x in starts)

    theirs = 1e-3 * np.array([least(i) for i in range(COUNT)])
    assert (np.array(ours) <= theirs + 1e-16).all()
    # Its differences of 1e-8 leave a gradient of 1e-8 of the length.
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_the_closest_pair_is_that_of_ipctk() -> None:
    """Axes of capsules; its edges that are parallel to 1e-6 are up to 5e-10 m too far apart, ours are not."""
    ipctk = pytest.importorskip("ipctk", reason="needs the extra compare")
    random = np.random.default_rng(1)
    ends = 0.02 * random.normal(size=(500, 4, 3))
    none = jnp.zeros(len(ends))
    first, second = (
        Cones(jnp.asarray(ends[:, i]), jnp.asarray(ends[:, i + 1] - ends[:, i]), none, none) for i in (0, 2)
    )
    ours = jax.jit(lambda a, b: between(a, b, *closest_pair(a, b))[1])(first, second)
    theirs = [np.sqrt(ipctk.edge_edge_distance(*points)) for points in ends]
    np.testing.assert_allclose(ours, theirs, atol=1e-16)


def _gap(cones: tuple[Cones, Cones], i: int, z: np.ndarray) -> float:
    (p, u, r, dr), (q, v, k, dk) = ([np.asarray(part)[i] for part in side] for side in cones)
    return float(np.linalg.norm(p + z[0] * u - q - z[1] * v) - r - z[0] * dr - k - z[1] * dk)


def links(angle: float) -> Robot:
    """A tapered link on two hinges above a fixed capsule, turned about z; a link on a hinge over its back."""
    site, y = jnp.zeros((1, 3)), (0.0, 1.0, 0.0)
    turn = lie.exp(jnp.array([0.0, 0.0, angle, 0.0, 0.0, 0.0]))
    above = lie.translation(jnp.array([[0.0, 0.0, 0.0149], [0.02, 0.0, 0.0269]]))
    arm = Link("arm", 0.0, site, joint=Revolute(y), mount=above[0])
    top = Link("top", 0.04, site, parent="arm", joint=Revolute((0.6, 0.0, 0.8)))
    bar = Link("bar", 0.05, site, mount=lie.translation(jnp.array([0.01, -0.004, 0.0])) @ turn)
    tip = Link("tip", 0.01, site, joint=Revolute(y), mount=above[1])
    solid, post = (
        Solids(((name, 0),), jnp.array([length]), jnp.array([radii]))
        for name, length, radii in (("top", 0.04, [0.009, 0.006]), ("bar", 0.05, [0.008, 0.008]))
    )
    end = Solids((("tip", 0),), jnp.array([0.01]), jnp.array([[0.004, 0.005]]))
    plane = Plane("top", jnp.array([0.0, 0.001, 0.009]), jnp.array([0.0, 0.2, 1.0]))
    stiffness = jnp.array(STIFFNESS)
    contacts = (RigidContact(solid, post, stiffness), RigidContact(end, plane, stiffness))
    return Robot((arm, top, bar, tip), contacts)


@eqx.filter_jit
def overlaps(robot: Robot, pose: jax.Array) -> list[jax.Array]:
    return [term.pairs(robot, pose).overlap for term in robot.terms]


@pytest.mark.parametrize("angle", [0.7, 1e-4, 0.0], ids=["crossed", "nearly parallel", "parallel"])
def test_derivatives_of_links_in_contact(angle: float, evaluate: Callable) -> None:
    """Gradient and Hessian against central differences, also where no pair is the only closest one."""
    robot = links(angle)
    q = 0.01 * np.random.default_rng(3).normal(size=robot.dofs)
    if angle < 0.1:
        q[:2] = 0.0
    step, (here, motion) = 1e-7, evaluate(robot, q, np.zeros(0))
    for each in overlaps(robot, motion.pose):
        assert (np.asarray(each) > 1e-5).any(), each
    for i, e in enumerate(step * np.eye(robot.dofs)):
        ahead, behind = (evaluate(robot, q + sign * e, np.zeros(0))[0] for sign in (1, -1))
        slope = float(ahead.energy - behind.energy) / (2 * step)
        assert float(here.gradient[i]) == pytest.approx(slope, abs=1e-8)
        differences = (ahead.gradient - behind.gradient) / (2 * step)
        np.testing.assert_allclose(here.hessian[i], differences, atol=2e-5 * np.abs(here.hessian).max())


def test_programs_evaluate_contact_of_links() -> None:
    check(links(0.3), size=0.01)


@pytest.mark.parametrize("below", ["plane", "bar"])
def test_a_link_lies_still_on_what_is_below(below: str) -> None:
    """On a plane both ends carry their share of the weight; a parallel bar is pressed right below it."""
    weight, site = 0.4, jnp.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    height = lie.translation(jnp.array([0.0, 0.0, 0.005]))
    lift = Link("lift", 0.0, site[:1], joint=Prismatic((0.0, 0.0, 1.0)), mount=height)
    mass = np.array([0.0, weight / 9.81])
    block = Link("block", 0.04, site, parent="lift", joint=Revolute((0.0, 1.0, 0.0)), mass=mass)
    bar = Link("bar", 0.04, site[:1], mount=lie.translation(jnp.array([0.0, 0.0, -0.006])))
    ground = (
        Plane(None, jnp.zeros(3), jnp.array([0.0, 0.0, 1.0]))
        if below == "plane"
        else Solids((("bar", 0),), jnp.array([0.04]), jnp.full((1, 2), 0.006))
    )
    solid = Solids((("block", 0),), jnp.array([0.04]), jnp.full((1, 2), 0.005))
    contact = RigidContact(solid, ground, jnp.array(STIFFNESS))
    robot = Robot((lift, block, bar), (contact, Gravity(jnp.array([0.0, 0.0, -9.81]))))
    found = drive([robot], np.zeros((1, 0)))
    assert found.converged.all()
    force, at = contact.forces(robot, walk(robot, jnp.asarray(found.q[0, 0])).pose)
    # Angles of some 1e-4 turn forces and levers by that, squared.
    expected = [0.75 * weight, 0.25 * weight] if below == "plane" else [weight]
    np.testing.assert_allclose(force[:, 2], expected, rtol=1e-6)
    if below == "bar":
        assert float(at.place[0, 0]) == pytest.approx(0.01, rel=1e-6)
