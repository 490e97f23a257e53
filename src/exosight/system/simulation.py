"""Equilibria of a system under commands: along a path, in time, or each approached straight from rest."""

from itertools import pairwise
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray
from exosight.errors import ConvergenceError, InputError
from exosight.mechanics import Equilibria, State, drive
from exosight.mechanics.term import Memories
from exosight.system.observation import Observation, observe
from exosight.system.system import System, stack_systems

Commands = Float[np.ndarray, "commands channels"]
Times = Float[np.ndarray, " times"]

FINENESS = 50
"""Steps from one time to the next: each a 50th of the shortest relaxation time, or of what has passed. The
creep of a standard linear solid over 500 of its times is then off by 2e-6 of it, with 20 by 1.3e-5."""


class SystemStates(NamedTuple):
    """A system at some commands.

    commands      (commands, channels)   in the channels' units
    equilibria    of shape (commands, …)
    observation   of shape (commands, …)
    times         (commands,)            [s]; None: loads that change infinitely slowly
    """

    commands: Commands
    equilibria: Equilibria
    observation: Observation
    times: Times | None = None

    @property
    def q(self) -> Float[AnyArray, "commands dofs"]:
        """Coordinates."""
        return self.equilibria.q

    @property
    def history(self) -> Memories:
        """What terms with a memory remember."""
        return self.equilibria.history

    def state(self, system: System, step: int) -> State:
        """The system at one of the commands, as a path may start from."""
        q, *history = (part[step][None] for part in (self.equilibria.q, *self.equilibria.history))
        return State(q, timed_loads(system, self.commands, self.times)[step : step + 1], tuple(history))


def simulate_path(
    system: System, commands: Commands, state: State | None = None, times: Times | None = None
) -> SystemStates:
    """The stable equilibria of a system along a path, each the start of the next.

    commands   in the channels' units
    state      that the path starts from, of one system; by default it starts from rest
    times      when each command is reached [s], for rods that relax; commands change evenly in between,
               and at once where two times are equal. The path starts at 0 s, or at the time of `state`

    Raises InputError for no command, one outside the range of its channel, or times that fall or have no
    effect; ConvergenceError if there is no stable equilibrium on the way to some command.
    """
    commands = checked_commands(system, commands)
    if times is None:
        found = jax.tree.map(lambda leaf: leaf[0], drive([system.robot], system.loads(commands), state=state))
    else:
        if not system.relaxations:
            raise InputError(
                f"time: no rod of {system.name} relaxes, so times have no effect; leave them out, ask for a "
                "motion with inertia, or give a rod of a system file an entry relaxation"
            )
        start = 0.0 if state is None else float(np.asarray(state.loads)[0, -1])
        found = _relaxing(system, commands, check_times(times, len(commands), start), state)
    if not found.converged.all():
        lost = int(np.argmin(found.converged))
        at = [
            f"{c.name} = {u:g} {c.unit}" for c, u in zip(system.schema.channels, commands[lost], strict=True)
        ]
        at += [] if times is None else [f"{times[lost]:g} s"]
        raise ConvergenceError(f"no stable pose at {', '.join(at)}; choose a smaller range")
    return _observed(system, commands, found, times)


def simulate_system(system: System, commands: Commands) -> SystemStates:
    """The stable equilibrium of a system at each command, approached from rest along a straight line.

    commands   in the channels' units

    Raises InputError for no command, or one outside the range of its channel.
    """
    commands = checked_commands(system, commands)
    found = drive([system.robot] * len(commands), system.loads(commands)[:, None])
    return _observed(system, commands, jax.tree.map(lambda leaf: leaf[:, 0], found))


def _relaxing(system: System, commands: Commands, times: Times, state: State | None) -> Equilibria:
    """The equilibria along a path in time, interval by interval; the last ones where one is not found."""
    robots, loads = [system.robot_in_time], timed_loads(system, commands, times)
    fastest = min(float(np.min(each.time)) for each in system.relaxations)
    start = np.zeros(loads.shape[1]) if state is None else np.asarray(state.loads)[0]
    found: list[Equilibria] = []
    for before, after in pairwise([start, *loads]):
        share = _shares(float(after[-1] - before[-1]), fastest)
        part = jax.tree.map(
            lambda leaf: leaf[0],
            drive(robots, before + share[:, None] * (after - before), state=state),
        )
        last = jax.tree.map(lambda leaf: leaf[-1:], part)
        state = State(last.q, after[None], last.history)
        found.append(
            last._replace(
                converged=np.all(part.converged, keepdims=True),
                snapped=np.any(part.snapped, keepdims=True),
                tied=np.any(part.tied, keepdims=True),
                iterations=np.sum(part.iterations, keepdims=True),
            )
        )
        if not part.converged.all():
            break
    found += found[-1:] * (len(loads) - len(found))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *found)


def _shares(passed: float, fastest: float) -> Float[np.ndarray, " steps"]:
    """Ends of the steps of an interval of some length [s], as shares of it: ever longer ones."""
    ends = [fastest / FINENESS]
    while ends[-1] < passed or len(ends) < 2:  # a single load would be compiled on its own
        ends.append(ends[-1] + max(fastest, ends[-1]) / FINENESS)
    return np.array(ends) / ends[-1]


def timed_loads(
    system: System, commands: Commands, times: Times | None
) -> Float[np.ndarray, "commands loads"]:
    """The robot's loads [N or N m] and, where times are given, the time [s] as the last one."""
    loads = system.loads(commands)
    return loads if times is None else np.column_stack([loads, times])


def checked_commands(system: System, commands: Commands) -> Commands:
    """The commands; InputError for none, or one outside the range of its channel."""
    if np.ndim(commands) != 2 or not len(commands):
        raise InputError(f"commands: expected at least one row, a number a channel, got {np.shape(commands)}")
    return system.schema.check_commands(commands)


def check_times(times: Times, commands: int, start: float = 0.0) -> Times:
    """The times of so many commands [s]; InputError for another number, or times that fall."""
    times = np.asarray(times, float)
    if times.shape != (commands,):
        raise InputError(
            f"time: expected one for each of the {commands} commands, got {times.size}; repeat a "
            "command that is held"
        )
    if not np.isfinite(times).all() or np.any(np.diff(times, prepend=start) < 0):
        raise InputError(
            f"time: expected finite times [s] from {start:g} s on that never fall, got "
            f"{', '.join(f'{t:g}' for t in times[:8])}{' …' * (len(times) > 8)}"
        )
    return times


def _observed(
    system: System, commands: Commands, found: Equilibria, times: Times | None = None
) -> SystemStates:
    history = tuple(memory[None] for memory in found.history)
    seen = observe(stack_systems([system]), found.q[None], history)
    return SystemStates(commands, found, jax.tree.map(lambda leaf: np.asarray(leaf[0]), seen), times)
