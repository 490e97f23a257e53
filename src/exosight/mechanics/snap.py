"""Where a path snaps: the load at which a pose loses its stability, and the poses on both sides of it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.mechanics.equilibrium import Equilibria, SolverOptions, follow
from exosight.mechanics.robot import Robot

DEFAULT = SolverOptions()


class Snap(NamedTuple):
    """One jump of a robot on its path.

    step      index of the first load beyond it
    below     (channels,)   largest load found without it [N]
    above     (channels,)   smallest load found with it [N]
    before    (dofs,)       the pose at `below`
    after     (dofs,)       the pose at `above`
    energy    what the jump sets free: Π of the pose left − Π of the pose reached, at about the same load [J]
    """

    step: int
    below: Float[np.ndarray, " channels"]
    above: Float[np.ndarray, " channels"]
    before: Float[np.ndarray, " dofs"]
    after: Float[np.ndarray, " dofs"]
    energy: float


def locate_snaps(
    robot: Robot,
    loads: Float[np.ndarray, "loads channels"],
    found: Equilibria,
    *,
    tolerance: float = 1e-4,
    options: SolverOptions = DEFAULT,
) -> list[Snap]:
    """Every snap on a path that `follow` solved, its load narrowed down by bisection.

    loads      (loads, channels)   as given to `follow`, each starting from the one before [N]
    found      of one robot, with shape (loads,)
    tolerance  how far apart the loads on both sides may stay, as a share of the step between two loads

    Raises InputError for equilibria that are not those of the loads.
    """
    loads = np.asarray(loads, dtype=float)
    if found.snapped.shape != loads.shape[:1]:
        raise InputError(
            f"locate_snaps: expected the equilibria of one robot at {len(loads)} loads, "
            f"got shape {found.snapped.shape}; give one robot's, e.g. jax.tree.map(lambda x: x[0], found)"
        )
    if not 0 < tolerance < 1:
        raise InputError(f"locate_snaps, tolerance: expected a share between 0 and 1, got {tolerance}")
    snaps = []
    for step in np.flatnonzero(found.snapped).tolist():
        low, high = loads[step - 1], loads[step]
        before, after = np.asarray(found.q[step - 1]), np.asarray(found.q[step])
        left, right = float(found.energy[step - 1]), float(found.energy[step])
        narrow = tolerance * np.linalg.norm(high - low)
        while np.linalg.norm(high - low) > narrow:
            middle = 0.5 * (low + high)
            # The first load is where it stands already; the second tells whether the way there is smooth.
            here = follow([robot], np.stack([low, middle]), q=before[None], options=options)
            if not here.converged[0, 1]:
                break
            if here.snapped[0, 1]:
                high, after, right = middle, np.asarray(here.q[0, 1]), float(here.energy[0, 1])
            else:
                low, before, left = middle, np.asarray(here.q[0, 1]), float(here.energy[0, 1])
        snaps.append(Snap(step, low, high, before, after, left - right))
    return snaps
