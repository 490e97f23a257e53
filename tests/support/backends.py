"""What scalar programs and XLA make of one robot, compared."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from benchmarks.timing import program

from exosight.mechanics import Robot
from exosight.mechanics.energy import potential
from exosight.mechanics.evaluator import Reached, reach, step_fraction
from exosight.mechanics.metric import Metric
from exosight.mechanics.path_step import prepare
from exosight.scalar_program import Held

SAME = 1e-12
"""Relative to the largest number of its kind: some thousand sums of round-off 1e-16."""

NEVER = jnp.array(jnp.inf)
"""No step ends that is evaluated."""


def both(
    robot: Robot, q: np.ndarray, loads: np.ndarray, step: np.ndarray, least: jax.Array = NEVER
) -> list[list[np.ndarray]]:
    """What a program and XLA give for several poses."""
    made = program(robot, loads.shape[1])
    assert made is not None

    def by_program(robot: Robot, *at: Any) -> tuple[Reached, Any]:
        return made(1, Held.of(prepare(made, robot)), at)

    def by_xla(robot: Robot, *at: Any) -> tuple[Reached, Any]:
        return reach(robot, Metric.of(robot), potential(robot), *at)

    def of(evaluate: Callable, fraction: Callable) -> list[np.ndarray]:
        def run(robot: Robot, q: jax.Array, loads: jax.Array, step: jax.Array) -> list:
            reached, pose = evaluate(robot, q, loads, robot.memories, least)
            found = [reached.gradient, *reached.memories, *jax.tree.leaves(reached.here)]
            return [*found, fraction(robot, pose, step)]

        return jax.jit(
            lambda robot, *at: jax.vmap(lambda *at: run(robot, *at))(*at),
            compiler_options={"xla_backend_optimization_level": "0"},
        )(jax.tree.map(jnp.asarray, robot), q, loads, step)

    return [of(by_program, lambda _, pose, step: made(2, pose, step)[0]), of(by_xla, step_fraction)]


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
