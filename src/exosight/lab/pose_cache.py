"""Equilibria of systems along the moves that they are driven by, solved once and remembered.

A pose follows from the moves that lead to it (hysteresis), so it is known by the system and its drive: one
channel after another moved to a command, from rest. (0, 80), (0, 48) is channel 0 up to 80 steps and back to
48. What a move passes over is a branch: every second step of its channel, solved in pieces that always begin
at the same places; what lies between is solved from the step before it. So a pose does not depend on what
else was asked for, and while a command moves on a branch that is known, next to nothing is solved.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from exosight.mechanics import SolverOptions, State, drive
from exosight.mechanics.term import Memories
from exosight.system.schema import Channel
from exosight.system.system import System, stack_systems

STRIDE = 2
"""From one command of a branch to the next, in steps of its channel."""

_STEPS = 80  # at least so many from 0 to the peak of a channel: 0.05 N up to 4 N
_PIECE = 7  # commands a solver call: 1 ms a call, 2 ms a command that nobody asked for; 21 make a branch
_BRANCHES = 64  # branches that one system remembers
_SYSTEMS = 128  # systems that are remembered, 20 kB each; more than a queue holds, so a page keeps its own
_SAME = 1e-5  # rad, or strain: poses nearer to each other than this are one; solutions agree to 1e-6
_ENOUGH = SolverOptions(tolerance=1e-7)  # forces to 1e-7 N, a quarter sooner than with the default 1e-10

Move = tuple[int, int]
"""A channel, and the command that it is moved to [steps]."""
Drive = tuple[Move, ...]


@dataclass(frozen=True)
class Grid:
    """The commands of a channel that the lab drives to: multiples of a step.

    channel      of the schema
    step         1, 2 or 5 times a power of ten [its unit]
    bottom, top  smallest and largest command [steps]
    """

    channel: Channel
    step: float
    bottom: int
    top: int

    @property
    def peak(self) -> int:
        """The end that is further from 0 [steps]."""
        return max(self.top, self.bottom, key=abs)

    def command(self, steps: int) -> float:
        """A command in the channel's unit."""
        return round(steps * self.step, 10)


def grid_of(channel: Channel) -> Grid:
    """From 0 to what datasets drive to if the channel says so, otherwise its whole range."""
    step = round125(abs(channel.peak) / _STEPS)
    low, high = (channel.low, channel.high) if channel.drive is None else (0.0, channel.drive)
    return Grid(
        channel, step, math.ceil(min(low, high) / step - 1e-9), math.floor(max(low, high) / step + 1e-9)
    )


