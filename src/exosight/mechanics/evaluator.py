"""The energy of a robot at a trial point, with what its terms remember, and linear equations there.

These functions are run by XLA, or as programs (`exosight.scalar_program`); both differ by round-off.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.mechanics.energy import Evaluation, potential
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.metric import Metric
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories

Energy: TypeAlias = Callable[[Float[Array, " dofs"], Float[Array, " channels"]], tuple[Evaluation, Motion]]
"""`potential` of a robot."""


class Reached(NamedTuple):
    """What a step leads to.

    gradient   ∇Π of the step
    memories   what the terms remember if it ends there
    ended      whether it does
    here       Π with its derivatives, of the next step if so
    """

    gradient: Float[Array, " dofs"]
    memories: Memories
    ended: Bool[Array, ""]
    here: Evaluation


def reach(
    robot: Robot,
    metric: Metric,
    energy: Energy,
    q: Float[Array, " dofs"],
    loads: Float[Array, " channels"],
    memories: Memories,
    least: Float[AnyArray, ""],
) -> tuple[Reached, Motion]:
    """What a step to q leads to, and the motion there.

    energy   `potential(robot)`, for robots without memories: so what depends on the design alone is computed
             once. What the two energies of those with some have in common is compiled once.
    least    a step ends there if its residual is at least so large
    """
    if not memories:
        found, motion = energy(q, loads)
        return Reached(found.gradient, (), jnp.array(False), found), motion
    robot = robot.with_memories(memories)
    found, motion = potential(robot)(q, loads)
    remembered = robot.remember(motion, loads)
    ended = metric.residual(q, found.gradient) >= least
    now = tuple(jnp.where(ended, new, old) for new, old in zip(remembered, memories, strict=True))
    here, _ = potential(robot.with_memories(now))(q, loads)
    return Reached(found.gradient, remembered, ended, here), motion


def step_fraction(robot: Robot, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
    """How much of a step from there the expansion of the energy holds for."""
    fractions = [term.max_step_fraction(robot, motion, step) for term in robot.terms]
    return jnp.min(jnp.stack([jnp.array(1e30), *fractions]))


def solve_definite(matrix: AnyArray, right: AnyArray) -> tuple[Array, Array]:
    """matrix⁻¹ right, and whether the symmetric matrix is positive definite; else it means nothing."""
    factor = jnp.linalg.cholesky(matrix, symmetrize_input=False)
    last = factor[-1, -1]  # not a number if a pivot before was not positive
    return cho_solve((factor, True), right), jnp.isfinite(last) & (last > 0)


def solve_signed(matrix: AnyArray, right: AnyArray) -> tuple[Array, Array]:
    """matrix⁻¹ right, and the sign of det matrix, 0 where it has no solution that is of use.

    By elimination without exchanging rows, as a matrix whose symmetric part is positive definite needs none.
    Source: Golub and Van Loan, Matrix Computations, section 4.3.2.
    """
    solved, pivots = _eliminated(matrix, right, exchanging=False)
    whole = jnp.all(jnp.isfinite(pivots)) & jnp.all(pivots != 0)
    return solved, jnp.where(whole, jnp.prod(jnp.sign(pivots)), 0.0)


def solve_any(matrix: AnyArray, right: AnyArray) -> Array:
    """matrix⁻¹ right, exchanging rows so that the largest pivot of each column comes first."""
    return _eliminated(matrix, right, exchanging=True)[0]


def _eliminated(matrix: AnyArray, right: AnyArray, exchanging: bool) -> tuple[Array, Array]:
    """matrix⁻¹ right, and the pivots; written out, as programs cannot call LAPACK."""
    count = len(matrix)
    left = jnp.concatenate([matrix, right], axis=1)
    rows = []
    for _ in range(count):
        if exchanging and len(left) > 1:
            place = jnp.argmax(jnp.abs(left[:, 0]))
            first = left.at[place].get(mode="promise_in_bounds")
            others = jnp.where((jnp.arange(1, len(left)) == place)[:, None], left[0], left[1:])
            left = jnp.concatenate([first[None], others])
        row = left[0] / left[0, 0]
        rows.append((left[0, 0], row[1:]))
        left = left[1:, 1:] - left[1:, :1] * row[1:]
    solved: list[Array] = []
    for at, (_, row) in zip(range(count)[::-1], rows[::-1], strict=True):
        known = row[count - 1 - at :]
        if solved:
            known = known - row[: count - 1 - at] @ jnp.stack(solved[::-1])
        solved.append(known)
    return jnp.stack(solved[::-1]), jnp.stack([pivot for pivot, _ in rows])
