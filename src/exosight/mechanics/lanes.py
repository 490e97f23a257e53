"""Robots side by side in compiled code: prepared, stepped together, refilled as they arrive.

What changes hands between Python and compiled code are NumPy arrays: indexing JAX arrays from Python costs a
dispatch each, which for thousands of robots is more than solving them.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from threading import Lock
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.continuation import stepper
from exosight.mechanics.continuation_state import SNAPS, ContinuationState, begin
from exosight.mechanics.evaluator import by_program, by_xla, prepare
from exosight.mechanics.metric import Metric
from exosight.scalar_program import Unrolled

Kinds = tuple[tuple[tuple[int, ...], np.dtype], ...]
"""Shape and type of each of a robot's arrays."""


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


class Robots(NamedTuple):
    """Some robots, and what all evaluations of each have in common.

    arrays         (robots, numbers)  all arrays of a robot, one after the other
    factor, unit   those of its `Metric`
    design         (robots, handed)   what its program computes of the robot alone; empty without a program
    """

    arrays: Float[AnyArray, "robots numbers"]
    factor: Float[AnyArray, "robots dofs dofs"]
    unit: Float[AnyArray, " robots"]
    design: Float[AnyArray, "robots handed"]


Taken = list[tuple[int, Robots]]
"""Robots by their numbers, each a row of `Robots`."""


class Given(NamedTuple):
    """What compiled code is told of the robot in each lane.

    loads        its next loads, of which `total` are meant; none in a lane that stands still
    told         its snaps have been read
    fresh        it starts anew, from pose `q` and loads `origin` with this history
    """

    robots: Robots
    loads: Float[np.ndarray, "lanes room channels"]
    total: Int[np.ndarray, " lanes"]
    told: Bool[np.ndarray, " lanes"]
    fresh: Bool[np.ndarray, " lanes"]
    q: Float[np.ndarray, "lanes dofs"]
    origin: Float[np.ndarray, "lanes channels"]
    history: tuple[Float[np.ndarray, "lanes ..."], ...]


class Compiled(NamedTuple):
    """Compiled for robots of one structure.

    prepare   arrays of some robots -> `Robots`
    advance   (given, states, tolerance, max_iterations, enough) -> states, once `enough` lanes have their
              loads behind them or one has no room for snaps; nothing of the states of fresh lanes is used
    """

    prepare: Callable[[Float[np.ndarray, "robots numbers"]], Robots]
    advance: Callable[..., ContinuationState]


class Queue:
    """Robots that nobody has taken yet, prepared `together` at a time."""

    def __init__(self, problems: Problems, numbers: list[int], together: int, compiled: Compiled) -> None:
        self._leaves, self._together, self._prepare = problems.leaves, together, compiled.prepare
        self._numbers, self._ready = numbers, Taken()
        self._lock = Lock()
        self.stopped = False

    def waiting(self) -> bool:
        """Whether there are any."""
        return bool(self._numbers or self._ready)

    def take(self, most: int) -> Taken:
        """Up to so many."""
        taken = Taken()
        with self._lock:
            while len(taken) < most and self.waiting():
                if not self._ready:
                    self._prepare_more()
                taken.append(self._ready.pop(0))
        return taken

    def _prepare_more(self) -> None:
        numbers, self._numbers = self._numbers[: self._together], self._numbers[self._together :]
        filled = numbers + numbers[:1] * (self._together - len(numbers))  # compiled for so many
        parts = [leaf[filled].reshape(self._together, -1) for leaf in self._leaves]
        robots = map(np.asarray, self._prepare(np.concatenate(parts, axis=1, dtype=float)))
        self._ready = [(n, Robots(*row)) for n, row in zip(numbers, zip(*robots, strict=True), strict=False)]


