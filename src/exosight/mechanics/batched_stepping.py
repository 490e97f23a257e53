"""Many robots a few loads further, each from where it stands: one step of a batch of simulations.

`follow` solves whole paths, known beforehand; here robots come back after every step, and what each gets next
may depend on what all of them showed. Nothing but poses and loads crosses between Python and compiled code.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.cpu import cores
from exosight.mechanics.batched_continuation import width
from exosight.mechanics.equilibrium import SolverOptions
from exosight.mechanics.newton import ContinuationState, begin, newton_stepper
from exosight.mechanics.robot import Robot

_DEFAULT = SolverOptions()
_ROOM = 8  # loads a compiled call: more would be memory that most steps do not use, fewer would be more calls


class BatchStep(NamedTuple):
    """Where each robot has come.

    q          (robots, dofs)       the last equilibrium on the way
    loads      (robots, channels)   the loads there [N]
    converged  (robots,)            those are the loads that were asked for
    """

    q: Float[np.ndarray, "robots dofs"]
    loads: Float[np.ndarray, "robots channels"]
    converged: Bool[np.ndarray, " robots"]


def step_batch(
    robots: Robot,
    q: Float[np.ndarray, "robots dofs"],
    start: Float[np.ndarray, "robots channels"],
    end: Float[np.ndarray, "robots channels"],
    steps: Int[np.ndarray, " robots"],
    options: SolverOptions = _DEFAULT,
) -> BatchStep:
    """Each robot from its equilibrium at one load to that at another, in even steps.

    robots   stacked, see `stack`
    q        (robots, dofs)       equilibria at `start`
    start    (robots, channels)   [N]
    end      (robots, channels)   [N]
    steps    (robots,)            how many, at least 1; robots with few do not wait for those with many

    A robot that finds no stable equilibrium on its way stays in the last one, and says so.
    """
    q, at = q.copy(), start.copy()
    good = np.ones(len(q), bool)
    size = (end - start) / steps[:, None]
    for first in range(0, int(steps.max()), _ROOM):
        left = np.where(good, np.clip(steps - first, 0, _ROOM), 0)
        number = np.minimum(first + 1 + np.arange(_ROOM), steps[:, None])
        loads = start[:, None] + number[:, :, None] * size[:, None]
        # The last load is the one asked for, to the last digit.
        loads = np.where((number == steps[:, None])[:, :, None], end[:, None], loads)
        # Neighbours in the order have about as much to do: as many loads, as far apart.
        order = np.lexsort((-np.abs(size).max(axis=1), -left))[: np.count_nonzero(left)]
        for part, found, count in _solve(robots, q, loads, left, order, options):
            moved = part[count > 0]
            q[moved] = found[count > 0]
            at[moved] = loads[moved, count[count > 0] - 1]
            good[part] = count == left[part]
    return BatchStep(q, at, good)


def _solve(
    robots: Robot,
    q: Float[np.ndarray, "robots dofs"],
    loads: Float[np.ndarray, "robots room channels"],
    left: Int[np.ndarray, " robots"],
    order: Int[np.ndarray, " some"],
    options: SolverOptions,
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """For each group of the robots in `order`: who, their last equilibria, how many loads they solved."""
    lanes = width(options.lanes, len(q))
    leaves, structure = jax.tree.flatten(robots)
    leaves = [np.asarray(leaf) for leaf in leaves]
    limits = np.asarray(options.tolerance), np.asarray(options.max_iterations)

    def work(group: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # Always the same number of lanes, so that code is compiled once; spare ones have nothing to do.
        rows = np.concatenate([group, np.repeat(group[:1], lanes - len(group))])
        count = np.where(np.arange(lanes) < len(group), left[rows], 0)
        own = jax.tree.unflatten(structure, [leaf[rows] for leaf in leaves])
        found, solved = _compiled(own, q[rows], loads[rows], count, *limits)
        return group, np.asarray(found)[: len(group)], np.asarray(solved)[: len(group)]

    groups = [order[first : first + lanes] for first in range(0, len(order), lanes)]
    if len(groups) < 2 or jax.default_backend() != "cpu":
        yield from map(work, groups)
        return
    with ThreadPoolExecutor(max_workers=cores()) as pool:  # compiled calls release Python's lock
        yield from pool.map(work, groups)


# One thread an operation, as in `batched_continuation`: the lanes of a thread are its work.
@partial(jax.jit, compiler_options={"xla_cpu_multi_thread_eigen": False})
def _compiled(
    robots: Robot,
    q: Float[Array, "lanes dofs"],
    loads: Float[Array, "lanes room channels"],
    count: Int[Array, " lanes"],
    tolerance: Float[AnyArray, ""],
    max_iterations: Int[AnyArray, ""],
) -> tuple[Float[Array, "lanes dofs"], Int[Array, " lanes"]]:
    """The last equilibrium of each robot, and how many of its loads were solved one after the other."""

    def one(robot: Robot, q: Array, loads: Array, count: Array) -> tuple[Array, Array]:
        places = len(loads)
        parents = jnp.arange(-1, places - 1)
        starts = jnp.broadcast_to(q, (places, len(q)))
        step = newton_stepper(robot, loads, parents, starts, count, tolerance, max_iterations)

        def going(path: ContinuationState) -> Array:
            lost = jnp.any(~path.converged & (jnp.arange(places) < path.load))
            return jax.lax.psum(((path.load < count) & ~lost).astype(int), "lanes") > 0

        path = jax.lax.while_loop(going, step, begin(q, places, loads.shape[1]))
        solved = jnp.sum(jnp.cumprod(path.converged & (jnp.arange(places) < count)))
        return jnp.where(solved > 0, path.found[solved - 1], q), solved

    return jax.vmap(one, axis_name="lanes")(robots, q, loads, count)
