"""Plants whose forces are looked up: for so many episodes that solving each would take days.

A table holds the outputs of some systems F(u, k, θ) over the command, the stiffness of the user's joints and
the angle at which they rest, solved once. What has a memory acts on the command before it is looked up:

    creep      y = (1 − g) u + g z,   dz/dt = (u − z)(1 − g)/τ       a standard linear solid: strain follows y
    friction   x moves only as far as y/(1 + κμ) ≤ x ≤ y/(1 − κμ)    a play that grows with the command

Creep is exact for a rod whose load is u alone; κ is fitted to one pair of solved paths. What is left out:
jumps, and sticking at u = 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from exosight.control.batch import BatchPlant, BatchState, Joints
from exosight.control.loop import RATE
from exosight.control.paths import ControllerConfig
from exosight.control.stress.episodes import Episode
from exosight.control.stress.plants import Creep, with_friction_and_creep
from exosight.errors import InputError
from exosight.system.camera import Camera
from exosight.system.system import System

FACTORS = np.geomspace(0.7, 1.4, 3)
"""Of the joints' own stiffness, even in their logarithm."""
ANGLES = np.deg2rad([0.0, 5.0, 10.0])
"""At which the first joint rests [rad]; the others take their share of it."""
_STEPS = 40  # of u a peak of the channel


@dataclass(frozen=True, eq=False)
class ForceTable:
    """Outputs of some systems over command and user.

    systems   that were solved
    config    which channel is driven
    share     (coordinates,)  of the resting angle that each joint coordinate takes
    u         (commands,)     rising, evenly spaced [the channel's unit]
    outputs   (systems, factors, angles, commands, outputs)   [each in its unit]
    play      κ [-]
    """

    systems: tuple[System, ...]
    config: ControllerConfig
    share: Float[np.ndarray, " coordinates"]
    u: Float[np.ndarray, " commands"]
    outputs: Float[np.ndarray, "systems factors angles commands outputs"]
    play: float

    def plants(self, episodes: Sequence[Episode]) -> "TabulatedPlants":
        """The plants of episodes, all of whose systems are among those of the table, at rest."""
        return TabulatedPlants(self, episodes)


def solve_table(
    systems: Sequence[System], config: ControllerConfig, share: Float[np.ndarray, " coordinates"]
) -> ForceTable:
    """Solve every system with every user, from u = 0 up to u_max and down to u_min.

    systems   all of one structure, with the first one that which κ is fitted on
    """
    spacing = config.driven.peak / _STEPS
    rising = np.arange(0.0, config.u_max + 2 * spacing, spacing)
    falling = np.arange(0.0, config.u_min - spacing, -spacing)[1:]
    users = [(factor, angle) for factor in FACTORS for angle in ANGLES]
    plant = BatchPlant([system for system in systems for _ in users])
    own = plant.resting.stiffness
    factor, angle = (np.tile(values, len(systems)) for values in np.array(users).T)
    joints = Joints(own * factor[:, None], angle[:, None] * share)

    def path(commands: np.ndarray) -> list[np.ndarray]:
        plant.reset()
        plant.step(config.commands(np.zeros(len(own))), joints)
        return [plant.step(config.commands(np.full(len(own), u))).outputs for u in commands]

    outputs = np.stack([*path(falling)[::-1], *path(rising)], axis=1)
    shape = (len(systems), len(FACTORS), len(ANGLES), *outputs.shape[1:])
    u = np.concatenate([falling[::-1], rising])
    return ForceTable(
        tuple(systems), config, share, u, outputs.reshape(shape), _fitted_play(systems[0], config, rising)
    )


def _fitted_play(system: System, config: ControllerConfig, rising: np.ndarray) -> float:
    """κ: half the difference of the commands at which the sensor reads the same on the way up and down, as a
    share of their mean and of the coefficient."""
    coefficient = 0.3
    plant = BatchPlant([with_friction_and_creep(system, coefficient, None)])
    up, down = (
        np.array([config.sum(plant.step(config.commands(np.array([u]))).outputs[0]) for u in commands])
        for commands in (rising, rising[::-1])
    )
    largest = min(up.max(), down.max())
    readings = np.linspace(0.2, 0.8, 13) * largest
    loading = np.interp(readings, np.maximum.accumulate(up), rising)
    unloading = np.interp(readings, np.maximum.accumulate(down[::-1]), rising)
    return float(np.median((loading - unloading) / (loading + unloading))) / coefficient


