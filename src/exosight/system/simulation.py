"""Equilibria of a system under commands: along a path, or each approached straight from rest."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from exosight.errors import ConvergenceError, InputError
from exosight.mechanics import Equilibria, State, drive
from exosight.system.observation import Observation, observe
from exosight.system.system import System, stack_systems

Commands = Float[np.ndarray, "commands channels"]


class SystemStates(NamedTuple):
    """A system at some commands.

    commands      (commands, channels)   in the channels' units
    equilibria    of shape (commands, …)
    observation   of shape (commands, …)
    """

    commands: Commands
    equilibria: Equilibria
    observation: Observation

    def state(self, system: System, step: int) -> State:
        """The system at one of the commands, as a path may start from."""
        q, *history = (part[step][None] for part in (self.equilibria.q, *self.equilibria.history))
        return State(q, system.loads(self.commands[step : step + 1]), tuple(history))


def simulate_path(system: System, commands: Commands, state: State | None = None) -> SystemStates:
    """The stable equilibria of a system along a path, each the start of the next.

    commands   in the channels' units
    state      that the path starts from, of one system; by default it starts from rest

    Raises InputError for no command, or one outside the range of its channel; ConvergenceError if there is no
    stable equilibrium on the way to some command.
    """
    commands = _checked(system, commands)
    loads = system.loads(commands)
    found = drive([system.robot], loads, state=state)
    if not found.converged.all():
        lost = commands[int(np.argmin(found.converged[0]))]
        at = ", ".join(
            f"{c.name} = {u:g} {c.unit}" for c, u in zip(system.schema.channels, lost, strict=True)
        )
        raise ConvergenceError(f"no stable pose at {at}; choose a smaller range")
    return _observed(system, commands, jax.tree.map(lambda leaf: leaf[0], found))


def simulate_system(system: System, commands: Commands) -> SystemStates:
    """The stable equilibrium of a system at each command, approached from rest along a straight line.

    commands   in the channels' units

    Raises InputError for no command, or one outside the range of its channel.
    """
    commands = _checked(system, commands)
    found = drive([system.robot] * len(commands), system.loads(commands)[:, None])
    return _observed(system, commands, jax.tree.map(lambda leaf: leaf[:, 0], found))


def _checked(system: System, commands: Commands) -> Commands:
    if np.ndim(commands) != 2 or not len(commands):
        raise InputError(f"commands: expected at least one row, a number a channel, got {np.shape(commands)}")
    return system.schema.check_commands(commands)


def _observed(system: System, commands: Commands, found: Equilibria) -> SystemStates:
    history = tuple(memory[None] for memory in found.history)
    seen = observe(stack_systems([system]), found.q[None], history)
    return SystemStates(commands, found, jax.tree.map(lambda leaf: np.asarray(leaf[0]), seen))
