"""Many paths of loads side by side: a compiled loop over a few lanes, refilled as paths arrive.

What changes hands between Python and compiled code are NumPy arrays: indexing JAX arrays from Python costs a
dispatch each, which for thousands of robots is more than solving them.
"""

from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from threading import Lock
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from exosight.arrays import AnyArray
from exosight.cpu import cores
from exosight.mechanics.newton import ContinuationState, begin, metric_of, newton_stepper
from exosight.mechanics.robot import Robot


class ContinuationProblem(NamedTuple):
    """One robot and its path.

    robot
    loads     (loads, channels)   [N]
    parents   (loads,)            the earlier load that each starts from, −1: its row of `starts`
    starts    (loads, dofs)       where loads without a parent start
    """

    robot: Robot
    loads: Float[np.ndarray, "loads channels"]
    parents: Int[np.ndarray, " loads"]
    starts: Float[np.ndarray, "loads dofs"]


ROOM = 64
"""Loads that a lane takes at a time; longer paths go on in the same lane. One size, so one compilation."""

Solved = tuple[ContinuationState, Float[np.ndarray, "dofs dofs"]]
"""A path with what was found at each load, and the metric of its robot."""


def width(lanes: int | None, robots: int) -> int:
    """Lanes side by side: as asked for or as suits the device, but no more than the robots fill."""
    most = lanes or (8 if jax.default_backend() == "cpu" else 2048)
    return min(most, 1 << max(0, robots - 1).bit_length())