def round125(value: float) -> float:
    """The least of 1, 2, 5 × 10ⁿ that is not below a value above 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(k * power for k in (1, 2, 5, 10) if k * power >= value * (1 - 1e-9))


@dataclass(frozen=True)
class Rest:
    """One equilibrium.

    drive      a shortest known one to it
    q          (dofs,)  coordinates
    converged  whether it is a stable equilibrium; if not, it is the last one before
    history    of the system, see `Equilibria`
    """

    drive: Drive
    q: Float[np.ndarray, " dofs"]
    converged: bool
    history: Memories = ()


class Point(NamedTuple):
    """Coordinates, whether they are a stable equilibrium, and the history that they come with."""

    q: Float[np.ndarray, " dofs"]
    converged: bool
    history: Memories

    def same(self, other: "Point") -> bool:
        """Whether both go on alike."""
        pairs = zip((self.q, *self.history), (other.q, *other.history), strict=True)
        return all(np.abs(a - b).max() < _SAME for a, b in pairs)


@dataclass
class _Branch:
    """What one move passes over, to the end of its channel's range.

    commands  (channels,)  before the move [steps]
    channel   that moves
    rises     whether to the upper end
    start     the equilibrium before the move
    places    every multiple of STRIDE after it, in the order of the move [steps]
    solved    the equilibria at the places so far
    between   the same at steps between two places
    """

    commands: np.ndarray
    channel: int
    rises: bool
    start: Point
    places: list[int]
    solved: list[Point] = field(default_factory=list)
    between: dict[int, Point] = field(default_factory=dict)

    def until(self, goal: int) -> int:
        """How many of its places come before a step on it, or are the step."""
        return sum(place <= goal if self.rises else place >= goal for place in self.places)


class CachedSystem:
    """One system and the branches that are known of it; may be asked from several threads."""

    def __init__(self, system: System, grids: Sequence[Grid]) -> None:
        self.system, self.grids = system, tuple(grids)
        self.robot = system.robot
        self.stacked: System = stack_systems([system])
        self._unit = np.array([grid.step for grid in grids])
        self._rest: Point | None = None
        self._branches: OrderedDict[tuple[Drive, int, bool], _Branch] = OrderedDict()
        self._lock = Lock()

    def at(self, drive: Sequence[Move]) -> Rest:
        """The equilibrium that a drive from rest ends in; every command within the grid of its channel."""
        with self._lock:
            short = turning_points(drive)
            point = self._solve(short)
            for same in self._shorter(short):
                known = self._known(same) if len(same) < len(short) else None
                if known is not None and known.same(point):
                    return Rest(same, *point)
            return Rest(short, *point)

    def _shorter(self, drive: Drive) -> list[Drive]:
        """Drives to the same commands that may end in the same pose: straight, and by way of the peak."""
        if not drive:
            return []
        last = dict(drive)
        straight = turning_points(sorted(last.items()))
        channel, goal = drive[-1]
        others = sorted((each, at) for each, at in last.items() if each != channel)
        return [straight, turning_points([*others, (channel, self.grids[channel].peak), (channel, goal)])]

    def _solve(self, drive: Drive) -> Point:
        if not drive:
            if self._rest is None:
                none = np.zeros((1, len(self.grids)))
                start = Point(np.zeros(self.robot.dofs), True, self.robot.memories)
                self._rest = self._driven(none[0], start, none)[0]
            return self._rest
        branch, (_, goal) = self._branch(drive), drive[-1]
        needed = branch.until(goal)
        while len(branch.solved) < needed:
            piece = branch.places[len(branch.solved) : len(branch.solved) + _PIECE]
            branch.solved += self._along(branch, len(branch.solved), piece)
        if goal % STRIDE == 0:
            return branch.solved[needed - 1]
        if goal not in branch.between:
            branch.between[goal] = self._along(branch, needed, [goal])[0]
        return branch.between[goal]

    def _along(self, branch: _Branch, after: int, places: Sequence[int]) -> list[Point]:
        """The equilibria at places of a branch, driven to from the one after so many that are solved."""
        commands = np.tile(branch.commands, (1 + len(places), 1))
        if after:
            commands[0, branch.channel] = branch.places[after - 1]
        commands[1:, branch.channel] = places
        return self._driven(commands[0], branch.solved[after - 1] if after else branch.start, commands[1:])

    def _driven(
        self,
        start: Float[np.ndarray, " channels"],
        point: Point,
        commands: Float[np.ndarray, "loads channels"],
    ) -> list[Point]:
        """The equilibria at commands [steps], in order, from that at `start`."""
        before, loads = (self.system.loads(each * self._unit) for each in (start, commands))
        state = State(point.q[None], before[None], tuple(memory[None] for memory in point.history))
        found = drive([self.robot], loads, state=state, options=_ENOUGH)
        return [
            Point(np.asarray(found.q[0, i]), bool(converged), tuple(memory[0, i] for memory in found.history))
            for i, converged in enumerate(found.converged[0])
        ]

    def _branch(self, drive: Drive) -> _Branch:
        """The branch that a drive ends on."""
        before, channel, rises = key = _key(drive)
        branch = self._branches.get(key)
        if branch is None:
            start, grid = self._solve(before), self.grids[channel]
            commands = np.zeros(len(self.grids))
            for each, place in before:
                commands[each] = place
            first = round(commands[channel])
            way = range(first + 1, grid.top + 1) if rises else range(first - 1, grid.bottom - 1, -1)
            places = [place for place in way if place % STRIDE == 0]
            branch = self._branches[key] = _Branch(commands, channel, rises, start, places)
            while len(self._branches) > _BRANCHES:
                self._branches.popitem(last=False)
        self._branches.move_to_end(key)
        return branch

    def _known(self, drive: Drive) -> Point | None:
        """The end of a drive, if there is little to solve for it."""
        if not drive:
            return self._rest
        return self._solve(drive) if self._has(drive) else None

    def _has(self, drive: Drive) -> bool:
        """Whether all places up to the end of a drive with moves are solved."""
        branch = self._branches.get(_key(drive))
        return branch is not None and len(branch.solved) >= branch.until(drive[-1][1])

    def is_near(self, drive: Sequence[Move]) -> bool:
        """Whether no more than the last move of a drive remains to be solved; waits for no other thread."""
        before = turning_points(drive)[:-1]
        return not before or self._has(before)


def _key(drive: Drive) -> tuple[Drive, int, bool]:
    """What names the branch that a drive ends on: the moves before it, its channel, and whether it rises."""
    *before, (channel, goal) = drive
    return tuple(before), channel, goal > dict(before).get(channel, 0)


def turning_points(drive: Sequence[Move]) -> Drive:
    """The same drive with its turns alone: a channel moved on in the same direction is one move."""
    at: dict[int, int] = {}
    kept: list[Move] = []
    came_from = 0  # command of the last move's channel before that move
    for channel, goal in drive:
        now = at.get(channel, 0)
        if goal == now:
            continue
        if kept and kept[-1][0] == channel and (goal - now) * (now - came_from) > 0:
            kept[-1] = (channel, goal)
        else:
            kept.append((channel, goal))
            came_from = now
        at[channel] = goal
    return tuple(kept)


class PoseCache:
    """The systems asked for last, by what tells them from each other."""

    def __init__(self) -> None:
        self._systems: OrderedDict[str, CachedSystem] = OrderedDict()
        self._lock = Lock()

    def known(self, key: str) -> CachedSystem | None:
        """The system of a key if it is remembered; waits for no other thread."""
        return self._systems.get(key)

    def get(self, key: str, make: Callable[[], CachedSystem]) -> CachedSystem:
        """The system of a key, with all that is known of it."""
        with self._lock:
            cached = self._systems.get(key)
            if cached is None:
                cached = self._systems[key] = make()
                while len(self._systems) > _SYSTEMS:
                    self._systems.popitem(last=False)
            self._systems.move_to_end(key)
            return cached
