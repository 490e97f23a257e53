"""The walk down the tree: products of exponentials, Magnus steps of fourth order, Jacobians."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from exosight.mechanics import Circular, Gauss, Legendre, Robot, Rod
from exosight.mechanics.rod import STRAIGHT, STRAINS

LENGTH = 0.3


def matrix(twist: np.ndarray) -> np.ndarray:
    """The 4×4 matrix of a twist."""
    (a, b, c), v = twist[:3], twist[3:]
    return np.array([[0, -c, b, v[0]], [c, 0, -a, v[1]], [-b, a, 0, v[2]], [0, 0, 0, 0]])


def curved_rod(elements: int) -> Robot:
    """All six strains, cubic: as smooth as a rod can be, whatever the points along it."""
    points = Gauss(elements, 2)
    bases = dict.fromkeys(STRAINS, Legendre(3))
    rod = Rod(
        "rod", LENGTH, Circular(jnp.full(points.size, 0.01)), young=1e6, strains=bases, quadrature=points
    )
    return Robot((rod,))


def strain(q: np.ndarray, x: float) -> np.ndarray:
    """ξ at x in [0, 1] from its definition: angular strains are divided by the length."""
    scale = np.array([1 / LENGTH] * 3 + [1.0] * 3)
    polynomials = np.polynomial.legendre.legvander(np.array([2 * x - 1]), 3)[0]
    return STRAIGHT + scale * (q.reshape(6, 4) @ polynomials)


def exact_tip(q: np.ndarray) -> np.ndarray:
    """The tip's pose from g′ = g ξ, integrated to 1e-12."""

    def slope(x: float, g: np.ndarray) -> np.ndarray:
        return (LENGTH * g.reshape(4, 4) @ matrix(strain(q, x))).ravel()

    done = solve_ivp(slope, (0, 1), np.eye(4).ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    return done.y[:, -1].reshape(4, 4)


def test_rod_error_falls_at_fourth_order(motion: Callable) -> None:
    """Twice as many elements, a sixteenth of the error against the ordinary differential equation."""
    q = np.random.default_rng(2).normal(size=24) * np.repeat([0.2, 0.1], 12)
    exact = exact_tip(q)
    errors = np.array([np.abs(motion(curved_rod(n), q).pose[-1] - exact).max() for n in (4, 8, 16)])
    assert errors[-1] < 1e-7
    orders = np.log2(errors[:-1] / errors[1:])
    # 4 in the limit of small steps: 3.81 and 3.93 here, where the cubic strains still vary within a step.
    assert np.all((orders > 3.75) & (orders < 4.25)), orders


def test_constant_strain_is_one_exponential(motion: Callable) -> None:
    """A helix, on any points: the commutator in the Magnus step vanishes."""
    constant = np.array([0.5, 3.0, -1.0, 0.1, 0.05, -0.02])
    q = np.zeros((6, 4))
    q[:, 0] = constant
    tip = motion(curved_rod(2), q.ravel()).pose[-1]
    np.testing.assert_allclose(tip, expm(LENGTH * matrix(strain(q, 0.5))), atol=1e-13)  # products of 5 steps


def test_strain_is_the_basis_times_q(motion: Callable) -> None:
    q = np.random.default_rng(3).normal(size=24)
    robot = curved_rod(2)
    found = motion(robot, q).strain["rod"]
    expected = [strain(q, x) for x in Gauss(2, 2).points]
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


def test_chain_is_the_product_of_exponentials(chain: Robot, evaluate: Callable) -> None:
    """g = exp(S₁q₁) … exp(S_n q_n) g(0) with the hinges' screws S at rest, in the world."""
    q = np.array([0.4, -1.3, 2.5])
    poses = np.asarray(evaluate(chain, q, np.zeros(0))[1].pose)
    frame, product, found = np.eye(4), np.eye(4), []
    for body, angle in zip(chain.bodies, q, strict=True):
        frame = frame @ np.asarray(body.mount)
        axis, origin = frame[:3, :3] @ body.joint.groups[0][:3, 0], frame[:3, 3]
        product = product @ expm(matrix(np.concatenate([axis, np.cross(origin, axis)])) * angle)
        for site in np.asarray(body.sites):
            found.append(product @ frame @ np.block([[np.eye(3), site[:, None]], [np.zeros((1, 3)), 1.0]]))
        frame[:3, 3] += frame[:3, 0] * float(body.length)
    np.testing.assert_allclose(poses, found, atol=1e-13)  # eight products of numbers of order one


@pytest.fixture(scope="module")
def differences(tree: Robot, tree_pose: tuple, evaluate: Callable) -> np.ndarray:
    """∂(pose)/∂q of every frame of the tree by central differences: (dofs, frames, 4, 4)."""
    q, loads = tree_pose
    h = 1e-6
    steps = h * np.eye(tree.dofs)
    return np.array(
        [
            (evaluate(tree, q + e, loads)[1].pose - evaluate(tree, q - e, loads)[1].pose) / (2 * h)
            for e in steps
        ]
    )


# Round-off of 1e-16 in a pose over a step of 1e-6, and the square of the step.
DIFFERENCE = 1e-9


def test_jacobian_is_the_spatial_twist(
    tree: Robot, tree_pose: tuple, evaluate: Callable, differences: np.ndarray
) -> None:
    """(∂g/∂q_k) g⁻¹ is the matrix of column k."""
    found = evaluate(tree, *tree_pose)[1]
    spatial = differences @ np.linalg.inv(found.pose)
    expected = np.stack(
        [spatial[..., 2, 1], spatial[..., 0, 2], spatial[..., 1, 0], *np.moveaxis(spatial[..., :3, 3], -1, 0)]
    )
    np.testing.assert_allclose(np.moveaxis(found.jacobian, (0, 1, 2), (2, 0, 1)), expected, atol=DIFFERENCE)


def test_point_jacobian_is_the_derivative_of_positions(
    tree: Robot, tree_pose: tuple, evaluate: Callable, differences: np.ndarray
) -> None:
    found = evaluate(tree, *tree_pose)[1].point_jacobian()
    np.testing.assert_allclose(np.moveaxis(found, 2, 0), differences[..., :3, 3], atol=DIFFERENCE)


def test_a_frame_is_moved_by_its_ancestors_alone(tree: Robot, tree_pose: tuple, evaluate: Callable) -> None:
    jacobian = np.asarray(evaluate(tree, *tree_pose)[1].jacobian)
    ancestors = {"rod": {"rod"}, "upper": {"upper"}, "lower": {"upper", "lower"}, "branch": {"rod", "branch"}}
    for body, above in ancestors.items():
        for other in ancestors:
            columns = jacobian[tree.frame_slice(body)][:, :, tree.dof_slice(other)]
            assert (np.abs(columns).max() > 0) == (other in above), (body, other)


def test_bodies_hang_on_the_end_of_their_parent(tree: Robot, tree_pose: tuple, evaluate: Callable) -> None:
    found = evaluate(tree, *tree_pose)[1]
    pose = np.asarray(found.pose)
    np.testing.assert_array_equal(pose[tree.frame_slice("branch")][0], found["rod"].end)
    upper = np.asarray(found["upper"].end)[:3, 3]
    np.testing.assert_array_equal(pose[tree.frame_slice("lower")][0, :3, 3], upper)
    base = pose[tree.frame_slice("upper")][0, :3, 3]
    assert np.linalg.norm(upper - base) == pytest.approx(0.045, rel=1e-14)


def test_the_mount_moves_everything_alike(tree: Robot, tree_pose: tuple, evaluate: Callable) -> None:
    q, loads = tree_pose
    shift = expm(matrix(np.array([0.3, -0.8, 1.1, 0.2, 0.1, -0.3])))
    moved = eqx.tree_at(
        lambda r: [b.mount for b in r.bodies if b.parent is None],
        tree,
        [jnp.asarray(shift @ np.asarray(b.mount)) for b in tree.bodies if b.parent is None],
    )
    before, after = (np.asarray(evaluate(r, q, loads)[1].pose) for r in (tree, moved))
    np.testing.assert_allclose(after, shift @ before, atol=1e-14)
