"""The plant as a controller sees it: something to actuate and to look at."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

ACTUATION_LIMIT = 6.0
"""Largest |u| that controllers ask for and plants take by default [N]; not printed in the paper."""


@dataclass(frozen=True)
class Observation:
    """The worn exosuit at rest under one actuation; a real plant answers NaN for what it cannot know.

    u               actuation of this very pose [N]: the one asked for, unless `converged` is False
    image           (height, width)   what the camera sees, gray 0…255
    forces          (8,)              true contact force on C0…C7 [N]
    q               (dofs,)           coordinates of the pose (radians, dimensionless strains)
    converged       False: no stable pose was found on the way to the actuation that was asked for, and this
                    is the last one before
    min_eigenvalue  how stable the pose is [-]: 1 for the unloaded exosuit, 0 where it snaps
    """

    u: float
    image: UInt8[np.ndarray, "height width"]
    forces: Float[np.ndarray, "8"]
    q: Float[np.ndarray, " dofs"]
    converged: bool
    min_eigenvalue: float

    @property
    def net_force(self) -> float:
        """F_net: the sum over C1…C7 [N]."""
        return float(self.forces[1:].sum())


@runtime_checkable
class Plant(Protocol):
    """A finger in an exosuit that can be actuated."""

    def reset(self) -> Observation:
        """Return to u = 0 from the unstrained pose, forgetting the path so far."""
        ...

    def apply(self, u: float) -> Observation:
        """Change the actuation to u [N] and come to rest.

        Raises InputError if u is not a number within the plant's limits.
        """
        ...
