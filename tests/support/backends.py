"""What scalar programs and XLA make of one robot, compared."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from exosight.mechanics import Robot
from exosight.mechanics.evaluator import Evaluator, by_program, by_xla, prepare, program_of
from exosight.mechanics.known_numbers import known_numbers
from exosight.mechanics.metric import Metric
from exosight.scalar_program import Unrolled

SAME = 1e-12
"""Relative to the largest number of its kind: some thousand sums of round-off 1e-16."""

NEVER = jnp.array(jnp.inf)
"""No step ends that is evaluated."""


def both(
    robot: Robot, q: np.ndarray, loads: np.ndarray, step: np.ndarray, least: jax.Array = NEVER
) -> list[list[np.ndarray]]:
    """What a program and XLA give for several poses."""
    leaves, structure = jax.tree.flatten(robot)
    known = known_numbers(structure, [np.asarray(leaf)[None] for leaf in leaves])  # as solvers have it
    program = program_of(structure, tuple(np.shape(leaf) for leaf in leaves), loads.shape[1], known)
    assert program is not None

    def run(evaluator: Evaluator, robot: Robot, q: jax.Array, loads: jax.Array, step: jax.Array) -> list:
        reached, pose = evaluator.evaluate(q, loads, robot.memories, least)
        found = [reached.gradient, *reached.memories, *jax.tree.leaves(reached.here)]
        return [*found, evaluator.step_fraction(pose, step)]

    def of(make: Any) -> list[np.ndarray]:
        return jax.jit(
            lambda robot, *at: jax.vmap(lambda *at: run(make(robot), robot, *at))(*at),
            compiler_options={"xla_backend_optimization_level": "0"},
        )(jax.tree.map(jnp.asarray, robot), q, loads, step)

    return [of(lambda robot: programmed(program, robot)), of(compiled)]


def programmed(program: Unrolled, robot: Robot) -> Evaluator:
    return by_program(program, Metric.of(robot), prepare(program, robot))


def compiled(robot: Robot) -> Evaluator:
    return by_xla(robot, Metric.of(robot))


def check(robot: Robot, size: float = 0.2, channels: int | None = None, least: jax.Array = NEVER) -> None:
    """Both give the same at random poses, what terms remember included.

    least   residual from which on a step ends at a pose, and its terms remember it
    """
    rng = np.random.default_rng(0)
    count = channels or max(1, robot.loads)
    q, step = (rng.normal(size=(9, robot.dofs)) * scale for scale in (size, 0.1 * size))
    ours_all, theirs_all = both(robot, q, rng.uniform(0, 2, size=(9, count)), step, least)
    for ours, theirs in zip(ours_all, theirs_all, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=SAME * max(1e-300, np.abs(theirs).max()))
