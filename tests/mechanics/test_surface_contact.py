"""Contact of tubes: derivatives, closed forms, and independence of how finely a rod is cut."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from backends import check
from compiled import contacts, touching, walk, wrench
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from exosight import lie
from exosight.mechanics import Circular, Gauss, Link, NodalQuadratic, Revolute, Robot, Rod
from exosight.mechanics.rod import STRAINS
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surfaces import Plane, Solids, Tube, line_stiffness
from exosight.mechanics.term import Term
from exosight.mechanics.tree import Tree
from exosight.mechanics.tube_contact import TubeContact
from exosight.mechanics.tube_distance import FAR

STIFFNESS = 3e5
LENGTH = 0.09


FINE = Gauss(5, 8)


def rod(strains: tuple[str, ...] = ("bend_y", "stretch_x"), points: Gauss = FINE, **others) -> Rod:
    bases = {name: NodalQuadratic(min(points.elements, 5)) for name in strains}
    radius = jnp.linspace(0.005, 0.004, points.size)
    return Rod(
        "rod", LENGTH, Circular(radius), young=3e5, poisson=0.5, strains=bases, quadrature=points, **others
    )


def tube(of: Rod) -> Tube:
    return Tube("rod", of.section.radius)


class ByDifferentiation(SolidContact):
    """The same energy, with the derivatives that every term has."""

    bind = Term.bind


class CurlByDifferentiation(TubeContact):
    """The same energy, with the derivatives that every term has."""

    bind = Term.bind


def worn(height: float) -> tuple[Robot, SolidContact]:
    """A rod with all strains above two links on hinges about different axes, and below two planes."""
    soft = rod(STRAINS, Gauss(2, 4), mount=lie.translation(jnp.array([0.0, 0.001, height])))
    site = jnp.zeros((1, 3))
    upper = Link("upper", 0.0453, site, joint=Revolute((0.0, 1.0, 0.0), stiffness=0.04))
    lower = Link("lower", 0.025, site, parent="upper", joint=Revolute((0.0, 0.6, 0.8), stiffness=0.03))
    solids = Solids(
        (("upper", 0), ("lower", 0)), jnp.array([0.0453, 0.025]), jnp.array([[0.011, 0.009], [0.009, 0.006]])
    )
    contact = SolidContact(tube(soft), solids, jnp.array(STIFFNESS))
    planes = [
        SolidContact(tube(soft), Plane(body, jnp.array(point), jnp.array(normal)), jnp.array(STIFFNESS))
        for body, point, normal in (
            (None, [0.0, 0.0, 0.0202], [0.0, 0.1, -1.0]),
            ("lower", [0.0, 0.0, 0.02], [0.1, 0.2, -1.0]),
        )
    ]
    return Robot((soft, upper, lower), (contact, *planes)), contact


@pytest.fixture(scope="module")
def finger() -> tuple[Robot, SolidContact]:
    """Half a millimetre too low for the rod to be straight."""
    return worn(0.0155)


@pytest.fixture(scope="module")
def finger_pose(finger: tuple[Robot, SolidContact]) -> np.ndarray:
    """Coordinates at which points touch a side, a shared end, and both sides of an edge."""
    robot, contact = finger
    q = np.random.default_rng(7).normal(size=robot.dofs) * 0.02
    q[-1] = -0.2
    at = touching(contact, robot, jnp.asarray(q))
    share, touches = np.asarray(at.share[1]), np.asarray(at.overlap) > 0
    assert ((share > 0.02) & (share < 0.48) & touches).any(), share
    assert (np.asarray(at.touches[0].on_end) & touches).any()
    for plane in robot.terms[1:]:
        assert (np.asarray(touching(plane, robot, jnp.asarray(q)).overlap) > 1e-5).any()
    return q


def check_derivatives(evaluate: Callable, robot: Robot, q: np.ndarray) -> None:
    """Gradient and Hessian against central differences; round-off of 1e-16 / step, and for the second one the
    fifth power of the angle between two points, here 0.4 rad, at which kinematics ends a series."""
    step, here = 3e-7, evaluate(robot, q, np.zeros(0))[0]
    for i, e in enumerate(step * np.eye(robot.dofs)):
        ahead, behind = (evaluate(robot, q + sign * e, np.zeros(0))[0] for sign in (1, -1))
        slope = float(ahead.energy - behind.energy) / (2 * step)
        assert float(here.gradient[i]) == pytest.approx(slope, abs=1e-8)
        np.testing.assert_allclose(
            here.hessian[i],
            (ahead.gradient - behind.gradient) / (2 * step),
            atol=1e-6 * np.abs(here.hessian).max(),
        )


def test_derivatives_on_solids(finger: tuple, finger_pose: np.ndarray, evaluate: Callable) -> None:
    check_derivatives(evaluate, finger[0], finger_pose)


def test_expansion_on_solids_is_that_of_the_energy(
    finger: tuple, finger_pose: np.ndarray, evaluate: Callable
) -> None:
    robot, _ = finger
    terms = (ByDifferentiation(each.first, each.second, each.stiffness) for each in robot.terms)
    plain = Robot(robot.bodies, tuple(terms))
    ours, theirs = (evaluate(each, finger_pose, np.zeros(0))[0] for each in (robot, plain))
    for a, b in zip(*map(jax.tree.leaves, (ours, theirs)), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12 * max(1.0, np.abs(b).max(initial=0)))


@pytest.fixture(scope="module", params=["plane", "space"])
def curl(request: pytest.FixtureRequest) -> tuple[Robot, np.ndarray]:
    """A rod bent in its middle, so that its two halves press on each other."""
    points = Gauss(4, 8)
    soft = rod(points=points) if request.param == "plane" else rod(STRAINS, points)
    own = TubeContact(tube(soft), tube(soft), jnp.array(STIFFNESS))
    robot = Robot((soft,), (own,))
    q = np.random.default_rng(7).normal(size=robot.dofs) * 0.02
    bend = [name for name, _ in soft.strains].index("bend_y") * 9
    q[bend : bend + 9] += [0, 0, 0, 6.5, 15.5, 6.5, 0, 0, 0]
    assert (np.asarray(touching(own, robot, jnp.asarray(q)).overlap) > 1e-4).sum() >= 2
    return robot, q


def test_derivatives_of_a_rod_on_itself(curl: tuple, evaluate: Callable) -> None:
    check_derivatives(evaluate, *curl)


def test_a_rod_on_itself_has_no_force_as_a_whole(curl: tuple, evaluate: Callable) -> None:
    """Wrenches of all frames sum to zero: the energy does not change when the whole moves."""
    robot, q = curl
    found = np.asarray(wrench(robot, jnp.asarray(q), jnp.zeros(0)))
    assert np.abs(found).max() > 1e-2
    np.testing.assert_allclose(found.sum(axis=0), 0, atol=1e-14 * np.abs(found).sum())


def test_the_closest_place_is_the_closest(curl: tuple) -> None:
    """Against a search along the whole curve beyond what a point may touch."""
    robot, q = curl
    motion, contact = walk(robot, jnp.asarray(q)), robot.terms[0]
    at = touching(contact, robot, jnp.asarray(q))
    pose, soft = np.asarray(motion.pose), robot["rod"]
    s, radius = LENGTH * soft.quadrature.points, np.asarray(soft.section.radius)
    direction, position = pose[:, :3, 0], pose[:, :3, 3]
    slopes = np.full(len(s), (radius[-1] - radius[0]) / LENGTH)
    slopes = np.concatenate([slopes[:1], slopes[1:-1], slopes[-1:]])
    # The radius is no line in s here, but evenly spaced by points: take its own differences.
    secant = np.diff(radius) / np.diff(s)
    h = np.diff(s)
    slopes[1:-1] = (secant[:-1] * h[1:] + secant[1:] * h[:-1]) / (h[1:] + h[:-1])
    slopes[[0, -1]] = secant[[0, -1]]

    def gap(point: np.ndarray, j: int, t: float) -> float:
        a, b, c, d = 1 - t * t * (3 - 2 * t), t * (1 - t) ** 2, t * t * (3 - 2 * t), t * t * (t - 1)
        centre = a * position[j] + b * h[j] * direction[j] + c * position[j + 1] + d * h[j] * direction[j + 1]
        thick = a * radius[j] + b * h[j] * slopes[j] + c * radius[j + 1] + d * h[j] * slopes[j + 1]
        return float(np.linalg.norm(point - centre) - thick)

    samples = contact.samples(robot)
    centre = np.asarray(samples.levers(motion.pose)).sum(axis=1)
    along, thick = samples.lumping.T @ s, np.asarray(samples.radius)
    pressed = np.flatnonzero(np.asarray(at.overlap) > 0)
    for i in pressed:
        first = int(np.argmax(s - along[i] > FAR * (thick[i] + radius)))
        least = min(
            minimize_scalar(
                lambda t, i=i, j=j: gap(centre[i], j, t),
                bounds=(0, 1),
                method="bounded",
                options={"xatol": 1e-12},
            ).fun
            for j in range(first, len(s) - 1)
        )
        # A bounded search misses an end of its interval by 1e-8 of it.
        assert float(at.overlap[i]) == pytest.approx(thick[i] - least, abs=1e-9)


@pytest.mark.parametrize("bend", np.linspace(8.0, 40.0, 9))
def test_no_contact_is_missed_by_searching_near_pieces_alone(
    bend: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against a search of all, from a rod that is almost straight to one that is bent into itself."""
    soft = rod(points=Gauss(4, 8))
    contact = TubeContact(tube(soft), tube(soft), jnp.array(STIFFNESS))
    robot = Robot((soft,), (contact,))
    q = np.zeros(robot.dofs)
    q[:9] = bend * np.exp(-((np.arange(9) - 4) ** 2))
    pose = walk(robot, jnp.asarray(q)).pose
    near = contact.closest(robot, pose)
    monkeypatch.setattr("exosight.mechanics.tube_distance.HALF", 1e3)
    every = contact.closest(robot, pose)
    np.testing.assert_array_equal(jnp.maximum(near.overlap, 0), jnp.maximum(every.overlap, 0))
    # With a ball of 0.6 pieces too much on either side, what comes within 1 mm is searched as well.
    np.testing.assert_array_equal(near.overlap[every.overlap > -1e-3], every.overlap[every.overlap > -1e-3])


