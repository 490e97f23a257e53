"""The quasi-static driver: robots under loads that change infinitely slowly, many at a time.

`advance` brings each robot from its state to loads of its own; `drive` brings all along a path of loads, and
is the same as repeated `advance`. Substeps are chosen on the way (`continuation`), so the state at a load
does not depend on which others were asked for, but on where the loads turned back.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.batched_continuation import Kept, Snap, Solutions, solve
from exosight.mechanics.compiled_lanes import Common, Kinds, leaves_of
from exosight.mechanics.equilibrium import Equilibria, SolverOptions
from exosight.mechanics.lanes import Problems
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories

_DEFAULT = SolverOptions()


class State(NamedTuple):
    """A batch of robots at rest.

    q        (robots, dofs)
    loads    (robots, channels)   that they are under [N]
    history  (robots, ...)        what each term with a memory remembers, see `TermWithMemory`
    """

    q: Float[AnyArray, "robots dofs"]
    loads: Float[AnyArray, "robots channels"]
    history: Memories = ()


Robots = Robot | Sequence[Robot]
"""Robots of one structure (same bodies, bases, points and terms): several, or one batched as by `stack`."""


def initial_state(robots: Robots, channels: int | None = None, options: SolverOptions = _DEFAULT) -> State:
    """Every robot at zero load, as it comes to rest from the unstrained pose.

    channels   how many load channels there are; as many as the robots' terms need by default
    """
    batch = _batched(*_flat(robots))
    start = unstrained(batch, batch.loads if channels is None else channels)
    return advance(batch, start, np.asarray(start.loads), options)[0]


def advance(
    robots: Robots,
    state: State,
    loads: Float[np.ndarray, "robots channels"],
    options: SolverOptions = _DEFAULT,
) -> tuple[State, Equilibria]:
    """Each robot from its state to its own loads, on the straight way there.

    loads     (robots, channels)   u of each term's channel [N]
    returns   the state there, and Equilibria of shape (robots,)

    A robot that finds no stable equilibrium on its way stays in the last one, and says so in `converged`;
    its `State.loads` are the loads there. Raises InputError for what does not fit.
    """
    loads = np.asarray(loads, dtype=float)
    if loads.ndim != 2:
        raise InputError(f"loads: expected shape (robots, channels), got {loads.shape}")
    found = _solve(robots, loads[:, None], state, options)
    reached = State(found.q[:, 0], found.load[:, 0], tuple(rows[:, 0] for rows in found.history))
    return reached, _equilibria(found, 0)


def drive(
    robots: Robots,
    loads: Float[np.ndarray, "*robots loads channels"],
    *,
    state: State | None = None,
    options: SolverOptions = _DEFAULT,
    done: Callable[[int], None] = lambda robots: None,
    kept: Kept | None = None,
) -> Equilibria:
    """The equilibria of robots along paths of loads.

    loads     (loads, channels) for all robots, or (robots, loads, channels): u of each term's channel [N],
              in the order of the path, with straight ways between
    state     where the path starts; by default the unstrained pose at zero load
    done      called with the number of robots finished, as they finish
    kept      robots that an earlier call finished; keeps what this one does
    returns   Equilibria with batch shape (robots,) and fields (loads,)

    A robot that finds no stable equilibrium on the way to a load says so in `converged`, stays in the last
    one, and goes on from there to the next load. Compiled once a structure and number of lanes. Raises
    InputError for what does not fit.
    """
    return _equilibria(_solve(robots, loads, state, options, done, kept))


def locate_snaps(
    robots: Robots,
    loads: Float[np.ndarray, "*robots loads channels"],
    *,
    state: State | None = None,
    options: SolverOptions = _DEFAULT,
) -> tuple[Equilibria, list[list[Snap]]]:
    """What `drive` returns, and each robot's snaps in the order of its path."""
    found = _solve(robots, loads, state, options)
    return _equilibria(found), found.snaps


def unstrained(robots: Robot, channels: int) -> State:
    """Batched robots as they are made, at loads of 0; seldom at rest."""
    count = len(jax.tree.leaves(robots)[0])
    memories = tuple(np.asarray(memory) for memory in robots.memories)
    return State(np.zeros((count, robots.dofs)), np.zeros((count, channels)), memories)


