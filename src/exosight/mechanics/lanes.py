"""Robots side by side in the lanes of compiled code: put in, gone on with, taken out.

What changes hands between Python and compiled code are NumPy arrays: indexing JAX arrays from Python costs a
dispatch each, which for thousands of robots is more than solving them.
"""

from collections.abc import Sequence
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from exosight.mechanics.compiled_lanes import Compiled, Given, Rows
from exosight.mechanics.continuation_records import Records
from exosight.mechanics.equilibrium import SolverOptions
from exosight.mechanics.path_step import Carried
from exosight.mechanics.prepared import Prepared


class Problems(NamedTuple):
    """Robots of one structure, where they start, and the loads to bring them to.

    q, origin   (robots, dofs), (robots, channels)   poses, and the loads there [N]
    loads       (robots, loads, channels)            [N]
    history     (robots, ...)    what each term with a memory remembers of the start
    """

    q: Float[np.ndarray, "robots dofs"]
    origin: Float[np.ndarray, "robots channels"]
    loads: Float[np.ndarray, "robots loads channels"]
    history: tuple[Float[np.ndarray, "robots ..."], ...]


class Queue:
    """Robots that nobody has taken yet, by their numbers."""

    def __init__(self, robots: Prepared, numbers: list[int]) -> None:
        self.robots, self._numbers = robots, numbers
        self._lock = Lock()
        self.stopped = False

    def waiting(self) -> bool:
        """Whether there are any."""
        return bool(self._numbers)

    def take(self, most: int) -> tuple[Int[np.ndarray, " some"], Rows]:
        """Up to so many: their numbers, and what compiled code is told of them."""
        with self._lock:
            taken, self._numbers = np.array(self._numbers[:most], int), self._numbers[most:]
        return taken, self.robots.rows(taken)


class Lanes:
    """The lanes of one thread: which robot is in each, and what compiled code is told of it.

    number     of each lane's robot; −1: none, the lane stands still
    first      index of the first of the loads that it is on, of which there are `total`
    given      what compiled code is told, to be written to
    now        where they are, to be written to; whole numbers as floats
    records    what was found
    """

    def __init__(
        self,
        problems: Problems,
        options: SolverOptions,
        lanes: int,
        code: Compiled,
        numbers: Int[np.ndarray, " some"],
        robots: Rows,
    ) -> None:
        self._problems, self._code = problems, code
        self.number, self.first = np.full(lanes, -1), np.zeros(lanes, int)
        self.total = np.zeros(lanes, int)
        layout = code.layout
        self._rows = np.zeros((lanes, layout.given.numbers))
        self.given: Given = layout.given.views(self._rows)
        self.given.tolerance[:], self.given.max_iterations[:] = options.tolerance, options.max_iterations
        self._robots = self._rows[:, : robots.shape[1]]
        self._state = np.zeros((lanes, layout.now.numbers))
        self.now: Carried = layout.now.views(self._state)
        self.records = Records(*(np.zeros((lanes, *rows.shape)) for rows in layout.records))
        # Where there is no robot compiled code goes on with the last one, but to no load.
        own = np.minimum(np.arange(lanes), len(numbers) - 1)
        self.put(np.arange(lanes), numbers[own], robots[own])
        idle = slice(len(numbers), None)
        self.number[idle], self.total[idle], self.given.total[idle] = -1, 0, 0

    def put(self, at: Int[np.ndarray, " some"], numbers: Int[np.ndarray, " some"], robots: Rows) -> None:
        """Robots at the start of their paths into some lanes."""
        problems = self._problems
        self.number[at], self.first[at], self._robots[at] = numbers, 0, robots
        self._begin(at, (problems.q, problems.origin, *problems.history), numbers)

    def go_on(self, at: Int[np.ndarray, " some"], q: np.ndarray, load: np.ndarray, history: Any) -> None:
        """Some lanes to the next loads of their robots, from what was found before, (robots, loads, ...)."""
        self.first[at] += self.total[at]
        self._begin(at, (q, load, *history), (self.number[at], self.first[at] - 1))

    def stand(self, at: Int[np.ndarray, " some"]) -> None:
        """Some lanes have no robot any more."""
        self.number[at] = -1

    def advance(self, enough: int) -> None:
        """Compiled code goes on until so many lanes have their loads behind them."""
        self.given.enough[:] = enough
        self._state[:], self.records = self._code.advance(self._rows, self._state, self.records)

    def _begin(self, at: np.ndarray, start: Sequence[np.ndarray], where: Any) -> None:
        given, loads, first = self.given, self._problems.loads, self.first[at]
        room = given.loads.shape[1]
        total = np.minimum(loads.shape[1] - first, room)
        along = first[:, None] + np.minimum(np.arange(room), total[:, None] - 1)
        given.loads[at], given.total[at], self.total[at] = (
            loads[self.number[at][:, None], along],
            total,
            total,
        )
        self._start(at, start, where)

    def _start(self, at: np.ndarray, start: Sequence[np.ndarray], where: Any) -> None:
        """Some lanes from poses, loads and histories (robots, …), of these robots."""
        state = self.now.row
        begun, poses, loads, memories = self._code.layout.start
        q, origin, *history = start
        state[at], self.now.load[at], self.now.snaps[at] = begun, 0, 0
        for place in poses:
            state[at, place] = q[where]
        state[at, loads] = origin[where]
        for places in memories:
            for place, memory in zip(places, history, strict=True):
                state[at, place] = memory[where].reshape(len(at), -1)