def test_a_rod_that_closes_on_itself_within_a_step_is_seen() -> None:
    """From open by several radii, where no piece is near another one, to overlapping by several."""
    soft = rod(points=Gauss(4, 8))
    contact = TubeContact(tube(soft), tube(soft), jnp.array(STIFFNESS))
    robot = Robot((soft,), (contact,))
    begin, step = np.zeros(robot.dofs), np.zeros(robot.dofs)
    bend = np.exp(-((np.arange(9) - 4) ** 2))
    begin[:9], step[:9] = 8 * bend, 0.5 * bend
    first = next(
        k for k in range(200) if (np.asarray(touching(contact, robot, begin + k * step).overlap) > 0).any()
    )
    q, end = begin + (first - 4) * step, begin + (first + 4) * step
    assert (np.asarray(touching(contact, robot, q).overlap) < -1e-4).all()
    # A few steps, as none goes beyond where balls around two pieces touch that were not searched.
    for _ in range(5):
        share = float(contact.max_step_fraction(robot, walk(robot, jnp.asarray(q)), jnp.asarray(end - q)))
        assert 0 < share < 1
        q = q + share * (end - q)
        deepest = float(jnp.max(touching(contact, robot, q).overlap))
        if deepest > -1e-3:
            break
    assert abs(deepest) < 1e-3