def _solve(
    robots: Robots,
    loads: Float[np.ndarray, "*robots loads channels"],
    state: State | None,
    options: SolverOptions,
    done: Callable[[int], None] = lambda robots: None,
    kept: Kept | None = None,
) -> Solutions:
    rows, parts = _flat(robots)
    count, needed = len(rows), _needed(parts.structure, parts.kinds)
    loads = np.asarray(loads, dtype=float)
    if loads.ndim == 2:
        loads = np.broadcast_to(loads, (count, *loads.shape))
    if loads.ndim != 3 or len(loads) != count or not loads.shape[1]:
        raise InputError(
            f"loads: expected shape (loads, channels) or ({count}, loads, channels), at least one load, "
            f"got {loads.shape}"
        )
    if not np.all(np.isfinite(loads)):
        raise InputError("loads: expected finite numbers, got NaN or infinity among them")
    channels = loads.shape[2]
    if channels < needed.loads:
        raise InputError(f"loads: the robot's terms need {needed.loads} channels, got {channels}")
    if state is None:
        state = unstrained(_batched(rows, parts), channels)
    q, origin = np.asarray(state.q, dtype=float), np.asarray(state.loads, dtype=float)
    for name, value, shape in (("q", q, (count, needed.dofs)), ("loads", origin, (count, channels))):
        if value.shape != shape or not np.all(np.isfinite(value)):
            raise InputError(f"state.{name}: expected finite numbers of shape {shape}, got {value.shape}")
    for clock in needed.clocks:
        way = np.concatenate([origin[:, None, clock], loads[:, :, clock]], axis=1)
        if np.any(np.diff(way) < 0):
            raise InputError(f"loads: channel {clock} holds the time [s]; expected it never to fall")
    expected = [(count, *shape) for shape in needed.memories]
    history = tuple(np.asarray(memory, dtype=float) for memory in state.history)
    if [memory.shape for memory in history] != expected:
        raise InputError(
            f"state.history: expected one array for each term with a memory, of shapes "
            f"{expected}, got {[memory.shape for memory in history]}; "
            "give the history of the `State` or `Equilibria` that q comes from"
        )
    if not (options.eigenvalues or needed.energy):
        options = replace(options, eigenvalues=True)
    common = Common(parts.structure, parts.kinds, needed.dofs, channels, needed.memories)
    return solve(common, rows, Problems(q, origin, loads, history), options, done, kept)


class _Parts(NamedTuple):
    """A robot's own arrays with a leading axis of robots, their kinds without it, and its structure."""

    arrays: list[np.ndarray]
    kinds: Kinds
    structure: Any

    @property
    def rows(self) -> Float[np.ndarray, "robots numbers"]:
        """All numbers of each robot, one after the other."""
        numbers = [array.reshape(len(array), -1) for array in self.arrays]
        return np.concatenate(numbers, axis=1, dtype=float)


def _flat(robots: Robots) -> tuple[Float[np.ndarray, "robots numbers"], _Parts]:
    """All numbers of each robot, and the parts of the first; InputError for several structures, or none."""
    if isinstance(robots, Robot):
        batch = _parts(_Same(robots), batched=True)
        return batch.rows, batch
    if not robots:
        raise InputError("robots: expected at least one, got none")
    first, *others = (_parts(_Same(robot), batched=False) for robot in robots)
    if any(other.structure != first.structure or other.kinds != first.kinds for other in others):
        raise InputError("robots: expected one structure (bodies, bases, points, terms), got several")
    if not others:
        return first.rows, first
    return np.concatenate([first.rows, *(other.rows for other in others)]), first


def _batched(rows: Float[np.ndarray, "robots numbers"], parts: _Parts) -> Robot:
    """One robot of arrays with a leading axis of robots."""
    return jax.tree.unflatten(parts.structure, leaves_of(parts.kinds, rows))


class _Same:
    """A robot by which something is kept: the same one, not one of the same numbers."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def __hash__(self) -> int:
        return id(self.robot)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.robot is other.robot


@lru_cache(maxsize=256)
def _parts(same: _Same, batched: bool) -> _Parts:
    """What a robot, of several or of one, is made of; kept, as a control step asks for the same one again."""
    leaves, structure = jax.tree.flatten(same.robot)
    arrays = [np.asarray(leaf) if batched else np.asarray(leaf)[None] for leaf in leaves]
    return _Parts(arrays, tuple((array.shape[1:], array.dtype) for array in arrays), structure)


class _Needed(NamedTuple):
    """What robots of one structure need: coordinates, loads, of these the clocks, shapes of the memories; and
    whether all forces have an energy.
    """

    dofs: int
    loads: int
    clocks: set[int]
    memories: tuple[tuple[int, ...], ...]
    energy: bool


@lru_cache(maxsize=64)
def _needed(structure: Any, kinds: Kinds) -> _Needed:
    robot: Robot = jax.tree.unflatten(structure, [np.zeros(shape, kind) for shape, kind in kinds])
    memories = tuple(map(np.shape, robot.memories))
    return _Needed(robot.dofs, robot.loads, robot.clocks, memories, robot.conservative and not memories)


def _equilibria(found: Solutions, at: int | slice = slice(None)) -> Equilibria:
    """What was found at some of the loads."""
    history = tuple(rows[:, at] for rows in found.history)
    names = (name for name in Equilibria._fields if name != "history")
    return Equilibria(**{name: getattr(found, name)[:, at] for name in names}, history=history)
