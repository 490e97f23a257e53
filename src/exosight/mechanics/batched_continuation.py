"""Many robots side by side: a compiled loop over a few lanes, refilled as robots arrive.

What changes hands between Python and compiled code are NumPy arrays: indexing JAX arrays from Python costs a
dispatch each, which for thousands of robots is more than solving them.
"""

from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from threading import Lock
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.cpu import cores
from exosight.mechanics.continuation import stepper
from exosight.mechanics.continuation_state import SNAPS, ContinuationState, Records, begin
from exosight.mechanics.equilibrium import SolverOptions
from exosight.mechanics.evaluator import by_program, by_xla, program_of
from exosight.mechanics.metric import metric_of
from exosight.scalar_program import Unrolled

ROOM = 1, 32
"""Loads that a lane takes at a time, for single loads and for paths; longer ones go on in the same lane.

Two numbers, so at most two compilations: the robot's Hessian at each (5 KiB for the published exosuit) goes
in and out of the compiled code, which a controller that asks for one load at a time would wait for."""


class Snap(NamedTuple):
    """One jump of a robot on its path, from the end of a stable branch to another stable equilibrium.

    step      index of the first load beyond it
    load      (channels,)   where the branch ends [N]
    before    (dofs,)       the pose just before
    after     (dofs,)       the pose at `load` that the jump leads to
    energy    what the jump sets free: Π of the pose left − Π of the pose reached [J]
    taken     what friction took of it [J]; the rest is lost to the flow between the two
    """

    step: int
    load: Float[np.ndarray, " channels"]
    before: Float[np.ndarray, " dofs"]
    after: Float[np.ndarray, " dofs"]
    energy: float
    taken: float


class Problems(NamedTuple):
    """Robots of one structure, where they start, and the loads to bring them to.

    structure   of a robot, as JAX has it
    leaves      its arrays, each with a leading axis of robots
    q, origin   (robots, dofs), (robots, channels)   poses, and the loads there [N]
    loads       (robots, loads, channels)            [N]
    history     (robots, ...)    what each term with a memory remembers of the start
    """

    structure: Hashable
    leaves: Sequence[np.ndarray]
    q: Float[np.ndarray, "robots dofs"]
    origin: Float[np.ndarray, "robots channels"]
    loads: Float[np.ndarray, "robots loads channels"]
    history: tuple[Float[np.ndarray, "robots ..."], ...]


class Solutions(NamedTuple):
    """What was found, of shape (robots, loads, …); see `Equilibria`. `load`: where each robot was [N]."""

    q: Float[np.ndarray, "robots loads dofs"]
    load: Float[np.ndarray, "robots loads channels"]
    converged: Bool[np.ndarray, "robots loads"]
    residual: Float[np.ndarray, "robots loads"]
    min_eigenvalue: Float[np.ndarray, "robots loads"]
    snapped: Bool[np.ndarray, "robots loads"]
    tied: Bool[np.ndarray, "robots loads"]
    energy: Float[np.ndarray, "robots loads"]
    supplied: Float[np.ndarray, "robots loads"]
    dissipated: Float[np.ndarray, "robots loads"]
    iterations: Int[np.ndarray, "robots loads"]
    history: tuple[Float[np.ndarray, "robots loads ..."], ...]
    snaps: list[list[Snap]]


@runtime_checkable
class Kept(Protocol):
    """What keeps the robots that are finished, so that a solve which was stopped goes on with the others."""

    def restore(self, found: Solutions) -> list[int]:
        """Put into the rows of `found` what is kept, all but `snaps`; returns the robots' numbers."""
        ...

    def finished(self, number: int, found: Solutions) -> None:
        """The row of one more robot is final; called from several threads, which write the other rows."""
        ...


