"""Equilibria of a system under commands, each approached straight from rest."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.mechanics import Equilibria, drive
from exosight.system.observation import Observation, observe
from exosight.system.system import System, stack_systems


class Answer(NamedTuple):
    """What a system does at some commands.

    commands      (commands, channels)   in the channels' units
    equilibria    of shape (commands, …)
    observation   of shape (commands, …)
    """

    commands: Float[np.ndarray, "commands channels"]
    equilibria: Equilibria
    observation: Observation


def simulate_system(system: System, commands: Float[np.ndarray, "commands channels"]) -> Answer:
    """The stable equilibrium of a system at each command, approached from rest along a straight line.

    Raises InputError for no command, or one outside the range of its channel.
    """
    channels = system.schema.channels
    commands = np.asarray(commands, float)
    if commands.ndim != 2 or not len(commands) or commands.shape[1] != len(channels):
        raise InputError(
            f"commands: expected (commands, {len(channels)}), one number a channel, got {commands.shape}"
        )
    for channel, values in zip(channels, commands.T, strict=True):
        wrong = values[~((values >= channel.low) & (values <= channel.high))]  # NaN too
        if wrong.size:
            raise InputError(
                f"{channel.name}: expected {channel.low:g} to {channel.high:g} {channel.unit}, got "
                f"{wrong[0]:g}"
            )
    found = drive([system.robot] * len(commands), system.loads(commands)[:, None])
    at: Equilibria = jax.tree.map(lambda leaf: leaf[:, 0], found)
    seen = observe(stack_systems([system]), at.q[None])
    return Answer(commands, at, jax.tree.map(lambda leaf: np.asarray(leaf[0]), seen))