@pytest.mark.parametrize("x", np.linspace(-0.02, 0.07, 19))
def test_distance_of_a_tapered_solid(x: float) -> None:
    """Against the hull of two spheres: the least of |p − (t, 0, 0)| − r(t) over the axis."""
    solids = Solids((("a", 0),), jnp.array([0.045]), jnp.array([[0.011, 0.005]]))
    point = np.array([[x, 0.01, 0.012]])
    found = contacts(solids, jnp.eye(4)[None], jnp.asarray(point), np.array([0.003]))
    least = minimize_scalar(
        lambda t: np.linalg.norm(point[0] - [t, 0, 0]) - (0.011 - 0.006 / 0.045 * t),
        bounds=(0, 0.045),
        method="bounded",
        options={"xatol": 1e-12},
    )
    assert float(found.overlap[0]) == pytest.approx(0.003 - least.fun, abs=1e-9)
    numeric = (
        np.array(
            [
                float(
                    contacts(solids, jnp.eye(4)[None], jnp.asarray(point + e), np.array([0.003])).overlap[0]
                )
                - float(
                    contacts(solids, jnp.eye(4)[None], jnp.asarray(point - e), np.array([0.003])).overlap[0]
                )
                for e in 1e-6 * np.eye(3)
            ]
        )
        / 2e-6
    )
    np.testing.assert_allclose(found.touches[0].normal[0], -numeric, atol=1e-7)


@pytest.mark.parametrize("points", [Gauss(5, 8), Gauss(5, 16), Gauss(10, 8)])
def test_the_force_of_a_line_does_not_depend_on_the_points(points: Gauss) -> None:
    """A tube that lies flat on a cylinder, 0.1 mm deep: k d a length, and that of its round end."""
    soft = rod(points=points)
    radius = jnp.full(points.size, 0.005)
    solids = Solids((("bar", 0),), jnp.array([1.0]), jnp.array([[0.01, 0.01]]))
    bar = Link("bar", 1.0, jnp.array([[-0.5, 0.0, -0.0149]]))
    robot = Robot((soft, bar), ())
    contact = SolidContact(Tube("rod", radius), solids, jnp.array(STIFFNESS))
    at = touching(contact, robot, jnp.zeros(robot.dofs))
    force = np.asarray(contact.pressure(robot, at))
    assert force.sum() == pytest.approx(STIFFNESS * 1e-4 * (LENGTH + 0.5 * 0.005), rel=1e-10)


