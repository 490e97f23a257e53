"""The quasi-static driver: robots under loads that change infinitely slowly, many at a time.

`advance` brings each robot from its state to loads of its own; `drive` brings all along a path of loads, and
is the same as repeated `advance`. Substeps are chosen on the way (`continuation`), so the state at a load
does not depend on which others were asked for, but on where the loads turned back.
"""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.batched_continuation import Kept, Snap, Solutions, solve
from exosight.mechanics.equilibrium import Equilibria, SolverOptions, stack
from exosight.mechanics.lanes import Problems
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories

_DEFAULT = SolverOptions()


class State(eqx.Module):
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
    batch = _batched(robots)
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
    batch = _batched(robots)
    loads = np.asarray(loads, dtype=float)
    if loads.ndim != 2:
        raise InputError(f"loads: expected shape (robots, channels), got {loads.shape}")
    found = _solve(batch, loads[:, None], state, options)
    reached = State(found.q[:, 0], found.load[:, 0], tuple(rows[:, 0] for rows in found.history))
    return reached, jax.tree.map(lambda leaf: leaf[:, 0], _equilibria(found))


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
    return _equilibria(_solve(_batched(robots), loads, state, options, done, kept))


def locate_snaps(
    robots: Robots,
    loads: Float[np.ndarray, "*robots loads channels"],
    *,
    state: State | None = None,
    options: SolverOptions = _DEFAULT,
) -> tuple[Equilibria, list[list[Snap]]]:
    """What `drive` returns, and each robot's snaps in the order of its path."""
    found = _solve(_batched(robots), loads, state, options)
    return _equilibria(found), found.snaps


def _batched(robots: Robots) -> Robot:
    if isinstance(robots, Robot):
        return robots
    if not robots:
        raise InputError("robots: expected at least one, got none")
    if len({jax.tree.structure(robot) for robot in robots}) > 1:
        raise InputError("robots: expected one structure (bodies, bases, points, terms), got several")
    return stack(robots)


def unstrained(robots: Robot, channels: int) -> State:
    """Batched robots as they are made, at loads of 0; seldom at rest."""
    count = len(jax.tree.leaves(robots)[0])
    memories = tuple(np.asarray(memory) for memory in robots.memories)
    return State(np.zeros((count, robots.dofs)), np.zeros((count, channels)), memories)


def _solve(
    robots: Robot,
    loads: Float[np.ndarray, "*robots loads channels"],
    state: State | None,
    options: SolverOptions,
    done: Callable[[int], None] = lambda robots: None,
    kept: Kept | None = None,
) -> Solutions:
    leaves, structure = jax.tree.flatten(robots)
    leaves = [np.asarray(leaf) for leaf in leaves]
    count = len(leaves[0])
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
    if channels < robots.loads:
        raise InputError(f"loads: the robot's terms need {robots.loads} channels, got {channels}")
    state = unstrained(robots, channels) if state is None else state
    q, origin = np.asarray(state.q, dtype=float), np.asarray(state.loads, dtype=float)
    for name, value, shape in (("q", q, (count, robots.dofs)), ("loads", origin, (count, channels))):
        if value.shape != shape or not np.all(np.isfinite(value)):
            raise InputError(f"state.{name}: expected finite numbers of shape {shape}, got {value.shape}")
    for clock in robots.clocks:
        way = np.concatenate([origin[:, None, clock], loads[:, :, clock]], axis=1)
        if np.any(np.diff(way) < 0):
            raise InputError(f"loads: channel {clock} holds the time [s]; expected it never to fall")
    expected = [np.shape(memory) for memory in robots.memories]
    history = tuple(np.asarray(memory, dtype=float) for memory in state.history)
    if [memory.shape for memory in history] != expected:
        raise InputError(
            f"state.history: expected one array for each term with a memory, of shapes "
            f"{expected}, got {[memory.shape for memory in history]}; "
            "give the history of the `State` or `Equilibria` that q comes from"
        )
    problems = Problems(structure, leaves, q, origin, loads, history)
    return solve(problems, options, done, kept)


def _equilibria(found: Solutions) -> Equilibria:
    return Equilibria(**{name: getattr(found, name) for name in Equilibria.__dataclass_fields__})
