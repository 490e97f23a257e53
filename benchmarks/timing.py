"""Times of evaluations, measured in turns: what slows the machine down meanwhile meets all of them alike.

CPU time of the process, in which other programs on the machine hardly count.
"""

import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from exosight.mechanics import Robot
from exosight.mechanics.energy import potential
from exosight.mechanics.evaluator import Reached, reach, step_fraction
from exosight.mechanics.known_numbers import known_numbers, with_known
from exosight.mechanics.metric import Metric
from exosight.mechanics.path_step import prepare, program_of
from exosight.scalar_program import Held, Unrolled, Unsupported, unroll

LANES = 8
"""Poses of one evaluation: as many as the solver's."""

NEVER = np.inf
"""No step ends at a pose that is evaluated."""


def in_turns(
    runs: Mapping[str, Callable[[], Any]], seconds: float = 0.02, repeats: int = 15
) -> dict[str, float]:
    """CPU time of one call of each [s]: the median over turns in which each runs for so many seconds."""
    counts, spent = {}, {name: [] for name in runs}
    for name, run in runs.items():
        run()  # compiles
        started = time.process_time()
        run()
        counts[name] = max(1, round(seconds / max(time.process_time() - started, 1e-7)))
    for _ in range(repeats):
        for name, run in runs.items():
            started = time.process_time()
            for _ in range(counts[name]):
                run()
            spent[name].append((time.process_time() - started) / counts[name])
    return {name: statistics.median(own) for name, own in spent.items()}


def program(robot: Robot, channels: int = 1) -> Unrolled | None:
    """A scalar program of a robot's energy: of its design, a pose, and a step from there; None without one.

    With what solvers know of its numbers.
    """
    leaves, structure = jax.tree.flatten(robot)
    known = known_numbers(structure, [np.asarray(leaf)[None] for leaf in leaves])

    def function(leaves: list, at: tuple, step: jax.Array) -> tuple[tuple, Reached, jax.Array]:
        robot = jax.tree.unflatten(structure, with_known(structure, known, leaves))
        reached, motion = reach(robot, Metric.of(robot), potential(robot), *at)
        return (), reached, step_fraction(robot, motion, step)

    q = np.zeros(robot.dofs)
    try:
        return unroll(function, [leaves, (q, np.zeros(channels), robot.memories, np.zeros(())), q])
    except Unsupported:
        return None


def of_solver(robot: Robot, channels: int = 1) -> Unrolled | None:
    """The program of a whole step of a robot on its path, as the solver makes it."""
    leaves, structure = jax.tree.flatten(robot)
    known = known_numbers(structure, [np.asarray(leaf)[None] for leaf in leaves])
    return program_of(structure, tuple(np.shape(leaf) for leaf in leaves), channels, known)


def evaluation(
    robot: Robot,
    unrolled: bool,
    q: Float[np.ndarray, "lanes dofs"],
    loads: Float[np.ndarray, "lanes channels"],
) -> Callable[[], list[np.ndarray]]:
    """What finds energy, gradient and Hessian at several poses, by the robot's scalar program or by XLA."""
    made = program(robot, loads.shape[1]) if unrolled else None
    if unrolled and made is None:
        raise RuntimeError("there is no scalar program of this robot")
    metric = jax.jit(Metric.of)(robot)
    design = jnp.asarray(jax.jit(lambda robot: prepare(made, robot))(robot))

    def of_one(q: jax.Array, loads: jax.Array, robot: Robot) -> list[jax.Array]:
        at = q, loads, (), jnp.asarray(NEVER)
        if made is None:
            reached, _ = reach(robot, metric, potential(robot), *at)
        else:
            reached, _ = made(1, Held.of(design), at)
        return jax.tree.leaves(reached.here)

    options = {"xla_cpu_multi_thread_eigen": False}
    compiled = jax.jit(jax.vmap(of_one, in_axes=(0, 0, None)), compiler_options=options)
    return lambda: jax.block_until_ready(compiled(q, loads, robot))


def largest_difference(ours: list[np.ndarray], theirs: list[np.ndarray]) -> float:
    """Between results, relative to the largest number of each kind."""
    pairs = [(np.asarray(a), np.asarray(b)) for a, b in zip(ours, theirs, strict=True)]
    return max(float(np.abs(a - b).max() / max(np.abs(b).max(), 1e-300)) for a, b in pairs)
