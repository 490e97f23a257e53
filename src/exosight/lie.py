"""Rigid motions: the groups SO(3) and SE(3) as used by rods and joints.

Twists are ordered [angular; linear], wrenches [moment; force]; a pose is a 4×4 matrix
g = [R p; 0 1] that maps local to world coordinates. Every function takes leading batch
dimensions.

Source of the closed forms: Selig, Geometric Fundamentals of Robotics, 2005, ch. 4;
Barfoot, State Estimation for Robotics, 2017, eq. 7.86 (left Jacobian of SE(3)).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray

# The five functions of θ² below are Σ_k (−θ²)^k c_k. Up to one radian eleven terms of the series are
# exact to the last bit, and so are their first and second derivatives; the closed forms lose all
# digits as θ → 0 (e divides a difference of order θ⁵ by θ⁵).
_TERMS = 11
_FACTORIAL = np.cumprod([1.0, *range(1, 2 * _TERMS + 6)])
_SERIES = np.array(
    [[1.0 / _FACTORIAL[2 * k + m] for k in range(_TERMS)] for m in (1, 2, 3, 4)]
    + [[(k + 1) / _FACTORIAL[2 * k + 5] for k in range(_TERMS)]]
)


@jax.jit
def _coefficients(omega: Float[AnyArray, "*batch 3"]) -> tuple[Array, Array, Array, Array, Array]:
    """sinθ/θ, (1−cosθ)/θ², (θ−sinθ)/θ³, (θ²+2cosθ−2)/2θ⁴, (2θ−3sinθ+θcosθ)/2θ⁵ with θ = |omega|."""
    x = jnp.sum(omega * omega, axis=-1)
    small = x < 1.0
    # The unused branch is evaluated at a regular angle, so that its derivatives stay finite.
    near, far = jnp.where(small, x, 0.0), jnp.where(small, 1.0, x)
    theta = jnp.sqrt(far)
    sin, cos = jnp.sin(theta), jnp.cos(theta)
    closed = (
        sin / theta,
        (1 - cos) / far,
        (theta - sin) / (far * theta),
        (far + 2 * cos - 2) / (2 * far * far),
        (2 * theta - 3 * sin + theta * cos) / (2 * far * far * theta),
    )
    minus, series = -near[..., None], jnp.zeros((*near.shape, 5))
    for k in reversed(range(_TERMS)):
        series = series * minus + _SERIES[:, k]
    a, b, c, d, e = (jnp.where(small, series[..., i], f) for i, f in enumerate(closed))
    return a, b, c, d, e


# θ/2 = asin|v|, so (θ/2)/|v| = Σ c_k |v|^2k; exact up to |v|² = 0.03, a third of a radian.
_ARCSINE = np.cumprod([1.0, *((2 * k - 1) / (2 * k) for k in range(1, _TERMS))]) / (2 * np.arange(_TERMS) + 1)
# (1 − θ/2 cot θ/2)/θ² = Σ |B_2k|/(2k)! θ^(2k−2), k ≥ 1, with Bernoulli's numbers; exact up to one radian.
_BERNOULLI = np.array([1, 1, 1, 1, 5, 691, 7, 3617, 43867, 174611, 854513]) / np.array(
    [6, 30, 42, 30, 66, 2730, 6, 510, 798, 330, 138]
)
_COTANGENT = _BERNOULLI / _FACTORIAL[2 : 2 * _TERMS + 1 : 2]


@jax.jit
def hat(omega: Float[AnyArray, "*batch 3"]) -> Float[Array, "*batch 3 3"]:
    """The matrix of the cross product: hat(ω) x = ω × x."""
    x, y, z = omega[..., 0], omega[..., 1], omega[..., 2]
    zero = jnp.zeros_like(x)
    rows = jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return rows.reshape(*omega.shape[:-1], 3, 3)


@jax.jit
def pose(
    rotation: Float[AnyArray, "*batch 3 3"], position: Float[AnyArray, "*batch 3"]
) -> Float[Array, "*batch 4 4"]:
    """The 4×4 matrix of a rotation and a position [m]."""
    top = jnp.concatenate([rotation, position[..., None]], axis=-1)
    bottom = jnp.broadcast_to(jnp.array([0.0, 0.0, 0.0, 1.0]), (*top.shape[:-2], 1, 4))
    return jnp.concatenate([top, bottom], axis=-2)


def translation(position: Float[AnyArray, "*batch 3"]) -> Float[Array, "*batch 4 4"]:
    """The pose of a pure translation by `position` [m]."""
    return pose(jnp.broadcast_to(jnp.eye(3), (*position.shape[:-1], 3, 3)), position)


@jax.jit
def inverse(g: Float[AnyArray, "*batch 4 4"]) -> Float[Array, "*batch 4 4"]:
    """The inverse pose: the world in coordinates of the frame g."""
    back = jnp.swapaxes(g[..., :3, :3], -1, -2)
    return pose(back, -jnp.einsum("...ij,...j->...i", back, g[..., :3, 3]))


@jax.jit
def exp(twist: Float[AnyArray, "*batch 6"]) -> Float[Array, "*batch 4 4"]:
    """The pose reached by moving along `twist` for unit time: exp of its 4×4 matrix."""
    omega, v = twist[..., :3], twist[..., 3:]
    a, b, c, _, _ = _coefficients(omega)
    w = hat(omega)
    ww = w @ w
    eye = jnp.eye(3)
    rotation = eye + a[..., None, None] * w + b[..., None, None] * ww
    left = eye + b[..., None, None] * w + c[..., None, None] * ww
    return pose(rotation, jnp.einsum("...ij,...j->...i", left, v))


@jax.jit
def log(g: Float[AnyArray, "*batch 4 4"]) -> Float[Array, "*batch 6"]:
    """The twist whose `exp` is the pose, with a rotation of at most π: the inverse of `exp` up to there.

    First and second derivatives along poses are finite and exact, at the identity too. At half a turn the
    sign of the axis is ambiguous, so there the twist jumps from ω to −ω.
    """
    w, v = _quaternion(g[..., :3, :3])
    x = jnp.sum(v * v, axis=-1)
    small = x < 0.03
    # As above: the unused branch is evaluated where its derivatives are finite.
    norm = jnp.sqrt(jnp.where(small, 1.0, x))
    far = jnp.arctan2(norm, jnp.where(small, 1.0, w)) / norm
    half = jnp.where(small, _polynomial(_ARCSINE, jnp.where(small, x, 0.0)), far)  # (θ/2)/sin(θ/2)
    omega = 2 * half[..., None] * v
    x = jnp.sum(omega * omega, axis=-1)
    small = x < 1.0
    far = (1 - w * half) / jnp.where(small, 1.0, x)
    k = jnp.where(small, _polynomial(_COTANGENT, jnp.where(small, x, 0.0)), far)
    turn = hat(omega)
    back = jnp.eye(3) - 0.5 * turn + k[..., None, None] * (turn @ turn)
    return jnp.concatenate([omega, jnp.einsum("...ij,...j->...i", back, g[..., :3, 3])], axis=-1)


def _quaternion(rotation: Float[AnyArray, "*batch 3 3"]) -> tuple[Array, Array]:
    """cos θ/2 ≥ 0 and sin θ/2 · axis; from the largest of the four, to avoid division by zero.

    Source: Shepperd, Quaternion from rotation matrix, 1978.
    """
    r = rotation
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    odd = jnp.stack(
        [r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1
    )
    even = r + jnp.swapaxes(r, -1, -2)
    squares = jnp.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1)
    chosen = jnp.arange(4) == jnp.argmax(squares, axis=-1)[..., None]
    diagonal = jnp.eye(3) * squares[..., 1:, None]
    rows = even * (1 - jnp.eye(3)) + diagonal  # 4 v_i v
    table = jnp.concatenate(
        [
            jnp.concatenate([squares[..., :1], odd], axis=-1)[..., None, :],
            jnp.concatenate([odd[..., :, None], rows], axis=-1),
        ],
        axis=-2,
    )  # 4 times the products of all pairs
    row = jnp.sum(jnp.where(chosen[..., None], table, 0.0), axis=-2)
    largest = jnp.sum(jnp.where(chosen, squares, 0.0), axis=-1, keepdims=True)
    whole = row / (2 * jnp.sqrt(largest))
    whole = jnp.where(whole[..., :1] < 0, -whole, whole)
    return whole[..., 0], whole[..., 1:]


def _polynomial(coefficients: np.ndarray, x: Array) -> Array:
    """Σ c_k x^k."""
    total = jnp.zeros_like(x)
    for c in reversed(coefficients):
        total = total * x + c
    return total


@jax.jit
def ad(twist: Float[AnyArray, "*batch 6"]) -> Float[Array, "*batch 6 6"]:
    """The Lie bracket as a matrix: ad(x) y = [x, y]."""
    w, v = hat(twist[..., :3]), hat(twist[..., 3:])
    return _blocks(w, jnp.zeros_like(w), v, w)


@jax.jit
def coad(wrench: Float[AnyArray, "*batch 6"]) -> Float[Array, "*batch 6 6"]:
    """The matrix C(w) with C(w) y = ad(y)ᵀ w, so that wᵀ[y, s] = sᵀ C(w) y."""
    m, f = hat(wrench[..., :3]), hat(wrench[..., 3:])
    return _blocks(m, f, f, jnp.zeros_like(f))


@jax.jit
def adjoint(g: Float[AnyArray, "*batch 4 4"]) -> Float[Array, "*batch 6 6"]:
    """Ad(g): a twist in local coordinates to the same twist in world coordinates."""
    rotation = g[..., :3, :3]
    return _blocks(rotation, jnp.zeros_like(rotation), hat(g[..., :3, 3]) @ rotation, rotation)


@jax.jit
def adjoint_on(
    g: Float[AnyArray, "*batch 4 4"], columns: Float[AnyArray, "*batch 6 k"]
) -> Float[Array, "*batch 6 k"]:
    """Ad(g) times columns, without the 6×6 matrix: (R ω, R v + p × R ω)."""
    rotation = g[..., :3, :3]
    turned = rotation @ columns[..., :3, :]
    moved = rotation @ columns[..., 3:, :] + hat(g[..., :3, 3]) @ turned
    return jnp.concatenate([turned, moved], axis=-2)


@jax.jit
def coadjoint_on(
    g: Float[AnyArray, "*batch 4 4"], wrench: Float[AnyArray, "*batch 6"]
) -> Float[Array, "*batch 6"]:
    """Ad(g)ᵀ times a wrench: the same wrench in coordinates of the frame g."""
    rotation, position, force = g[..., :3, :3], g[..., :3, 3], wrench[..., 3:]
    moment = wrench[..., :3] - jnp.cross(position, force)
    both = jnp.stack([moment, force], axis=-2) @ rotation  # rows times R: Rᵀ times each
    return both.reshape(wrench.shape)


@jax.jit
def tangent(twist: Float[AnyArray, "*batch 6"]) -> Float[Array, "*batch 6 6"]:
    """T(Ω) with d exp(Ω) · exp(Ω)⁻¹ = T(Ω) dΩ: the left Jacobian of SE(3)."""
    rotation, coupling = _tangent_blocks(twist)
    return _blocks(rotation, jnp.zeros_like(rotation), coupling, rotation)


@jax.jit
def tangent_inverse(twist: Float[AnyArray, "*batch 6"]) -> Float[Array, "*batch 6 6"]:
    """T(Ω)⁻¹, for rotations of less than 2π, where T has an inverse."""
    rotation, coupling = _tangent_blocks(twist)
    a, b, c = rotation[..., 0, :], rotation[..., 1, :], rotation[..., 2, :]
    columns = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)], axis=-1)
    back = columns / jnp.sum(a * columns[..., 0], axis=-1)[..., None, None]  # by the determinant
    return _blocks(back, jnp.zeros_like(back), -back @ coupling @ back, back)


@jax.jit
def tangent_on(
    twist: Float[AnyArray, "*batch 6"], columns: Float[AnyArray, "*batch 6 k"]
) -> Float[Array, "*batch 6 k"]:
    """T(Ω) times columns, without the 6×6 matrix."""
    rotation, coupling = _tangent_blocks(twist)
    angular, linear = columns[..., :3, :], columns[..., 3:, :]
    return jnp.concatenate([rotation @ angular, coupling @ angular + rotation @ linear], axis=-2)


@jax.jit
def _tangent_blocks(twist: Float[AnyArray, "*batch 6"]) -> tuple[Array, Array]:
    """The diagonal block of T and the one below it."""
    omega, v = twist[..., :3], twist[..., 3:]
    _, b, c, d, e = (k[..., None, None] for k in _coefficients(omega))
    outer = omega[..., :, None] * omega[..., None, :]
    both = omega[..., :, None] * v[..., None, :]
    square = jnp.sum(omega**2, axis=-1)[..., None]
    inner = jnp.sum(omega * v, axis=-1)[..., None]
    ww = outer - square[..., None] * jnp.eye(3)  # ω̂²
    rotation = jnp.eye(3) + b * hat(omega) + c * ww
    # Of the series' products of ω̂ and v̂: ω̂v̂ω̂ = −(ω·v) ω̂ and ω̂²v̂ + v̂ω̂² = −hat(|ω|² v + (ω·v) ω).
    skew = hat((0.5 - d[..., 0] * square) * v + (2 * d[..., 0] - c[..., 0]) * inner * omega)
    even = both + jnp.swapaxes(both, -1, -2) - 2 * inner[..., None] * jnp.eye(3)  # ω̂v̂ + v̂ω̂
    coupling = skew + c * even - 2 * e * inner[..., None] * ww
    return rotation, coupling


def _blocks(a: AnyArray, b: AnyArray, c: AnyArray, d: AnyArray) -> Array:
    return jnp.concatenate([jnp.concatenate([a, b], axis=-1), jnp.concatenate([c, d], axis=-1)], axis=-2)
