"""How a solver evaluates the energy of a robot: unrolled (`exosight.scalar_program`) on a CPU, or by XLA.

Both run the same functions, `energy.potential` and the terms' `max_step_fraction`, and differ by round-off.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.mechanics.energy import Evaluation, potential
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.known_numbers import Known, with_known
from exosight.mechanics.metric import Metric
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories
from exosight.scalar_program import Unrolled, Unsupported, call_unrolled, unroll

Solve: TypeAlias = Callable[
    [Float[AnyArray, "dofs dofs"], Float[AnyArray, "dofs right"]],
    tuple[Float[Array, "dofs right"], Bool[Array, ""]],
]
"""(symmetric matrix, right sides) -> (solutions, whether it is positive definite; else they mean nothing)."""


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


class Evaluator(NamedTuple):
    """The energy of one robot.

    metric         its metric
    evaluate       (q, loads, memories, least) -> what a step leads to that ends there if its residual is
                   at least so large, and what `step_fraction` needs of that pose
    step_fraction  (that, step) -> how much of a step from there the expansion holds for
    solve          `solve_definite`
    call           (function, arguments) -> its results; a function of arrays that is the same for many robots
    """

    metric: Metric
    evaluate: Callable[
        [Float[Array, " dofs"], Float[Array, " channels"], Memories, Float[Array, ""]], tuple[Reached, Any]
    ]
    step_fraction: Callable[[Any, Float[Array, " dofs"]], Float[Array, ""]]
    solve: Solve
    call: Callable[..., Any]


def by_xla(robot: Robot, metric: Metric) -> Evaluator:
    """As JAX compiles it."""
    same = potential(robot)  # what depends on the design alone is computed once

    def evaluate(q: Array, loads: Array, memories: Memories, least: Array) -> tuple[Reached, Motion]:
        if memories:
            return _reached(robot, metric, q, loads, memories, least)
        found, motion = same(q, loads)
        return Reached(found.gradient, (), jnp.array(False), found), motion

    return Evaluator(
        metric,
        evaluate,
        lambda motion, step: _step_fraction(robot, motion, step),
        solve_definite,
        lambda function, *arguments: function(*arguments),
    )


def prepare(program: Unrolled | None, robot: Robot) -> Float[Array, " handed"]:
    """What a program of its structure computes of the robot alone; nothing without a program."""
    return jnp.asarray([] if program is None else program(0, None, jax.tree.leaves(robot))[1])


def by_program(program: Unrolled, metric: Metric, design: Float[AnyArray, " handed"]) -> Evaluator:
    """As a program of its structure; `design` from `prepare`."""

    def evaluate(q: Array, loads: Array, memories: Memories, least: Array) -> tuple[Reached, Any]:
        return program(1, design, (q, loads, memories, least))

    def solve(matrix: AnyArray, right: AnyArray) -> tuple[Array, Array]:
        return call_unrolled(solve_definite, matrix, right)

    return Evaluator(metric, evaluate, lambda pose, step: program(2, pose, (step,))[0], solve, call_unrolled)


@lru_cache(maxsize=64)
def program_of(
    structure: Hashable, shapes: Sequence[tuple[int, ...]], channels: int, known: Known = b""
) -> Unrolled | None:
    """The program of robots of a structure whose arrays have these shapes; None where there is none.

    known   `known_numbers` of all these robots

    There is none without a CPU, or where a function holds what cannot be unrolled.
    """
    if jax.default_backend() != "cpu":
        return None

    def function(
        leaves: list[Array], at: tuple[Array, Array, Memories, Array], step: tuple[Array]
    ) -> tuple[tuple, Reached, Array]:
        robot = jax.tree.unflatten(structure, with_known(structure, known, leaves))
        reached, motion = _reached(robot, Metric.of(robot), *at)
        return (), reached, _step_fraction(robot, motion, *step)

    leaves = [np.zeros(shape) for shape in shapes]
    robot = jax.tree.unflatten(structure, leaves)
    q = np.zeros(robot.dofs)
    arguments = [leaves, (q, np.zeros(channels), robot.memories, np.zeros(())), (q,)]
    try:
        return unroll(function, arguments)
    except Unsupported:
        return None


def solve_definite(matrix: AnyArray, right: AnyArray) -> tuple[Array, Array]:
    """matrix⁻¹ right, and whether the symmetric matrix is positive definite; else it means nothing."""
    factor = jnp.linalg.cholesky(matrix, symmetrize_input=False)
    last = factor[-1, -1]  # not a number if a pivot before was not positive
    return cho_solve((factor, True), right), jnp.isfinite(last) & (last > 0)


def _reached(
    robot: Robot, metric: Metric, q: Array, loads: Array, memories: Memories, least: Array
) -> tuple[Reached, Motion]:
    """As `Evaluator.evaluate`; what the two energies have in common is compiled once."""
    robot = robot.with_memories(memories)
    found, motion = potential(robot)(q, loads)
    remembered = robot.remember(motion, loads)
    if not memories:
        return Reached(found.gradient, remembered, jnp.array(False), found), motion
    ended = metric.residual(q, found.gradient) >= least
    now = tuple(jnp.where(ended, new, old) for new, old in zip(remembered, memories, strict=True))
    here, _ = potential(robot.with_memories(now))(q, loads)
    return Reached(found.gradient, remembered, ended, here), motion


def solve_signed(matrix: AnyArray, right: AnyArray) -> tuple[Array, Array]:
    """matrix⁻¹ right, and the sign of det matrix, 0 where it has no solution that is of use.

    By elimination without exchanging rows, of which programs can be made; a matrix whose symmetric part is
    positive definite needs no exchange. Source: Golub and Van Loan, Matrix Computations, section 4.3.2.
    """
    count = len(matrix)
    left = jnp.concatenate([matrix, right], axis=1)
    rows = []
    for _ in range(count):
        row = left[0] / left[0, 0]
        rows.append((left[0, 0], row[1:]))
        left = left[1:, 1:] - left[1:, :1] * row[1:]
    solved: list[Array] = []
    for at, (_, row) in zip(range(count)[::-1], rows[::-1], strict=True):
        known = row[count - 1 - at :]
        if solved:
            known = known - row[: count - 1 - at] @ jnp.stack(solved[::-1])
        solved.append(known)
    pivots = jnp.stack([pivot for pivot, _ in rows])
    whole = jnp.all(jnp.isfinite(pivots)) & jnp.all(pivots != 0)
    return jnp.stack(solved[::-1]), jnp.where(whole, jnp.prod(jnp.sign(pivots)), 0.0)


def _step_fraction(robot: Robot, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
    fractions = [term.max_step_fraction(robot, motion, step) for term in robot.terms]
    return jnp.min(jnp.stack([jnp.array(1e30), *fractions]))