class TabulatedPlants:
    """Many plants of a table, stepped side by side; stands for `BatchPlant` where nobody looks at pictures.

    Raises InputError for an episode whose system is not of the table.
    """

    def __init__(self, table: ForceTable, episodes: Sequence[Episode]) -> None:
        rows: Mapping[int, int] = {id(system): row for row, system in enumerate(table.systems)}
        if not all(id(episode.system) in rows for episode in episodes):
            raise InputError("tabulated plants: expected episodes of the systems in the table")
        self._table, self.schema = table, table.config.schema
        self._row = np.array([rows[id(episode.system)] for episode in episodes])
        self._own = np.stack([episode.stiffness[0] for episode in episodes])
        creeps = [episode.creep or Creep(0.0, 1.0) for episode in episodes]
        self._share = np.array([creep.share for creep in creeps])
        self._retardation = np.array([creep.time / (1 - creep.share) for creep in creeps])
        self._play = table.play * np.array([episode.friction or 0.0 for episode in episodes])
        self._crept = self._at = np.zeros(len(episodes))
        self.step(table.config.commands(np.zeros(len(episodes))), seconds=0.0)

    @property
    def state(self) -> BatchState:
        """All plants as they are now; of the sensors only those that are estimated or controlled."""
        return self._state

    def step(
        self,
        commands: Float[np.ndarray, "plants channels"],
        joints: Joints | None = None,
        seconds: float = 1 / RATE,
    ) -> BatchState:
        """As `BatchPlant.step`; joints are those at rest unless they are given."""
        table, config = self._table, self._table.config
        asked = self.schema.check_commands(commands)
        u = asked[:, self.schema.channel_index(config.channel)]
        factor, angle = np.ones(len(u)), np.zeros(len(u))
        if joints is not None:
            factor, angle = joints.stiffness[:, 0] / self._own[:, 0], joints.rest[:, 0] / table.share[0]
        self._crept = u + (self._crept - u) * np.exp(-seconds / self._retardation)
        y = (1 - self._share) * u + self._share * self._crept
        ends = y / (1 + self._play), y / np.maximum(1 - self._play, 0.1)
        self._at = np.clip(self._at, np.minimum(*ends), np.maximum(*ends))
        outputs = self._looked_up(factor, angle, self._at)
        readings = np.full((len(u), len(self.schema.sensors)), np.nan)
        readings[:, self.schema.output_indices()] = outputs
        self._state = BatchState(
            self.schema, asked, readings, np.zeros((len(u), 0)), np.ones(len(u), bool), {}
        )
        return self._state

    def pictures(
        self, camera: Camera | None = None, which: Int[np.ndarray, " frames"] | None = None
    ) -> UInt8[np.ndarray, "frames height width"]:
        """There are none: InputError."""
        raise InputError("tabulated plants: expected true readings as the sensor; they have no pictures")

    def _looked_up(
        self, factor: np.ndarray, angle: np.ndarray, u: np.ndarray
    ) -> Float[np.ndarray, "plants outputs"]:
        """Linear between the entries of the table, and at its ends beyond."""
        table = self._table
        found = 0.0
        places = [
            _place(np.log(factor / FACTORS[0]) / np.log(FACTORS[1] / FACTORS[0]), len(FACTORS)),
            _place(angle / ANGLES[1], len(ANGLES)),
            _place((u - table.u[0]) / (table.u[1] - table.u[0]), len(table.u)),
        ]
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(
                [share if up else 1 - share for (_, share), up in zip(places, corner, strict=True)], axis=0
            )
            i, j, k = (first + up for (first, _), up in zip(places, corner, strict=True))
            found = found + weight[:, None] * table.outputs[self._row, i, j, k]
        return np.asarray(found)


def _place(position: np.ndarray, count: int) -> tuple[Int[np.ndarray, " plants"], np.ndarray]:
    """The entry of the table before a position counted in entries, and the share of the way to the next."""
    first = np.clip(np.floor(position).astype(int), 0, count - 2)
    return first, np.clip(position - first, 0.0, 1.0)