def test_a_tube_that_lies_on_a_plane() -> None:
    """0.1 mm deep in a tilted plane of the world: k d a length, along the plane's normal."""
    up = np.array([0.0, 0.6, 0.8])
    soft = rod()
    floor = Plane(None, jnp.asarray(-0.0049 * up), jnp.asarray(2 * up))
    contact = SolidContact(Tube("rod", jnp.full(FINE.size, 0.005)), floor, jnp.array(STIFFNESS))
    robot = Robot((soft,), (contact,))
    at = touching(contact, robot, jnp.zeros(robot.dofs))
    assert float(contact.pressure(robot, at).sum()) == pytest.approx(
        STIFFNESS * 1e-4 * (LENGTH + 0.5 * 0.005)
    )
    np.testing.assert_allclose(at.touches[0].normal, np.tile(up, (len(at.overlap), 1)), atol=1e-15)


def test_stiffness_of_a_line() -> None:
    """Popov's π/4 E* of a cylinder on a flat body."""
    assert line_stiffness(300e3, 0.5) == pytest.approx(np.pi / 4 * 400e3)


def test_contact_made_within_a_step_is_seen() -> None:
    """A finger that is lifted to a rod above it: the step is cut slightly beyond the first touch."""
    robot, contact = worn(0.0175)
    step = np.zeros(robot.dofs)
    step[-2] = -0.3
    motion = walk(robot, jnp.zeros(robot.dofs))
    assert (np.asarray(touching(contact, robot, jnp.zeros(robot.dofs)).overlap) < -1e-3).all()
    share = float(contact.max_step_fraction(robot, motion, jnp.asarray(step)))
    assert 0.05 < share < 0.95
    after = touching(contact, robot, jnp.asarray(share * step))
    # 0.3 % of some 10 mm beyond, and what the way to it is bent by the turn.
    assert abs(float(jnp.max(after.overlap))) < 2e-4


def test_programs_evaluate_both_contacts() -> None:
    soft = rod(points=Gauss(2, 4))
    bone = Link("bone", 0.05, jnp.zeros((1, 3)), joint=Revolute((0.0, 1.0, 0.0), stiffness=0.1))
    solids = Solids((("bone", 0),), jnp.array([0.05]), jnp.array([[0.01, 0.008]]))
    terms = (
        SolidContact(tube(soft), solids, jnp.array(STIFFNESS)),
        TubeContact(tube(soft), tube(soft), jnp.array(STIFFNESS)),
    )
    check(Robot((soft, bone), terms))


def two_rods(mount: np.ndarray, points: Gauss) -> float:
    """Force [N] of a straight tube of radius 5 mm on another one, at 0, with a mount of its own."""
    radius = jnp.full(points.size, 0.005)
    rods = [
        Rod(
            name,
            LENGTH,
            Circular(radius),
            young=3e5,
            strains={"bend_y": NodalQuadratic(1)},
            quadrature=points,
        )
        for name in ("first", "second")
    ]
    rods[1] = eqx.tree_at(lambda each: each.mount, rods[1], jnp.asarray(mount))
    tree = Tree(tuple(rods))
    contact = TubeContact(Tube("first", radius), Tube("second", radius), jnp.array(STIFFNESS))
    force, _ = eqx.filter_jit(lambda tree, term: term.forces(tree, walk(tree, jnp.zeros(6)).pose))(
        tree, contact
    )
    return float(-force[:, 2].sum())


def test_two_tubes_side_by_side() -> None:
    """0.1 mm deep: k d a length, and that of the round end."""
    pushed = two_rods(np.asarray(lie.translation(jnp.array([0.0, 0.0, 0.0099]))), Gauss(5, 4))
    assert pushed == pytest.approx(STIFFNESS * 1e-4 * (LENGTH + 0.5 * 0.005), rel=1e-12)


@pytest.mark.parametrize("angle", [90.0, 30.0])
def test_two_crossed_tubes(angle: float) -> None:
    """0.5 mm deep at height h: k ∫ (2 r − √(h² + s² sin² φ)) h / √(h² + s² sin² φ) ds where they overlap."""
    height, sine = 0.0095, np.sin(np.deg2rad(angle))
    turned = lie.exp(jnp.array([0.0, 0.0, np.deg2rad(angle), 0.0, 0.0, 0.0]))
    mount = (
        lie.translation(jnp.array([LENGTH / 2, 0.0, height]))
        @ turned
        @ lie.translation(jnp.array([-LENGTH / 2, 0.0, 0.0]))
    )
    half = np.sqrt(0.01**2 - height**2) / sine
    line, _ = quad(lambda s: (0.01 / np.hypot(height, s * sine) - 1) * height, -half, half)
    # Points 0.6 mm apart, and a kink of the traction where the overlap ends.
    assert two_rods(np.asarray(mount), Gauss(20, 8)) == pytest.approx(STIFFNESS * line, rel=0.01)
