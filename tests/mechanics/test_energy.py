"""The potential energy: derivatives against differences, invariance, and closed forms of its terms."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from exosight.mechanics import DeadForce, Gravity, Robot, SphereContact

STEP = 1e-6


@pytest.fixture(scope="module")
def here(tree: Robot, tree_pose: tuple, evaluate: Callable) -> tuple:
    """Evaluation and Motion of the tree at its pose."""
    return evaluate(tree, *tree_pose)


@pytest.fixture(scope="module")
def around(tree: Robot, tree_pose: tuple, evaluate: Callable) -> list:
    """Pairs of evaluations one step ahead and one behind, along each coordinate."""
    q, loads = tree_pose
    return [
        tuple(evaluate(tree, q + sign * e, loads)[0] for sign in (1, -1)) for e in STEP * np.eye(tree.dofs)
    ]


def test_the_tree_has_every_energy_at_work(tree: Robot, tree_pose: tuple, here: tuple) -> None:
    """What the derivatives below would not show if it were idle: contacts made and open, limits passed."""
    contact = next(term for term in tree.terms if isinstance(term, SphereContact))
    overlap = np.asarray(contact.pairs(tree, here[1].position)[0])
    assert (overlap > 1e-4).sum() >= 3
    assert (overlap < 0).any()
    q = tree_pose[0]
    outside = [not -0.1 < q[tree.dof_slice(name).start] < 0.2 for name in ("upper", "lower")]
    assert any(outside)


# Central differences: round-off 1e-16·Π/h and the square of the step, both below 1e-9 of the largest entry,
# which is a few joules (or newtons) here.
def test_gradient_matches_differences_of_energy(here: tuple, around: list) -> None:
    differences = np.array([(ahead.energy - behind.energy) / (2 * STEP) for ahead, behind in around])
    assert np.abs(differences).min() > 1e-5  # no coordinate is idle
    np.testing.assert_allclose(here[0].gradient, differences, atol=1e-8)


def test_hessian_matches_differences_of_gradient(here: tuple, around: list) -> None:
    differences = np.array([(ahead.gradient - behind.gradient) / (2 * STEP) for ahead, behind in around])
    np.testing.assert_allclose(here[0].hessian, differences, atol=1e-8)


def test_hessian_is_symmetric(here: tuple) -> None:
    hessian = np.asarray(here[0].hessian)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-15 * np.abs(hessian).max() * len(hessian))


def test_energy_is_linear_in_the_loads(
    tree: Robot, tree_pose: tuple, here: tuple, evaluate: Callable
) -> None:
    """Π(q, u + δ) = Π(q, u) + Λ·δ for steps of any size, and likewise its gradient."""
    q, loads = tree_pose
    step = np.array([-3.0, 7.0])
    there = evaluate(tree, q, loads + step)[0]
    assert float(there.energy) == pytest.approx(float(here[0].energy + step @ here[0].load_energy), rel=1e-13)
    np.testing.assert_allclose(
        there.gradient, here[0].gradient + step @ here[0].load_gradient, atol=1e-14 * 10
    )


def test_energy_does_not_depend_on_where_the_robot_stands(
    tree: Robot, tree_pose: tuple, here: tuple, evaluate: Callable
) -> None:
    """The robot, its weight and its dead forces moved and turned together: the same Π and derivatives.

    Coordinates are relative, so gradient and Hessian stay too. Weight and dead forces measure height from the
    world's origin: a shift would add a constant to Π, so this one only turns.
    """
    turn = Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()
    whole = np.eye(4)
    whole[:3, :3] = turn

    def turned(robot: Robot) -> list:
        mounts = [body.mount for body in robot.bodies if body.parent is None]
        directions = [term.direction for term in robot.terms if isinstance(term, DeadForce)]
        return [*mounts, *directions, *(t.acceleration for t in robot.terms if isinstance(t, Gravity))]

    new = [jnp.asarray((whole if part.ndim == 2 else turn) @ np.asarray(part)) for part in turned(tree)]
    there = evaluate(eqx.tree_at(turned, tree, new), *tree_pose)[0]
    assert float(there.energy) == pytest.approx(float(here[0].energy), rel=1e-13)
    np.testing.assert_allclose(there.gradient, here[0].gradient, atol=1e-13)
    np.testing.assert_allclose(there.hessian, here[0].hessian, atol=1e-13)


def test_rigid_motion_costs_no_energy(tree: Robot, tree_pose: tuple, evaluate: Callable) -> None:
    """A free hinge turns the rod and its branch as one: neither elasticity nor the line feels it."""
    q, _ = tree_pose
    free = eqx.tree_at(
        lambda r: (r["rod"].joint.stiffness, r.terms[-2].acceleration, r.terms[-1].stiffness),
        tree,
        (jnp.zeros(1), jnp.zeros(3), jnp.array(0.0)),
    )
    turned = q.copy()
    turned[tree.dof_slice("rod").start] += 1.0
    energies = [float(evaluate(free, at, np.array([2.0, 0.0]))[0].energy) for at in (q, turned)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-13)


def test_dead_force_works_over_the_way_of_its_point(tree: Robot, here: tuple) -> None:
    """Λ = −direction · p."""
    position = np.asarray(here[1].position)
    tip, middle = position[tree.frame_slice("rod")][-1], position[tree.frame_slice("branch")][2]
    expected = -np.array([0.1, 0.2, -0.3]) @ (tip + middle)
    assert float(here[0].load_energy[1]) == pytest.approx(expected, rel=1e-13)


def test_contact_acts_as_it_reacts(tree: Robot, tree_pose: tuple, here: tuple) -> None:
    """Forces and moments of all contacts on the tree cancel; on one side they are what `forces` says."""
    motion, term = here[1], tree.terms[-1]
    expand = eqx.filter_jit(lambda term, *at: term.bind(tree)(*at).wrench)
    wrench = np.asarray(expand(term, tree_pose[0], motion, tree_pose[1]))
    assert np.abs(wrench).max() > 0.1
    np.testing.assert_allclose(wrench.sum(axis=0), 0.0, atol=1e-12)  # round-off in forces of some 10 N
    forces, second = np.asarray(term.forces(tree, motion.position)[1]), list(term.second.index(tree))
    # A wrench is a derivative of the energy, so a force is its opposite.
    np.testing.assert_allclose(-wrench[second, 3:], forces, atol=1e-12)
    moments = np.cross(np.asarray(motion.position)[second], forces)
    np.testing.assert_allclose(-wrench[second, :3], moments, atol=1e-12)


# The chain: springs 0.04, 0.03, 0.02 N m/rad, limits −0.1…1.5 rad with 5 N m/rad beyond them, weights.
CHAIN_SPRINGS, CHAIN_LIMIT = np.array([0.04, 0.03, 0.02]), 5.0


def weight(chain: Robot, position: np.ndarray) -> float:
    mass = np.concatenate([np.asarray(body.mass) for body in chain.bodies])
    return -float(mass @ position @ np.array([0.5, 0.0, -9.81]))


@pytest.mark.parametrize(
    ("q", "excess"),
    [
        ([0.3, 0.5, 1.4], [0, 0, 0]),
        ([-0.1, 1.5, 0.0], [0, 0, 0]),
        ([-0.3, 0.0, 2.0], [-0.2, 0, 0.5]),
    ],
)
def test_chain_stores_springs_stops_and_height(
    chain: Robot, evaluate: Callable, q: list[float], excess: list[float]
) -> None:
    """Π = ½ Σ k q² + ½ Σ k_limit (what is beyond the range)² − Σ m γ·p."""
    here, motion = evaluate(chain, np.array(q), np.zeros(0))
    expected = 0.5 * CHAIN_SPRINGS @ np.square(q) + 0.5 * CHAIN_LIMIT * np.sum(np.square(excess))
    assert float(here.energy) == pytest.approx(
        expected + weight(chain, np.asarray(motion.position)), rel=1e-13
    )


def test_gravity_force_is_gradient_of_potential(chain: Robot, evaluate: Callable) -> None:
    """The torque on a hinge is axis · Σ (p − p₀) × m γ over what hangs on it."""
    q = np.array([0.3, 0.5, 1.2])
    here, motion = evaluate(chain, q, np.zeros(0))
    position, pose = np.asarray(motion.position), np.asarray(motion.pose)
    mass = np.concatenate([np.asarray(body.mass) for body in chain.bodies])
    pull = mass[:, None] * np.array([0.5, 0.0, -9.81])
    for i, body in enumerate(chain.bodies):
        start = chain.frame_slice(body.name).start
        axis, origin = pose[start, :3, :3] @ body.joint.groups[0][:3, 0], pose[start, :3, 3]
        torque = axis @ np.cross(position[start:] - origin, pull[start:]).sum(axis=0)
        assert float(here.gradient[i]) == pytest.approx(CHAIN_SPRINGS[i] * q[i] - torque, rel=1e-12)


def test_a_stop_pushes_back_only_beyond_the_range(chain: Robot, evaluate: Callable) -> None:
    """Across the end of the range the gradient is continuous, the Hessian jumps by the stop's stiffness."""
    inside, outside = (evaluate(chain, np.array([0.0, 0.0, 1.5 + s]), np.zeros(0))[0] for s in (-1e-9, 1e-9))
    np.testing.assert_allclose(inside.gradient, outside.gradient, atol=1e-7)  # 5 N m/rad over 2e-9 rad
    jump = np.asarray(outside.hessian - inside.hessian)
    np.testing.assert_allclose(jump, np.diag([0.0, 0.0, CHAIN_LIMIT]), atol=1e-7)