def solve(
    problems: Problems,
    options: SolverOptions,
    done: Callable[[int], None] = lambda robots: None,
    kept: Kept | None = None,
) -> Solutions:
    """Every robot brought to its loads, one after the other.

    done   called with the number of robots finished, as they finish
    kept   what an earlier solve of the same problems finished, and keeps what this one does
    """
    robots, channels = len(problems.loads), problems.loads.shape[2]
    on_cpu = jax.default_backend() == "cpu"
    # As suits the device (eight share the cache of a core), but no more than the robots fill.
    lanes = min(options.lanes or (8 if on_cpu else 2048), 1 << max(0, robots - 1).bit_length())
    shapes = tuple(leaf.shape[1:] for leaf in problems.leaves)
    program = program_of(problems.structure, shapes, channels) if options.unrolled else None
    compiled = _compiled(problems.structure, program)
    found = _nothing(problems)
    known = kept.restore(found) if kept else []
    queue = _Queue(sorted(set(range(robots)) - set(known)))
    if known:
        done(len(known))

    def finished(number: int) -> None:
        if kept:
            kept.finished(number, found)
        done(1)

    def step(rows: list[np.ndarray], lane: _Lane, enough: int) -> tuple[ContinuationState, Array]:
        return compiled(rows, lane, options.tolerance, options.max_iterations, enough)

    def work() -> None:
        _fill_lanes(problems, lanes, step, queue, found, finished)

    # Compiled calls release Python's lock, so one thread a core keeps every core busy.
    workers = min(cores(), -(-robots // lanes)) if on_cpu else 1
    if workers == 1:
        work()
        return found
    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            for future in [pool.submit(work) for _ in range(workers)]:
                future.result()
        except BaseException:  # Ctrl-C too: the pool waits for its threads, which need not finish
            queue.stopped = True
            raise
    return found


def _fill_lanes(
    problems: Problems,
    lanes: int,
    step: Callable[..., tuple[ContinuationState, Array]],
    queue: "_Queue",
    found: Solutions,
    finished: Callable[[int], None],
) -> None:
    """The work of one thread: so many lanes, each given another robot once it is done, until none waits.

    step       (robots' arrays, lanes, how many must be done) -> (states, metrics)
    finished   called with the number of every robot that is
    """
    numbers = queue.take(lanes)
    if not numbers:
        return
    room = ROOM[0] if problems.loads.shape[1] <= ROOM[0] else ROOM[1]
    # A lane without a robot holds a copy of the first one, but stands still.
    filled = numbers + [numbers[0]] * (lanes - len(numbers))
    numbers += [-1] * (lanes - len(numbers))
    rows = [leaf[filled] for leaf in problems.leaves]
    first = [0] * lanes  # index of the first load of the part that a lane is on
    lane = jax.tree.map(lambda *parts: np.array(parts), *(_part(problems, i, 0, room) for i in filled))
    empty = np.array(numbers) < 0
    lane.state.load[empty] = lane.total[empty]
    while any(i >= 0 for i in numbers) and not queue.stopped:
        # While robots or further loads wait, come back as soon as a quarter of the lanes is free for them.
        waiting = queue.waiting() or problems.loads.shape[1] > room
        enough = min(lanes, numbers.count(-1) + max(1, lanes // 4)) if waiting else lanes
        state, metrics = step(rows, lane, enough)
        lane, metrics = lane._replace(state=_writable(state)), np.asarray(metrics)
        full = lane.state.snaps >= SNAPS
        arrived = lane.state.load == lane.total
        for at in np.flatnonzero((full | arrived) & (np.array(numbers) >= 0)).tolist():
            number, start = numbers[at], first[at]
            _keep_snaps(found, lane.state, at, number, start)
            lane.state.snaps[at] = 0
            if not arrived[at]:
                continue
            first[at] = start + int(lane.total[at])
            _keep(found, lane.state.records, at, number, slice(start, first[at]), metrics[at])
            if first[at] == problems.loads.shape[1]:
                finished(number)
                numbers[at] = number = next(iter(queue.take(1)), -1)
                if number < 0:
                    continue
                first[at] = 0
                for into, leaf in zip(rows, problems.leaves, strict=True):
                    into[at] = leaf[number]
            part = _part(problems, number, first[at], room, found)
            for into, row in zip(_written(lane), _written(part), strict=True):
                into[at] = row


def _writable(state: ContinuationState) -> ContinuationState:
    """Copies that Python may write into. Records are large and written by compiled code alone: not copied."""
    copied = jax.tree.map(np.array, state._replace(records=None))
    return copied._replace(records=jax.tree.map(np.asarray, state.records))


def _written(lane: "_Lane") -> list:
    """What a lane is given anew with each part; what records hold from before is overwritten."""
    return jax.tree.leaves(lane._replace(state=lane.state._replace(records=None)))


class _Lane(NamedTuple):
    """What a lane is working on: some loads, how many of them are meant, and how far it is."""

    loads: Float[AnyArray, "room channels"]
    total: Int[AnyArray, ""]
    state: ContinuationState


def _part(problems: Problems, number: int, first: int, room: int, found: Solutions | None = None) -> _Lane:
    """The loads of a robot from `first` on, starting from what was found before."""
    loads = problems.loads[number, first : first + room]
    total = len(loads)
    if total < room:
        loads = np.concatenate([loads, np.repeat(loads[-1:], room - total, axis=0)])
    start: tuple[Any, Any, tuple] = (problems.q, problems.origin, problems.history)
    where: Any = number
    if first and found is not None:
        start, where = (found.q, found.load, found.history), (number, first - 1)
    q, origin, history = jax.tree.map(lambda rows: rows[where], start)
    return _Lane(loads, np.array(total), begin(q, origin, history, room))


def _nothing(problems: Problems) -> Solutions:
    shape = problems.loads.shape[:2]

    def flags() -> np.ndarray:
        return np.zeros(shape, bool)

    def numbers() -> np.ndarray:
        return np.zeros(shape)

    return Solutions(
        q=np.zeros((*shape, problems.q.shape[1])),
        load=np.zeros(problems.loads.shape),
        converged=flags(),
        residual=numbers(),
        min_eigenvalue=numbers(),
        snapped=flags(),
        tied=flags(),
        energy=numbers(),
        supplied=numbers(),
        dissipated=numbers(),
        iterations=np.zeros(shape, int),
        history=tuple(np.zeros((*shape, *memory.shape[1:])) for memory in problems.history),
        snaps=[[] for _ in range(shape[0])],
    )


def _keep(
    found: Solutions, records: Records, lane: int, number: int, part: slice, metric: np.ndarray
) -> None:
    """What a lane found at some loads of a robot; λ of ∇²Π v = λ M v from the whitened Hessian."""
    count = part.stop - part.start
    for name in ("q", "load", "residual", "snapped", "tied", "energy", "iterations"):
        getattr(found, name)[number, part] = getattr(records, name)[lane, :count]
    for name in ("supplied", "dissipated"):
        of_robot = getattr(found, name)[number]
        before = of_robot[part.start - 1] if part.start else 0.0
        of_robot[part] = before + np.cumsum(getattr(records, name)[lane, :count])
    for into, remembered in zip(found.history, records.memories, strict=True):
        into[number, part] = remembered[lane, :count]
    whitener = np.linalg.inv(np.linalg.cholesky(metric))
    whitened = whitener @ records.hessian[lane, :count] @ whitener.T
    skew = whitened - np.swapaxes(whitened, 1, 2)
    if np.abs(skew).max() <= 1e-9 * np.abs(whitened).max():
        eigenvalue = np.linalg.eigvalsh(whitened)[:, 0]
    else:
        eigenvalue = np.linalg.eigvals(whitened).real.min(axis=-1)
    found.min_eigenvalue[number, part] = eigenvalue
    found.converged[number, part] = records.converged[lane, :count] & (eigenvalue > 0)


def _keep_snaps(found: Solutions, state: ContinuationState, lane: int, number: int, first: int) -> None:
    records = state.records
    for i in range(min(int(state.snaps[lane]), SNAPS)):
        found.snaps[number].append(
            Snap(
                first + int(records.snap_step[lane, i]),
                np.array(records.snap_load[lane, i]),
                np.array(records.before[lane, i]),
                np.array(records.after[lane, i]),
                float(records.released[lane, i]),
                float(records.taken[lane, i]),
            )
        )


class _Queue:
    """Numbers of the robots that nobody has taken yet."""

    def __init__(self, numbers: list[int]) -> None:
        self._numbers, self._lock = numbers, Lock()
        self.stopped = False

    def waiting(self) -> bool:
        return bool(self._numbers)

    def take(self, most: int) -> list[int]:
        with self._lock:
            taken, self._numbers = self._numbers[:most], self._numbers[most:]
        return taken


@lru_cache(maxsize=64)
def _compiled(structure: Hashable, program: Unrolled | None) -> Callable:
    """Step every robot until `enough` of them are done, or one has no room for snaps; also the metrics.

    For robots of one structure: (its arrays with a leading axis of lanes, lanes, tolerance, max_iterations,
    enough) -> (states, metrics).
    """

    def advance(
        leaves: list[Array], lanes: _Lane, tolerance: Array, max_iterations: Array, enough: Array
    ) -> tuple[ContinuationState, Array]:
        def one(leaves: list[Array], lane: _Lane) -> tuple[ContinuationState, Array]:
            robot = jax.tree.unflatten(structure, leaves)
            evaluator = by_xla(robot) if program is None else by_program(program, robot)
            step = stepper(robot, evaluator, lane.loads, lane.total, tolerance, max_iterations)

            def going(state: ContinuationState) -> Array:
                arrived = jax.lax.psum((state.load == lane.total).astype(int), "lanes")
                full = jax.lax.psum((state.snaps >= SNAPS).astype(int), "lanes")
                return (arrived < enough) & (full == 0)

            return jax.lax.while_loop(going, step, lane.state), metric_of(robot)

        return jax.vmap(one, axis_name="lanes")(leaves, lanes)

    # The lanes of a thread are its work; a second thread inside an operation would take it from the others.
    return jax.jit(advance, compiler_options={"xla_cpu_multi_thread_eigen": False})
