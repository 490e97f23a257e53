"""The plant as a controller has it: commands in, observations out."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from exosight.system.schema import Schema


@dataclass(frozen=True)
class Observation:
    """A plant at rest under one command of each channel; a real plant gives NaN for what it does not measure.

    schema          names and units of channels and sensors
    commands        (channels,)       of this very pose [each in its channel's unit]: the ones asked for,
                    unless actuators answer late or `converged` is False
    image           (height, width)   what the camera sees, gray 0…255
    readings        (sensors,)        true readings of all sensors, in the order of the schema [each in its
                    unit]
    q               (dofs,)           coordinates of the pose (radians, dimensionless strains)
    converged       False: no stable pose was found on the way to the commands that were asked for, and this
                    is the last one before
    min_eigenvalue  how stable the pose is [-]: 1 for the unloaded plant, 0 where it snaps
    history         of a simulated plant with friction or rods that relax, see `exosight.mechanics.Equilibria`
    """

    schema: Schema
    commands: Float[np.ndarray, " channels"]
    image: UInt8[np.ndarray, "height width"]
    readings: Float[np.ndarray, " sensors"]
    q: Float[np.ndarray, " dofs"]
    converged: bool
    min_eigenvalue: float
    history: tuple[Float[np.ndarray, "..."], ...] = ()

    def reading(self, sensor: str) -> float:
        """What one sensor reads [its unit]; InputError if there is none of this name."""
        return float(self.readings[self.schema.index(sensor)])

    @property
    def outputs(self) -> Float[np.ndarray, " outputs"]:
        """What the estimated sensors read, in the order of a network's outputs [each in its unit]."""
        return self.readings[self.schema.output_indices()]


@runtime_checkable
class Plant(Protocol):
    """A system that is actuated and observed."""

    @property
    def schema(self) -> Schema:
        """Its channels, sensors and cameras."""
        ...

    def reset(self) -> Observation:
        """Return to commands of 0 from the unstrained pose, forgetting the path so far."""
        ...

    def apply(self, commands: Float[np.ndarray, " channels"]) -> Observation:
        """Change the command of every channel [its unit] and come to rest.

        Raises InputError for commands that are no numbers within the channels' ranges.
        """
        ...
