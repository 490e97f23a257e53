"""Worn exosuits at rest along the way that they are driven, solved once and remembered.

A pose follows from the way to it (hysteresis), so it is known by the exosuit and the actuations driven to
from rest: (4, 2.4) is up to 4 N and down to 2.4 N. The way between two of them is a branch over every
multiple of 0.1 N, the step of the datasets, solved in pieces that always begin at the same places; what lies
between is solved from the multiple before it. So a pose does not depend on what else was asked for, and while
u moves on a branch that is known, next to nothing is solved.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from threading import Lock

import numpy as np
from jaxtyping import Float

from exosight.exosuit.assembly import Exosuit, assemble
from exosight.lab.settings import LARGEST, STEP
from exosight.mechanics import Robot, SolverOptions, State, drive, stack

TOP = round(LARGEST / STEP)
"""Largest actuation, in steps."""
STRIDE = 2
"""From one load of a branch to the next, in steps."""

_PIECE = 7  # loads a solver call: 1 ms a call, 2 ms a load that nobody asked for; 21 make a branch
_BRANCHES = 64  # branches that one exosuit remembers
_EXOSUITS = 32  # exosuits that are remembered
_SAME = 1e-5  # rad, or strain: poses nearer to each other than this are one; solutions agree to 1e-6
_ENOUGH = SolverOptions(tolerance=1e-7)  # forces to 1e-7 N, a quarter sooner than with the default 1e-10

Steps = tuple[int, ...]


@dataclass(frozen=True)
class Rest:
    """One equilibrium.

    drive      a shortest known way to it [steps]
    q          (dofs,)  coordinates
    converged  whether it is a stable equilibrium; if not, it is the best point found
    """

    drive: Steps
    q: Float[np.ndarray, " dofs"]
    converged: bool


@dataclass
class _Branch:
    """The way from one turn to the end of the range.

    rises    whether to the upper end
    turn     where it starts [steps]
    start    coordinates there
    loads    every multiple of STRIDE after it, in the order of the way [steps]
    solved   coordinates at the loads so far, and whether they are at rest
    between  the same at steps between two loads
    """

    rises: bool
    turn: int
    start: np.ndarray
    loads: list[int]
    solved: list[tuple[np.ndarray, bool]] = field(default_factory=list)
    between: dict[int, tuple[np.ndarray, bool]] = field(default_factory=dict)

    def last(self, solved: int) -> tuple[int, np.ndarray]:
        """Where it is once so many of its loads are solved: the load [steps], and coordinates."""
        return (self.loads[solved - 1], self.solved[solved - 1][0]) if solved else (self.turn, self.start)

    def until(self, goal: int) -> int:
        """How many of its loads come before a step on it, or are the step."""
        return sum(load <= goal if self.rises else load >= goal for load in self.loads)


class CachedExosuit:
    """One worn exosuit and the branches that are known of it; may be asked from several threads."""

    def __init__(self, exosuit: Exosuit) -> None:
        self.exosuit = exosuit
        self.robot: Robot = assemble(exosuit)
        self.stacked: Robot = stack([self.robot])
        self._branches: OrderedDict[tuple[Steps, int], _Branch] = OrderedDict()
        self._lock = Lock()

    def at(self, drive: Sequence[int]) -> Rest:
        """The equilibrium that a drive from rest ends in.

        drive   actuations in steps of STEP, each within 0…TOP
        """
        with self._lock:
            short = turning_points(drive)
            q, converged = self._solve(short)
            for same in ((short[-1],), (TOP, short[-1])):
                known = self._known(same) if len(same) < len(short) else None
                if known is not None and np.abs(known - q).max() < _SAME:
                    return Rest(same, q, converged)
            return Rest(short, q, converged)

    def _solve(self, drive: Steps) -> tuple[np.ndarray, bool]:
        branch, goal = self._branch(drive), drive[-1]
        needed = branch.until(goal)
        while len(branch.solved) < needed:
            piece = branch.loads[len(branch.solved) : len(branch.solved) + _PIECE]
            branch.solved += self._follow(*branch.last(len(branch.solved)), piece)
        if goal % STRIDE == 0:
            return branch.solved[needed - 1]
        if goal not in branch.between:
            branch.between[goal] = self._follow(*branch.last(needed), [goal])[0]
        return branch.between[goal]

    def _follow(self, at: int, start: np.ndarray, loads: Sequence[int]) -> list[tuple[np.ndarray, bool]]:
        u = STEP * np.array(loads, float)[:, None]
        state = State(start[None], np.array([[STEP * at]], float))
        found = drive([self.robot], u, state=state, options=_ENOUGH)
        return list(zip(np.asarray(found.q[0]), found.converged[0].tolist(), strict=True))

    def _branch(self, drive: Steps) -> _Branch:
        """The branch that a drive ends on."""
        key = before, rises = _key(drive)
        branch = self._branches.get(key)
        if branch is None:
            start = self._solve(before)[0] if before else np.zeros(self.robot.dofs)
            first = before[-1] if before else -1
            way = range(first + 1, TOP + 1) if rises else range(first - 1, -1, -1)
            branch = self._branches[key] = _Branch(
                rises, max(first, 0), start, [k for k in way if k % STRIDE == 0]
            )
            while len(self._branches) > _BRANCHES:
                self._branches.popitem(last=False)
        self._branches.move_to_end(key)
        return branch

    def _known(self, drive: Steps) -> np.ndarray | None:
        """The coordinates at the end of a drive, if there is little to solve for them."""
        branch = self._branches.get(_key(drive))
        return (
            None if branch is None or len(branch.solved) < branch.until(drive[-1]) else self._solve(drive)[0]
        )


def _key(drive: Steps) -> tuple[Steps, bool]:
    """What names the branch that a drive ends on: the way to where it begins, and whether it rises."""
    return drive[:-1], len(drive) == 1 or drive[-1] > drive[-2]


def turning_points(drive: Sequence[int]) -> Steps:
    """The same way with nothing but its turns: 0 → 1 → 2 is 0 → 2; at least one actuation, the last."""
    kept: list[int] = []
    for each in drive:
        if kept and each == kept[-1]:
            continue
        before = kept[-2] if len(kept) > 1 else 0
        if kept and (each - kept[-1]) * (kept[-1] - before) > 0:
            kept[-1] = each
        else:
            kept.append(each)
    # At rest from the start: there is nothing to come back from.
    return tuple(kept[1:] if len(kept) > 1 and kept[0] == 0 else kept)


class PoseCache:
    """The exosuits asked for last."""

    def __init__(self) -> None:
        self._exosuits: OrderedDict[Exosuit, CachedExosuit] = OrderedDict()
        self._lock = Lock()

    def get(self, exosuit: Exosuit) -> CachedExosuit:
        """The exosuit with all that is known of it."""
        with self._lock:
            cached = self._exosuits.get(exosuit)
            if cached is None:
                cached = self._exosuits[exosuit] = CachedExosuit(exosuit)
                while len(self._exosuits) > _EXOSUITS:
                    self._exosuits.popitem(last=False)
            self._exosuits.move_to_end(exosuit)
            return cached
