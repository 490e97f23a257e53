"""One exosuit under given loads: the answer to "what does it do at u = 2.4 N?"."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit, Pose, assemble, observe
from exosight.mechanics import Equilibria, drive, stack

MAX_LOAD = 50.0
"""Largest load that is simulated [N]: far beyond where an exosuit of silicone keeps its shape."""


@dataclass(frozen=True)
class Simulation:
    """Equilibria at the loads asked for, in their order."""

    u: Float[np.ndarray, " loads"]
    """Actuation [N]."""
    equilibria: Equilibria
    """Convergence, stability and coordinates, each of shape (loads, …)."""
    pose: Pose
    """Forces and shape, each of shape (loads, …)."""

    def records(self) -> list[dict[str, Any]]:
        """One dictionary of plain numbers a load: newtons, metres, radians."""
        found, pose = self.equilibria, self.pose
        return [
            {
                "u": float(self.u[i]),
                "converged": bool(found.converged[i]),
                "residual": float(found.residual[i]),
                "min_eigenvalue": float(found.min_eigenvalue[i]),
                "iterations": int(found.iterations[i]),
                "forces": np.asarray(pose.forces[i]).tolist(),
                "F_net": float(pose.net_force[i]),
                "joint_angles": np.asarray(pose.joint_angles[i]).tolist(),
                "rod_tip": [*np.asarray(pose.centreline[i, -1, ::2]).tolist(), float(pose.tip_angle[i])],
                "finger_tip": np.asarray(pose.finger[i, -1, ::2]).tolist(),
            }
            for i in range(len(self.u))
        ]


def simulate(exosuit: Exosuit, loads: Sequence[float]) -> Simulation:
    """The equilibria of an exosuit at each load [N], approached from rest.

    Every load is approached from 0 N without turning back, so the answer for one load does not depend on
    which others are asked for. Loads may be negative (the line pulls) and in any order.

    Raises InputError for a load that is not a finite number within ±50 N, or no load at all.
    """
    u = np.asarray(loads, dtype=float)
    if u.ndim != 1 or not len(u):
        raise InputError("u: expected at least one load in newtons, got none")
    wrong = u[~(np.abs(u) <= MAX_LOAD)]  # NaN is caught here too
    if wrong.size:
        raise InputError(f"u: expected finite loads within ±{MAX_LOAD:g} N, got {wrong[0]:g}")
    robot = assemble(exosuit)
    rising, falling = np.unique(u[u >= 0]), np.unique(u[u < 0])[::-1]
    parts = [drive([robot], side[:, None]) for side in (rising, falling) if side.size]
    found = jax.tree.map(lambda *leaves: np.concatenate([leaf[0] for leaf in leaves]), *parts)
    order = np.concatenate([rising, falling])
    where = [int(np.flatnonzero(order == load)[0]) for load in u]
    found = jax.tree.map(lambda leaf: leaf[where], found)
    # One pose a call: the same compiled code whatever the number of loads.
    poses = [observe(stack([robot]), found.q[None, i : i + 1]) for i in range(len(u))]
    return Simulation(
        u=u,
        equilibria=found,
        pose=jax.tree.map(lambda *leaves: np.stack([leaf[0, 0] for leaf in leaves]), *poses),
    )