def solve_paths(
    jobs: Sequence[ContinuationProblem],
    tolerance: float,
    max_iterations: int,
    lanes: int | None = None,
    done: Callable[[int], None] = lambda jobs: None,
) -> list[Solved]:
    """Each job's finished path, and its robot's metric; all robots of one structure.

    done   called with the number of jobs finished, as they finish
    """
    on_cpu = jax.default_backend() == "cpu"
    lanes = width(lanes, len(jobs))
    advance = _compiled(jax.tree.structure(jobs[0].robot))
    leaves = [[np.asarray(leaf) for leaf in jax.tree.leaves(job.robot)] for job in jobs]
    queue = _Queue(len(jobs))
    results: list[list[Solved]] = [[] for _ in jobs]

    def next_part(number: int) -> _Lane:
        """What comes next on the path of a job."""
        return _lane(jobs[number], [np.asarray(path.found) for path, _ in results[number]])

    def work() -> None:
        numbers = queue.take(lanes)
        if not numbers:
            return
        # A lane without a job holds a copy of the first one, but stands still.
        filled = numbers + [numbers[0]] * (lanes - len(numbers))
        numbers += [-1] * (lanes - len(numbers))
        rows = [np.array([leaves[i][k] for i in filled]) for k in range(len(leaves[0]))]
        state = jax.tree.map(lambda *parts: np.array(parts), *(next_part(i) for i in filled))
        empty = np.array(numbers) < 0
        state.path.load[empty] = state.total[empty]
        while any(i >= 0 for i in numbers) and not queue.stopped:
            # While jobs wait, come back as soon as a quarter of the lanes is free for them.
            enough = min(lanes, numbers.count(-1) + max(1, lanes // 4))
            found, metrics = advance(rows, state, tolerance, max_iterations, enough)
            state, metrics = state._replace(path=jax.tree.map(np.array, found)), np.asarray(metrics)
            ready = np.flatnonzero((state.path.load == state.total) & (np.array(numbers) >= 0)).tolist()
            for at in ready:
                number = numbers[at]
                results[number].append((_cut(state.path, at, int(state.total[at])), metrics[at].copy()))
                if sum(len(path.found) for path, _ in results[number]) == len(jobs[number].loads):
                    done(1)
                    numbers[at] = number = next(iter(queue.take(1)), -1)
                    if number < 0:
                        continue
                    for into, row in zip(rows, leaves[number], strict=True):
                        into[at] = row
                for into, row in zip(jax.tree.leaves(state), jax.tree.leaves(next_part(number)), strict=True):
                    into[at] = row

    # Compiled calls release Python's lock, so one thread a core keeps every core busy.
    workers = min(cores(), -(-len(jobs) // lanes)) if on_cpu else 1
    if workers == 1:
        work()
        return [_joined(parts) for parts in results]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            for future in [pool.submit(work) for _ in range(workers)]:
                future.result()
        except BaseException:  # Ctrl-C too: the pool waits for its threads, which need not finish
            queue.stopped = True
            raise
    return [_joined(parts) for parts in results]


class _Lane(NamedTuple):
    """What a lane is working on: loads, which of them each starts from (−1: from its row of `starts`), how
    many there are, and how far it is.
    """

    loads: Float[AnyArray, "room channels"]
    parents: Int[AnyArray, " room"]
    starts: Float[AnyArray, "room dofs"]
    total: Int[AnyArray, ""]
    path: ContinuationState


def _lane(job: ContinuationProblem, parts: Sequence[np.ndarray]) -> _Lane:
    """The next loads of a job, after those of which q is known."""
    found = np.concatenate([job.starts[:0], *parts])
    done = len(found)
    loads, parents, starts = (x[done : done + ROOM] for x in (job.loads, job.parents, job.starts))
    inside = np.where(parents >= done, parents - done, -1)
    before = np.flatnonzero((parents >= 0) & (parents < done))
    starts = starts.copy()
    starts[before] = found[parents[before]]
    spare = ROOM - len(loads)
    return _Lane(
        loads=np.concatenate([loads, np.repeat(loads[-1:], spare, axis=0)]),
        parents=np.concatenate([inside, np.zeros(spare, dtype=int)]),
        starts=np.concatenate([starts, np.zeros((spare, starts.shape[1]))]),
        total=np.array(len(loads)),
        path=begin(starts[0], ROOM, loads.shape[1]),
    )


_SOLVED = ContinuationState._fields[ContinuationState._fields.index("found") :]


def _cut(path: ContinuationState, lane: int, count: int) -> ContinuationState:
    """One lane of a batch of paths, without the padding."""
    of = jax.tree.map(lambda leaf: leaf[lane].copy(), path)
    return of._replace(**{name: getattr(of, name)[:count] for name in _SOLVED})


def _joined(parts: Sequence[Solved]) -> Solved:
    """One path of all its parts."""
    paths = [path for path, _ in parts]
    whole = {name: np.concatenate([getattr(path, name) for path in paths]) for name in _SOLVED}
    return paths[-1]._replace(**whole), parts[-1][1]


class _Queue:
    """Numbers of the jobs that nobody has taken yet."""

    def __init__(self, count: int) -> None:
        self._next, self._count, self._lock = 0, count, Lock()
        self.stopped = False

    def take(self, most: int) -> list[int]:
        with self._lock:
            taken = range(self._next, min(self._next + most, self._count))
            self._next = taken.stop
        return list(taken)


@lru_cache(maxsize=64)
def _compiled(structure: Hashable) -> Callable:
    """Step every path until `enough` of them have all their loads behind them; also the robots' metrics.

    For robots of one structure: (its arrays with a leading axis of lanes, lanes, tolerance, max_iterations,
    enough) -> (paths, metrics).
    """

    def advance(
        leaves: list[Array], lanes: _Lane, tolerance: Array, max_iterations: Array, enough: Array
    ) -> tuple[ContinuationState, Array]:
        def one(leaves: list[Array], lane: _Lane) -> tuple[ContinuationState, Array]:
            robot = jax.tree.unflatten(structure, leaves)
            where = lane.loads, lane.parents, lane.starts, lane.total
            step = newton_stepper(robot, *where, tolerance, max_iterations)

            def going(path: ContinuationState) -> Array:
                return jax.lax.psum((path.load == lane.total).astype(int), "lanes") < enough

            return jax.lax.while_loop(going, step, lane.path), metric_of(robot)

        return jax.vmap(one, axis_name="lanes")(leaves, lanes)

    # The lanes of a thread are its work; a second thread inside an operation would take it from the others.
    return jax.jit(advance, compiler_options={"xla_cpu_multi_thread_eigen": False})
