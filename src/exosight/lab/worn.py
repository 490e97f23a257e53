"""Worn exosuits at rest along the way that they are driven, solved once and remembered.

A pose follows from the way to it (hysteresis), so it is known by the exosuit and the actuations driven to
from rest: (4, 2.4) is up to 4 N and down to 2.4 N. The way between two of them is a leg over every multiple
of STEP, solved in pieces that always begin at the same places. So a pose does not depend on what else was
asked for, and while u moves on a leg that is known, nothing is solved at all.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from threading import Lock

import numpy as np
from jaxtyping import Float

from exosight.exosuit.assembly import Exosuit, assemble
from exosight.lab.settings import LARGEST, STEP
from exosight.mechanics import Robot, SolverOptions, follow, stack

TOP = round(LARGEST / STEP)
"""Largest actuation, in steps."""

_PIECE = 10  # loads a solver call: 3 ms a call, 1 ms a load that nobody asked for
_LEGS = 64  # legs that one exosuit remembers
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
class _Leg:
    loads: list[int]
    start: np.ndarray
    q: list[np.ndarray] = field(default_factory=list)
    converged: list[bool] = field(default_factory=list)


class Worn:
    """One worn exosuit and the legs that are known of it; may be asked from several threads."""

    def __init__(self, exosuit: Exosuit) -> None:
        self.exosuit = exosuit
        self.robot: Robot = assemble(exosuit)
        self.stacked: Robot = stack([self.robot])
        self._legs: OrderedDict[tuple[Steps, int], _Leg] = OrderedDict()
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
        leg, place = self._leg(drive)
        while len(leg.q) <= place:
            piece = leg.loads[len(leg.q) : len(leg.q) + _PIECE]
            before = leg.q[-1] if leg.q else leg.start
            loads = STEP * np.array(piece, float)[:, None]
            found = follow([self.robot], loads, q=before[None], options=_ENOUGH, snaps=False)
            leg.q += list(np.asarray(found.q[0]))
            leg.converged += found.converged[0].tolist()
        return leg.q[place], leg.converged[place]

    def _leg(self, drive: Steps) -> tuple[_Leg, int]:
        """The leg that a drive ends on, and its place there."""
        key, place = _place(drive)
        before, direction = key
        leg = self._legs.get(key)
        if leg is None:
            if before:
                start, _ = self._solve(before)
                first = before[-1] + direction
            else:
                start, first = np.zeros(self.robot.dofs), 0
            leg = _Leg(list(range(first, TOP + 1) if direction > 0 else range(first, -1, -1)), start)
            self._legs[key] = leg
            while len(self._legs) > _LEGS:
                self._legs.popitem(last=False)
        self._legs.move_to_end(key)
        return leg, place

    def _known(self, drive: Steps) -> np.ndarray | None:
        key, place = _place(drive)
        leg = self._legs.get(key)
        return leg.q[place] if leg is not None and place < len(leg.q) else None


def _place(drive: Steps) -> tuple[tuple[Steps, int], int]:
    """A leg by where it turned last and its direction, and the place of the drive's end on it."""
    if len(drive) == 1:
        return ((), 1), drive[0]
    direction = 1 if drive[-1] > drive[-2] else -1
    return (drive[:-1], direction), abs(drive[-1] - drive[-2]) - 1


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


class Wardrobe:
    """The exosuits asked for last."""

    def __init__(self) -> None:
        self._worn: OrderedDict[Exosuit, Worn] = OrderedDict()
        self._lock = Lock()

    def wear(self, exosuit: Exosuit) -> Worn:
        """The exosuit with all that is known of it."""
        with self._lock:
            worn = self._worn.get(exosuit)
            if worn is None:
                worn = self._worn[exosuit] = Worn(exosuit)
                while len(self._worn) > _EXOSUITS:
                    self._worn.popitem(last=False)
            self._worn.move_to_end(exosuit)
            return worn
