"""A system in motion: inertia, viscosity and damping, under commands that change in time."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray
from exosight.errors import ConvergenceError, InputError
from exosight.mechanics import MotionOptions, Trajectories, drive, evolve
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories
from exosight.system.observation import Observation, observe
from exosight.system.simulation import Commands, Times, check_times, checked_commands, timed_loads
from exosight.system.system import System, stack_systems

FINE = MotionOptions(tolerance=1e-9)
"""A link of 20 g that meets a floor of 20 kN/m with 0.08 m/s is 0.04 mm deep for 1.6 ms, and leaves with
0.5 % more speed than it should; at the default of `MotionOptions` with 2 %."""

MOST_TIMES = 100_000
"""Reported of a motion at most."""


class SystemMotion(NamedTuple):
    """A system at the reported times.

    times          (times,)             [s]; one is there twice where commands change at once
    commands       (times, channels)    in the channels' units
    trajectories   of shape (times, …)
    observation    of shape (times, …)  contact forces without the part of their damping
    """

    times: Times
    commands: Commands
    trajectories: Trajectories
    observation: Observation

    @property
    def q(self) -> Float[AnyArray, "times dofs"]:
        """Coordinates."""
        return self.trajectories.q

    @property
    def history(self) -> Memories:
        """What terms with a memory remember."""
        return self.trajectories.history


def simulate_motion(
    system: System, commands: Commands, times: Times, period: float, options: MotionOptions = FINE
) -> SystemMotion:
    """The motion of a system from rest at 0 s, where no command acts.

    commands   in the channels' units
    times      when each is reached [s]; commands change evenly in between, and at once where two are equal
    period     between reported times [s]; those of the commands are reported too
    options    how finely it is computed

    Raises InputError for commands or times that are none, more than MOST_TIMES times to report, and a
    coordinate that moves no mass; ConvergenceError where the motion cannot be continued.
    """
    commands = checked_commands(system, commands)
    times = check_times(times, len(commands))
    if not 0 < period < np.inf:
        raise InputError(f"motion: expected a finite period above 0 s between reports, got {period:g}")
    if times[-1] == 0:
        raise InputError("time: expected a motion that ends after 0 s, got 0 s")
    if times[-1] / period > MOST_TIMES:
        raise InputError(
            f"motion: expected at most {MOST_TIMES} reports, got {times[-1]:g} s in steps of {period:g} s; "
            "choose a longer period"
        )
    rest = np.zeros((1, commands.shape[1]))
    loads = timed_loads(system, rest, np.zeros(1))
    start = jax.tree.map(lambda leaf: leaf[0], drive([system.robot_in_time], loads))
    if not start.converged.all():
        raise ConvergenceError("no stable pose at rest, from which a motion starts")
    robot, q, velocity = (
        system.robot_in_time.with_memories(_last(start.history)),
        start.q,
        np.zeros_like(start.q),
    )
    parts: list[tuple[Times, Commands, Trajectories]] = []
    for reported, driven in _stretches(np.array([0.0, *times]), np.vstack([rest, commands]), period):
        part = _moved(robot, reported, timed_loads(system, driven, reported), q, velocity, options)
        if not part.converged.all():
            at = reported[int(np.argmin(part.converged))]
            raise ConvergenceError(
                f"the motion cannot be continued to {at:g} s; look at shorter times, and at stiffness and "
                "damping there"
            )
        parts.append((reported, driven, _after(parts[-1][2] if parts else None, part)))
        robot, q, velocity = robot.with_memories(_last(part.history)), part.q[-1:], part.velocity[-1:]
    found = jax.tree.map(lambda *leaves: np.concatenate(leaves), *(part for *_, part in parts))
    seen = observe(stack_systems([system]), found.q[None], tuple(memory[None] for memory in found.history))
    return SystemMotion(
        found.time,
        np.concatenate([driven for _, driven, _ in parts]),
        found,
        jax.tree.map(lambda leaf: np.asarray(leaf[0]), seen),
    )


def _stretches(times: Times, commands: Commands, period: float) -> Iterator[tuple[Times, Commands]]:
    """Between commands that change at once: the reported times, and the commands then."""
    jumps = np.flatnonzero(np.diff(times) == 0) + 1
    for own, driven in zip(np.split(times, jumps), np.split(commands, jumps), strict=True):
        if len(own) < 2:
            continue  # another command at the same time follows, or the end
        between = np.arange(np.ceil(own[0] / period), np.floor(own[-1] / period) + 1) * period
        # One that differs from a time of a command by round-off is that time.
        apart = np.min(np.abs(between[:, None] - own), axis=1) > 1e-6 * period
        reported = np.sort(np.concatenate([own, between[apart]]))
        yield reported, np.stack([np.interp(reported, own, column) for column in driven.T], axis=1)


def _moved(
    robot: Robot,
    times: Times,
    loads: Float[np.ndarray, "times loads"],
    q: Float[AnyArray, "1 dofs"],
    velocity: Float[AnyArray, "1 dofs"],
    options: MotionOptions,
) -> Trajectories:
    found = evolve([robot], times, loads, q=np.asarray(q), velocity=np.asarray(velocity), options=options)
    return replace(jax.tree.map(lambda leaf: leaf[0], found), time=found.time)


def _after(before: Trajectories | None, part: Trajectories) -> Trajectories:
    """With what was supplied and dissipated before; a change of commands at once supplies the change of Π."""
    if before is None:
        return part
    given = before.supplied[-1] + part.potential[0] - before.potential[-1]
    return replace(part, supplied=part.supplied + given, dissipated=part.dissipated + before.dissipated[-1])


def _last(history: Memories) -> Memories:
    return tuple(memory[-1] for memory in history)
