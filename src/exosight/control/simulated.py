"""The simulated plant: a system, followed from equilibrium to equilibrium and rendered."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from exosight.control.loop import RATE
from exosight.control.plant import Observation
from exosight.control.views import stacked
from exosight.errors import ConvergenceError
from exosight.mechanics import Robot, State, advance, stack
from exosight.mechanics.term import Memories
from exosight.system.observation import Observation as Observed
from exosight.system.observation import observing
from exosight.system.schema import Schema
from exosight.system.system import System, stack_systems
from exosight.vision.scene import Axes, picture


@dataclass
class SimulatedPlant:
    """Quasi-static: at each command the system rests in the stable pose that the path so far leads to.

    As a system may snap between stable poses, the same command can show different readings on the way up and
    down (hysteresis); the same sequence of commands always shows the same.

        plant = SimulatedPlant(published(Exosuit(shape)))
        plant.apply(np.array([1.2])).reading("F_net")

    system  what is simulated; its first camera looks at it
    period  in which commands change, evenly, from one to the next [s]; matters where rods relax
    views   names of the cameras whose pictures are stacked instead, see `exosight.control.views`
    """

    system: System
    period: float = 1 / RATE
    views: tuple[str, ...] = ()
    schema: Schema = field(init=False)
    _observe: "Callable[..., Observed]" = field(init=False, repr=False)
    _walk: "Callable[[_Point, tuple[float, ...], float], tuple[_Point, bool]]" = field(init=False, repr=False)
    _now: "_Point | None" = field(init=False, repr=False, default=None)
    _converged: bool = field(init=False, repr=False, default=True)

    def __post_init__(self) -> None:
        self.schema = self.system.schema
        self._observe = observing(stack_systems([self.system]))
        # A loop that swings between two commands walks the same two ways for ever: they are remembered.
        self._robot = self.system.robot_in_time if self.system.relaxations else self.system.robot
        self._walk = lru_cache(maxsize=8)(partial(_walk, _Loads.of(self.system), stack([self._robot])))

    def reset(self) -> Observation:
        """Return to commands of 0 from the unstrained pose, forgetting the path so far.

        Raises ConvergenceError if the unloaded system has no stable pose.
        """
        nothing = (0.0,) * len(self.schema.channels)
        unstrained = _Point(nothing, (0.0,) * self._dofs, 1.0, _plain(self._robot.memories))
        rest, converged = self._walk(unstrained, nothing, 0.0)
        if not converged:
            raise ConvergenceError(
                f"the unloaded system {self.schema.system} has no stable pose; check its bodies and contacts"
            )
        self._now, self._converged = rest, converged
        return self.look()

    def apply(self, commands: Float[np.ndarray, " channels"]) -> Observation:
        """Change the commands [each in its channel's unit], from the present ones, and look at the pose.

        If no stable pose is found on the way, the plant stays in the last one, whose commands the observation
        tells.

        Raises InputError for commands that are no numbers within the channels' ranges.
        """
        self.move(commands)
        return self.look()

    def move(self, commands: Float[np.ndarray, " channels"]) -> None:
        """Change the commands without looking: `apply` is this and `look`."""
        wanted = self.schema.check_commands(commands)
        now = self._present()
        time = now.time + self.period if self.system.relaxations else 0.0
        self._now, self._converged = self._walk(now, tuple(wanted.tolist()), time)

    def look(self) -> Observation:
        """The pose as it is now."""
        point = self._present()
        q = np.array(point.q)
        history = tuple(np.array(memory) for memory in point.history)
        of_one = tuple(memory[None, None] for memory in history)
        seen = self._observe(q[None, None], of_one)
        return Observation(
            schema=self.schema,
            commands=np.array(point.commands),
            image=self._image({name: np.asarray(axis)[0] for name, axis in seen.axes.items()}),
            readings=np.asarray(seen.readings)[0, 0],
            q=q,
            converged=self._converged,
            min_eigenvalue=point.min_eigenvalue,
            history=history,
        )

    def _image(self, axes: Axes) -> UInt8[np.ndarray, "height width"]:
        if not self.views:
            return picture(self.system, axes)[0]
        cameras = dict(self.system.cameras)
        return stacked(
            [picture(replace(self.system, cameras=((name, cameras[name]),)), axes)[0] for name in self.views]
        )

    @property
    def _dofs(self) -> int:
        return sum(body.dofs for body in self.system.bodies)

    def _present(self) -> "_Point":
        if self._now is None:
            self.reset()
        assert self._now is not None
        return self._now


@dataclass(frozen=True)
class _Point:
    """One equilibrium, hashable by its numbers."""

    commands: tuple[float, ...]
    q: tuple[float, ...]
    min_eigenvalue: float
    history: tuple = ()
    time: float = 0.0


class _Loads(NamedTuple):
    """A robot's loads at commands, and back, see `System`: bound once, as binding takes longer than a call.

    in_time   the last load is the time [s]
    """

    at: Callable[[np.ndarray], np.ndarray]
    commands: Callable[[np.ndarray], np.ndarray]
    in_time: bool

    @classmethod
    def of(cls, system: System) -> "_Loads":
        return cls(system.loads, system.commands, bool(system.relaxations))


def _walk(
    of_robot: _Loads, stacked: Robot, start: _Point, commands: tuple[float, ...], time: float
) -> tuple[_Point, bool]:
    """The last equilibrium on the way from `start` to the commands, and whether that is the one at these."""
    loads = [
        np.array([[*of_robot.at(np.array(each)), *([then] if of_robot.in_time else [])]])
        for each, then in ((start.commands, start.time), (commands, time))
    ]
    memories = tuple(np.array(memory)[None] for memory in start.history)
    state, found = advance(stacked, State(np.array([start.q]), loads[0], memories), loads[1])
    converged = bool(found.converged[0])
    stopped = np.asarray(state.loads)[0]
    reached = commands if converged else tuple(of_robot.commands(stopped[: len(commands)]).tolist())
    q = tuple(np.asarray(state.q)[0].tolist())
    history = _plain(tuple(memory[0] for memory in state.history))
    at = float(stopped[-1]) if of_robot.in_time else 0.0
    return _Point(reached, q, float(found.min_eigenvalue[0]), history, at), converged


def _plain(memories: Memories) -> tuple:
    """Memories as numbers in tuples, which are hashable."""
    return tuple(tuple(map(tuple, np.asarray(memory).tolist())) for memory in memories)