class Lanes:
    """The lanes of one thread: which robot is in each, and what compiled code is told of it.

    number   of each lane's robot; −1: none, the lane stands still
    first    index of the first of the loads that it is on
    blank    states to begin with, while all lanes are fresh
    """

    def __init__(self, problems: Problems, lanes: int, room: int, taken: Taken) -> None:
        self._problems = problems
        self.number, self.first = np.full(lanes, -1), np.zeros(lanes, int)

        def rows(like: np.ndarray) -> np.ndarray:
            return np.repeat(like[None], lanes, axis=0)

        self.given = Given(
            robots=Robots(*(rows(np.asarray(row)) for row in taken[0][1])),
            loads=np.zeros((lanes, room, problems.loads.shape[2])),
            total=np.zeros(lanes, int),
            told=np.zeros(lanes, bool),
            fresh=np.ones(lanes, bool),
            q=rows(problems.q[0]),
            origin=rows(problems.origin[0]),
            history=tuple(rows(memory[0]) for memory in problems.history),
        )
        shapes = tuple(memory.shape[1:] for memory in problems.history)
        self.blank = _blank(problems.q.shape[1], problems.loads.shape[2], shapes, lanes, room)
        self.put(np.arange(len(taken)), taken)

    def put(self, at: Int[np.ndarray, " some"], taken: Taken) -> None:
        """Robots at the start of their paths into some lanes."""
        problems, numbers = self._problems, [number for number, _ in taken]
        self.number[at], self.first[at] = numbers, 0
        for into, rows in zip(self.given.robots, zip(*(row for _, row in taken), strict=True), strict=True):
            into[at] = rows
        self._begin(at, problems.q, problems.origin, problems.history, numbers)

    def go_on(self, at: Int[np.ndarray, " some"], q: np.ndarray, load: np.ndarray, history: Any) -> None:
        """Some lanes to the next loads of their robots, from what was found before, (robots, loads, ...)."""
        self.first[at] += self.given.total[at]
        self._begin(at, q, load, history, (self.number[at], self.first[at] - 1))

    def stand(self, at: Int[np.ndarray, " some"]) -> None:
        """Some lanes have no robot any more."""
        self.number[at] = -1

    def _begin(
        self, at: np.ndarray, q: np.ndarray, load: np.ndarray, history: Sequence[np.ndarray], where: Any
    ) -> None:
        given, loads, first = self.given, self._problems.loads, self.first[at]
        total = np.minimum(loads.shape[1] - first, given.loads.shape[1])
        along = first[:, None] + np.minimum(np.arange(given.loads.shape[1]), total[:, None] - 1)
        given.loads[at], given.total[at] = loads[self.number[at][:, None], along], total
        given.fresh[at] = True
        into = (given.q, given.origin, *given.history)
        for own, rows in zip(into, (q, load, *history), strict=True):
            own[at] = rows[where]


@lru_cache(maxsize=64)
def _blank(
    dofs: int, channels: int, memories: tuple[tuple[int, ...], ...], lanes: int, room: int
) -> ContinuationState:
    one = begin(np.zeros(dofs), np.zeros(channels), tuple(map(np.zeros, memories)), room)
    return jax.device_put(jax.tree.map(lambda x: np.zeros((lanes, *np.shape(x)), np.asarray(x).dtype), one))


@lru_cache(maxsize=64)
def compiled(structure: Hashable, kinds: Kinds, program: Unrolled | None) -> Compiled:
    """For robots of a structure whose arrays are of these kinds, by their program or by XLA."""
    ends = np.cumsum([int(np.prod(shape)) for shape, _ in kinds]).tolist()

    def robot_of(arrays: Array) -> Any:
        parts = jnp.split(arrays, ends[:-1])
        leaves = [part.reshape(shape).astype(kind) for part, (shape, kind) in zip(parts, kinds, strict=True)]
        return jax.tree.unflatten(structure, leaves)

    def prepared(arrays: Array) -> Robots:
        robot = robot_of(arrays)
        metric = Metric.of(robot)
        return Robots(arrays, metric.factor, metric.unit, prepare(program, robot))

    def advance(
        given: Given, state: ContinuationState, tolerance: Array, max_iterations: Array, enough: Array
    ) -> ContinuationState:
        def one(given: Given, state: ContinuationState) -> ContinuationState:
            arrays, *metric, design = map(jnp.asarray, given.robots)
            robot, metric = robot_of(arrays), Metric(*metric)
            evaluator = by_xla(robot, metric) if program is None else by_program(program, metric, design)
            step = stepper(robot, evaluator, given.loads, given.total, tolerance, max_iterations)
            anew = begin(given.q, given.origin, given.history, 0)._replace(records=None)
            before = state._replace(records=None, snaps=jnp.where(given.told, 0, state.snaps))
            now = jax.tree.map(lambda a, b: jnp.where(given.fresh, a, b), anew, before)

            def going(state: ContinuationState) -> Array:
                arrived = jax.lax.psum((state.load == given.total).astype(int), "lanes")
                full = jax.lax.psum((state.snaps >= SNAPS).astype(int), "lanes")
                return (arrived < enough) & (full == 0)

            return jax.lax.while_loop(going, step, now._replace(records=state.records))

        return jax.vmap(one, axis_name="lanes")(given, state)

    # The lanes of a thread are its work; a second thread inside an operation would take it from the others.
    options = {"xla_cpu_multi_thread_eigen": False}
    return Compiled(
        jax.jit(jax.vmap(prepared), compiler_options=options),
        jax.jit(advance, compiler_options=options),
    )
