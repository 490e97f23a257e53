"""Many simulated plants side by side: each with its own system, its own commands, its own user."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from exosight.control.loop import RATE
from exosight.errors import ConvergenceError, InputError
from exosight.mechanics import JointTorque, Link, Robot, advance
from exosight.mechanics.equilibrium import SolverOptions
from exosight.mechanics.quasistatic import unstrained
from exosight.system.camera import Camera
from exosight.system.observation import observing
from exosight.system.schema import Schema, difference
from exosight.system.system import System, stack_systems
from exosight.vision.renderer import render
from exosight.vision.scene import tubes

_EXACT = SolverOptions()


@dataclass(frozen=True)
class Joints:
    """What the users do with the bodies that a system works on: springs that are stiffer or softer, and rest
    elsewhere. Coordinates are those of all links' joints, link by link.

    stiffness  (plants, coordinates)   [N m/rad or N/m]
    rest       (plants, coordinates)   where the spring is slack [rad or m]
    """

    stiffness: Float[np.ndarray, "plants coordinates"]
    rest: Float[np.ndarray, "plants coordinates"]


@dataclass(frozen=True)
class BatchState:
    """All plants at rest, each under its own commands.

    schema     of every plant
    commands   (plants, channels)  of these very poses [each in its channel's unit]: the ones asked for, where
               `converged`
    readings   (plants, sensors)   true readings of all sensors [each in its unit]
    q          (plants, dofs)      coordinates (radians, dimensionless strains)
    converged  (plants,)           False: no stable pose was found on the way, and this is the last one before
    axes       (plants, nodes, 3)  a tube: its axis, by the surface's name [m]
    """

    schema: Schema
    commands: Float[np.ndarray, "plants channels"]
    readings: Float[np.ndarray, "plants sensors"]
    q: Float[np.ndarray, "plants dofs"]
    converged: Bool[np.ndarray, " plants"]
    axes: Mapping[str, Float[np.ndarray, "plants nodes 3"]]

    def reading(self, sensor: str) -> Float[np.ndarray, " plants"]:
        """What one sensor reads on every plant [its unit]; InputError if there is none of this name."""
        return self.readings[:, self.schema.index(sensor)]

    @property
    def outputs(self) -> Float[np.ndarray, "plants outputs"]:
        """What the estimated sensors read, in the order of a network's outputs [each in its unit]."""
        return self.readings[:, self.schema.output_indices()]


@runtime_checkable
class Plants(Protocol):
    """Several plants that are stepped side by side: `BatchPlant`, or what stands for it."""

    schema: Schema

    @property
    def state(self) -> BatchState:
        """All plants as they are now."""
        ...

    def step(
        self,
        commands: Float[np.ndarray, "plants channels"],
        joints: Joints | None = None,
        seconds: float = 1 / RATE,
    ) -> BatchState:
        """Change every plant's commands, and perhaps the users' joints, as `BatchPlant.step` does."""
        ...

    def pictures(
        self, camera: Camera | None = None, which: Int[np.ndarray, " frames"] | None = None
    ) -> UInt8[np.ndarray, "frames height width"]:
        """What a camera sees of them."""
        ...


class BatchPlant:
    """As many `SimulatedPlant`s as systems, in one compiled call a step; quasi-static like these, with rods
    that relax and friction as the systems have them.

        plant = BatchPlant([designs.build(design) for design in designs.draw(8, seed=0)])
        state = plant.step(np.full((8, 1), 0.5))
        state.reading("F_net")

    systems   what is simulated; all of one structure and one schema
    options   of the solver

    Raises InputError for no systems, systems of several structures or schemas, or a path step that is not
    finite and above 0; ConvergenceError if an unloaded system has no stable pose.
    """

    def __init__(
        self,
        systems: Sequence[System],
        options: SolverOptions = _EXACT,
    ) -> None:
        if not systems:
            raise InputError("plants: expected at least one system, got none")
        self.schema, self._options = systems[0].schema, replace(options, eigenvalues=False)
        unlike = (difference(self.schema, system.schema, ("channels", "sensors")) for system in systems[1:])
        if found := next((words for words in unlike if words), None):
            raise InputError(f"plants: expected systems of one schema; {found}")
        self.systems = tuple(systems)
        self._gain = np.stack([system.loads(np.ones(len(self.schema.channels))) for system in systems])
        movable = {id(system): _movable(system) for system in systems}
        self._stacked = stack_systems(systems)
        self._observe = observing(self._stacked)
        self._own = stack_systems([movable[id(system)] for system in systems])
        self._links = [body for body in systems[0].bodies if isinstance(body, Link) and body.joint.dofs]
        count = len(systems)
        channels = len(self.schema.channels)
        self._timed = bool(systems[0].relaxations)
        self._time = np.zeros(count)  # [s]
        nothing = np.zeros((count, channels + self._timed + self._coordinates))
        start = unstrained(self._own, nothing.shape[1])
        self._at_rest, found = advance(self._own, start, nothing, options)
        if not found.converged.all():
            raise ConvergenceError(
                f"{int((~found.converged).sum())} of {count} unloaded systems have no stable pose; "
                "check their bodies and contacts"
            )
        self._reached = self._at_rest
        self._commands = np.zeros((count, channels))
        self._joints = self.resting
        self.reset()

    def __len__(self) -> int:
        return len(self.systems)

    @property
    def _coordinates(self) -> int:
        return sum(link.joint.dofs for link in self._links)

    @property
    def resting(self) -> Joints:
        """The joints as the systems have them."""
        springs = [self._own[link.name].joint.stiffness for link in self._links]
        none = np.zeros((len(self), 0))
        stiffness = np.concatenate([none, *(np.asarray(s, dtype=float) for s in springs)], axis=1)
        return Joints(stiffness, np.zeros_like(stiffness))

    @property
    def state(self) -> BatchState:
        """All plants as they are now."""
        return self._state

    def reset(self, which: Bool[np.ndarray, " plants"] | None = None) -> BatchState:
        """Return to commands of 0 from the unstrained pose, forgetting the path; by default all of them."""
        chosen = np.ones(len(self), bool) if which is None else np.asarray(which, bool)
        column, own = chosen[:, None], self.resting
        self._reached = jax.tree.map(
            lambda rest, now: np.where(chosen.reshape(-1, *[1] * (np.ndim(now) - 1)), rest, now),
            self._at_rest,
            self._reached,
        )
        self._commands = np.where(column, 0.0, self._commands)
        self._time = np.where(chosen, 0.0, self._time)
        self._hold(
            Joints(
                np.where(column, own.stiffness, self._joints.stiffness),
                np.where(column, own.rest, self._joints.rest),
            )
        )
        return self._look(np.ones(len(self), bool))

    def step(
        self,
        commands: Float[np.ndarray, "plants channels"],
        joints: Joints | None = None,
        seconds: float = 1 / RATE,
    ) -> BatchState:
        """Change every plant's commands [each in its channel's unit], and perhaps the users' joints.

        A plant that finds no stable pose on the way stays in the last one, whose commands its state
        tells.

        commands  (plants, channels)
        joints    by default as they are
        seconds   in which they change, evenly; matters where rods relax

        Raises InputError for commands of another shape or beyond the channels' ranges, joints that are no
        springs, or a time below 0.
        """
        if np.ndim(commands) != 2 or len(commands) != len(self):
            raise InputError(
                f"commands: expected shape ({len(self)}, {len(self.schema.channels)}), a row a plant, got "
                f"{np.shape(commands)}"
            )
        if not 0 <= seconds < np.inf:
            raise InputError(f"step: expected a finite time of at least 0 s, got {seconds}")
        asked = self.schema.check_commands(commands)
        if joints is not None:
            self._check(joints)
            self._hold(joints)
        self._time = self._time + seconds
        time = self._time[:, None][:, : self._timed]
        end = np.column_stack([asked * self._gain, time, self._joints.stiffness * self._joints.rest])
        self._reached, found = advance(self._robots, self._reached, end, self._options)
        converged = np.asarray(found.converged)
        stopped = np.asarray(self._reached.loads)[:, : asked.shape[1]] / self._gain
        self._commands = np.where(converged[:, None], asked, stopped)
        return self._look(converged)

    def pictures(
        self, camera: Camera | None = None, which: Int[np.ndarray, " frames"] | None = None
    ) -> UInt8[np.ndarray, "frames height width"]:
        """What a camera sees of the plants as they are now, gray 0…255; by default the systems' first one, of
        all plants in order.
        """
        chosen = np.arange(len(self)) if which is None else which
        axes = {name: axis[chosen] for name, axis in self._state.axes.items()}
        own = jax.tree.map(lambda leaf: leaf[chosen], self._stacked)
        return render(tubes(own, axes), camera or own.camera, None, own.visibility)

    def _look(self, converged: Bool[np.ndarray, " plants"]) -> BatchState:
        q = np.array(self._reached.q)
        history = tuple(memory[:, None] for memory in self._reached.history)
        seen = jax.device_get(self._observe(q[:, None], history))
        self._state = BatchState(
            self.schema,
            self._commands.copy(),
            seen.readings[:, 0],
            q,
            converged,
            {name: axis[:, 0] for name, axis in seen.axes.items()},
        )
        return self._state

    def _check(self, joints: Joints) -> None:
        shape = (len(self), self._coordinates)
        if not joints.stiffness.shape == joints.rest.shape == shape:
            raise InputError(f"joints: expected stiffness and rest of shape {shape}, got another")
        springs = np.isfinite(joints.stiffness).all() and (joints.stiffness >= 0).all()
        if not (np.isfinite(joints.rest).all() and springs):
            raise InputError("joints: expected finite rest angles and finite stiffness of at least 0 N m/rad")

    def _hold(self, joints: Joints) -> None:
        """Put the springs into the robots; where they rest is a load."""
        self._joints = joints
        ends = np.cumsum([link.joint.dofs for link in self._links])
        springs = [jnp.asarray(part) for part in np.split(joints.stiffness, ends[:-1], axis=1)]
        self._robots = eqx.tree_at(
            lambda robots: [robots[link.name].joint.stiffness for link in self._links],
            self._own,
            springs if self._links else [],
        )


def _movable(system: System) -> Robot:
    """The robot with a torque at each joint coordinate: k times the place at which its spring is slack.

    Its loads are those of the channels, the time [s] where rods relax, and the torques.
    """
    timed = bool(system.relaxations)
    robot, channel = system.robot_in_time if timed else system.robot, len(system.actuators) + timed
    torques: list[JointTorque] = []
    for body in robot.bodies:
        if isinstance(body, Link):
            for coordinate in range(body.joint.dofs):
                torques.append(JointTorque(body.name, channel + len(torques), coordinate))
    return Robot(robot.bodies, (*robot.terms, *torques))
