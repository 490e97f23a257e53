"""Rigid motions against the matrix exponential, power series and the identities of the group."""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from exosight import lie

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 0.1, 0.99999, 1.00001, 3.0, np.pi, 2 * np.pi - 1e-6, 2 * np.pi, 10.0]
"""Both sides of the branch at one radian, half and whole turns, and beyond."""


@pytest.fixture(scope="module")
def twists() -> np.ndarray:
    """(60, 6): each angle about several random axes, with linear parts from 0 to 10."""
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(5, len(ANGLES), 3))
    omega = axes / np.linalg.norm(axes, axis=-1, keepdims=True) * np.array(ANGLES)[:, None]
    linear = rng.normal(size=omega.shape) * np.array([0.0, 1e-6, 1.0, 3.0, 10.0])[:, None, None]
    return np.concatenate([omega, linear], axis=-1).reshape(-1, 6)


@pytest.fixture(scope="module")
def maps(twists: np.ndarray) -> dict[str, np.ndarray]:
    """What the package makes of the twists, each map compiled once and called with a batch."""
    names = {
        "exp": lie.exp,
        "tangent": lie.tangent,
        "tangent_inverse": lie.tangent_inverse,
        "ad": lie.ad,
        "coad": lie.coad,
    }
    return {name: np.asarray(compiled(function)(twists)) for name, function in names.items()}


def compiled(function: Callable) -> Callable:
    """Compiled without the optimisations that would take longer than the test itself."""
    return jax.jit(function, compiler_options={"xla_backend_optimization_level": "0"})


def matrix(twist: np.ndarray) -> np.ndarray:
    """The 4×4 matrix of a twist, written out."""
    (a, b, c), v = twist[:3], twist[3:]
    return np.array([[0, -c, b, v[0]], [c, 0, -a, v[1]], [-b, a, 0, v[2]], [0, 0, 0, 0]])


def bracket(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """[x, y] from the commutator of the 4×4 matrices."""
    c = matrix(x) @ matrix(y) - matrix(y) @ matrix(x)
    return np.array([c[2, 1], c[0, 2], c[1, 0], *c[:3, 3]])


# Double precision on numbers up to |v| = 10 and angles up to 10: expm itself is good to about 1e-13 there.
ROUND_OFF = 1e-12


def test_exp_is_the_matrix_exponential(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    for twist, g in zip(twists, maps["exp"], strict=True):
        np.testing.assert_allclose(g, expm(matrix(twist)), atol=ROUND_OFF, rtol=0)


def test_tiny_rotations_are_not_rounded_away(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    # To first order the off-diagonal entries are the angles themselves, digit for digit.
    tiny = np.isclose(np.linalg.norm(twists[:, :3], axis=1), 1e-12, rtol=1e-6, atol=0)
    assert tiny.any()
    off_diagonal = maps["exp"][tiny][:, [2, 0, 1], [1, 2, 0]]
    np.testing.assert_allclose(off_diagonal, twists[tiny, :3], rtol=1e-10, atol=0)


def test_tangent_is_its_series(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    """T(Ω) = Σ ad(Ω)^k / (k + 1)!."""
    for twist, tangent, ad in zip(twists, maps["tangent"], maps["ad"], strict=True):
        series, power = np.zeros((6, 6)), np.eye(6)
        for k in range(60):
            series, power = series + power / math.factorial(k + 1), power @ ad
        # The series at |Ω| = 10 passes through terms of 10¹⁰/11! ≈ 250, with |v| = 10 some 1e4 of them.
        scale = 1 + np.linalg.norm(twist) * np.exp(np.linalg.norm(twist[:3])) / 100
        np.testing.assert_allclose(tangent, series, atol=ROUND_OFF * scale, rtol=0)


def test_tangent_is_the_derivative_of_exp(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    """d exp(Ω) exp(Ω)⁻¹ = T(Ω) dΩ, by central differences."""
    exp = compiled(lie.exp)
    h = 1e-6
    forward, backward = (np.asarray(exp(twists[:, None] + step * np.eye(6))) for step in (h, -h))
    spatial = (forward - backward) / (2 * h) @ np.linalg.inv(maps["exp"])[:, None]
    columns = np.stack(
        [
            spatial[..., 2, 1],
            spatial[..., 0, 2],
            spatial[..., 1, 0],
            *np.moveaxis(spatial[..., :3, 3], -1, 0),
        ],
        axis=1,
    )
    # Round-off 1e-16·10/1e-6 in the difference, times |p| up to 10 from the inverse.
    np.testing.assert_allclose(columns, maps["tangent"], atol=3e-8, rtol=0)


def test_exp_of_the_opposite_twist_is_the_inverse(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    back = np.asarray(compiled(lie.exp)(-twists))
    np.testing.assert_allclose(
        maps["exp"] @ back, np.broadcast_to(np.eye(4), back.shape), atol=ROUND_OFF, rtol=0
    )


def test_inverse_undoes_a_pose(maps: dict[str, np.ndarray]) -> None:
    product = maps["exp"] @ np.asarray(compiled(lie.inverse)(maps["exp"]))
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(4), product.shape), atol=ROUND_OFF, rtol=0)


def test_adjoint_of_exp_is_exp_of_ad(maps: dict[str, np.ndarray]) -> None:
    adjoint = np.asarray(compiled(lie.adjoint)(maps["exp"]))
    for actual, ad in zip(adjoint, maps["ad"], strict=True):
        # Products p × R of entries up to 10: one digit more than exp itself.
        np.testing.assert_allclose(actual, expm(ad), atol=10 * ROUND_OFF, rtol=0)


def test_adjoint_follows_products(maps: dict[str, np.ndarray]) -> None:
    g, h = maps["exp"], maps["exp"][::-1]
    adjoint = compiled(lie.adjoint)
    np.testing.assert_allclose(adjoint(g) @ adjoint(h), adjoint(g @ h), atol=100 * ROUND_OFF, rtol=0)


def test_adjoint_carries_a_twist_to_the_world(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    """g x̂ g⁻¹ is the matrix of Ad(g) x."""
    x = twists[::-1]
    adjoint = np.asarray(compiled(lie.adjoint)(maps["exp"]))
    for g, ad_g, local in zip(maps["exp"], adjoint, x, strict=True):
        world = ad_g @ local
        np.testing.assert_allclose(g @ matrix(local) @ np.linalg.inv(g), matrix(world), atol=1e-10, rtol=0)


def test_bracket_is_the_commutator(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    for x, y, ad in zip(twists, twists[::-1], maps["ad"], strict=True):
        np.testing.assert_allclose(ad @ y, bracket(x, y), atol=100 * ROUND_OFF, rtol=0)


def test_bracket_is_antisymmetric_and_satisfies_jacobi(
    twists: np.ndarray, maps: dict[str, np.ndarray]
) -> None:
    ad = maps["ad"]
    x, y, z = twists, twists[::-1], np.roll(twists, 7, axis=0)
    ad_y, ad_z = ad[::-1], np.roll(ad, 7, axis=0)

    def apply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("nij,nj->ni", a, b)

    np.testing.assert_array_equal(apply(ad, y), -apply(ad_y, x))
    jacobi = apply(ad, apply(ad_y, z)) + apply(ad_y, apply(ad_z, x)) + apply(ad_z, apply(ad, y))
    # Sums of products of three numbers up to 10.
    np.testing.assert_allclose(jacobi, 0.0, atol=1e-9)


def test_coad_is_the_transposed_bracket(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    """C(w) y = ad(y)ᵀ w."""
    w, y = twists, twists[::-1]
    left = np.einsum("nij,nj->ni", maps["coad"], y)
    right = np.einsum("nji,nj->ni", maps["ad"][::-1], w)
    np.testing.assert_allclose(left, right, atol=1e-11, rtol=0)


def test_hat_is_the_cross_product(twists: np.ndarray) -> None:
    a, b = twists[:, :3], twists[:, 3:]
    product = np.einsum("nij,nj->ni", lie.hat(jnp.asarray(a)), b)
    np.testing.assert_allclose(product, np.cross(a, b), atol=1e-12, rtol=0)


def test_inverse_of_the_tangent(twists: np.ndarray, maps: dict[str, np.ndarray]) -> None:
    below = np.linalg.norm(twists[:, :3], axis=1) < 6.0  # at 2π there is none
    products = (maps["tangent_inverse"] @ maps["tangent"])[below]
    assert below.sum() > 30
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(6), products.shape), atol=ROUND_OFF, rtol=0)


def test_translation_shifts() -> None:
    p = np.array([1.0, -2.0, 3.0])
    np.testing.assert_array_equal(lie.translation(jnp.asarray(p)) @ np.array([0, 0, 0, 1.0]), [*p, 1.0])


@pytest.fixture(scope="module")
def jet() -> Callable:
    """First and second derivatives of exp (its first 16 numbers) and tangent (the other 36)."""

    def both(twist: jax.Array) -> jax.Array:
        return jnp.concatenate([lie.exp(twist).ravel(), lie.tangent(twist).ravel()])

    first = jax.jacfwd(both)
    return compiled(lambda twist: (first(twist), jax.jacfwd(first)(twist)))


def test_derivatives_of_exp_at_zero(jet: Callable) -> None:
    """∂exp/∂x_i = E_i and ∂²exp/∂x_i∂x_j = ½ (E_i E_j + E_j E_i), with E_i the matrix of unit twist i."""
    e = np.array([matrix(unit) for unit in np.eye(6)])
    first, second = jet(np.zeros(6))
    np.testing.assert_allclose(first[:16], np.moveaxis(e, 0, -1).reshape(16, 6), atol=1e-15)
    product = np.einsum("iab,jbc->acij", e, e)
    expected = 0.5 * (product + np.swapaxes(product, 2, 3))
    np.testing.assert_allclose(second[:16], expected.reshape(16, 6, 6), atol=1e-15)


def test_derivatives_of_tangent_at_zero(jet: Callable) -> None:
    """From the series: ∂T/∂x_i = ½ ad(e_i) and ∂²T/∂x_i∂x_j = ⅙ (ad(e_i) ad(e_j) + ad(e_j) ad(e_i))."""
    ad = np.asarray(lie.ad(jnp.eye(6)))
    first, second = jet(np.zeros(6))
    np.testing.assert_allclose(first[16:], 0.5 * np.moveaxis(ad, 0, -1).reshape(36, 6), atol=1e-15)
    product = np.einsum("iab,jbc->acij", ad, ad)
    expected = (product + np.swapaxes(product, 2, 3)) / 6
    np.testing.assert_allclose(second[16:], expected.reshape(36, 6, 6), atol=1e-15)


def test_second_derivatives_are_smooth_across_the_branch(jet: Callable) -> None:
    """Series and closed form meet at one radian, in value and in both derivatives."""
    twist = np.array([0.6, 0.0, 0.8, 1.0, -2.0, 0.5])
    (first_below, below), (first_above, above) = (jet(twist * (1 + sign * 1e-9)) for sign in (-1, 1))
    # Two points 2e-9 apart, next derivatives of order one; the closed forms lose up to five digits there.
    np.testing.assert_allclose(first_below, first_above, atol=1e-8, rtol=0)
    np.testing.assert_allclose(below, above, atol=1e-8, rtol=0)


# Angles beyond half a turn come back as the shorter way; at half a turn the axis is either of two.
SHORT = st.floats(0.0, np.pi - 1e-6)
COMPONENT = st.floats(-10.0, 10.0)


@settings(max_examples=200, deadline=None)
@given(angle=SHORT, axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3), linear=st.tuples(*[COMPONENT] * 3))
@example(angle=0.0, axis=(1.0, 0.0, 0.0), linear=(0.0, 0.0, 0.0))
@example(angle=1e-12, axis=(0.0, 1.0, 0.0), linear=(1.0, 2.0, 3.0))
@example(angle=np.pi - 1e-6, axis=(0.0, 0.6, -0.8), linear=(1.0, 2.0, 3.0))
def test_log_undoes_exp(
    round_trip: Callable, angle: float, axis: tuple[float, ...], linear: tuple[float, ...]
) -> None:
    length = np.linalg.norm(axis)
    direction = np.array(axis) / length if length > 0.1 else np.array([0.0, 0.0, 1.0])
    twist = np.concatenate([angle * direction, linear])
    # Round-off in a pose moves its twist by no more than itself, also near half a turn.
    np.testing.assert_allclose(round_trip(twist)[0], twist, atol=ROUND_OFF, rtol=0)


def test_exp_undoes_log(maps: dict[str, np.ndarray]) -> None:
    """For every pose, whole and half turns among them; the twist is the shorter one."""
    twists = np.asarray(compiled(lie.log)(maps["exp"]))
    assert np.linalg.norm(twists[:, :3], axis=1).max() <= np.pi + 1e-12
    again = np.asarray(compiled(lie.exp)(twists))
    np.testing.assert_allclose(again, maps["exp"], atol=10 * ROUND_OFF, rtol=0)


def test_log_keeps_tiny_rotations() -> None:
    tiny = jnp.array([1e-12, -2e-13, 3e-12, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(lie.log(lie.exp(tiny)), tiny, rtol=1e-12, atol=0)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.3463, 0.3466, 0.9999, 1.0001, 2.5, 3.14])
def test_derivatives_of_log_undo_those_of_exp(round_trip: Callable, angle: float) -> None:
    """log ∘ exp is the identity, so its first derivative is I and its second 0; also where series end."""
    _, first, second = round_trip(np.array([0.6 * angle, 0.0, 0.8 * angle, 1.0, -2.0, 0.5]))
    np.testing.assert_allclose(first, np.eye(6), atol=1e-13)
    np.testing.assert_allclose(second, 0.0, atol=1e-12)


@pytest.fixture(scope="module")
def round_trip() -> Callable:
    """log(exp(twist)) with its first and second derivatives."""

    def there_and_back(twist: jax.Array) -> jax.Array:
        return lie.log(lie.exp(twist))

    first = jax.jacfwd(there_and_back)
    return compiled(lambda twist: (there_and_back(twist), first(twist), jax.jacfwd(first)(twist)))
