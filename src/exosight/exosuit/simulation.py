"""One exosuit under given loads: the answer to "what does it do at u = 2.4 N?"."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.exosuit.assembly import MAX_FORCE, Exosuit, Pose, assemble, observe
from exosight.mechanics import Equilibria, follow, stack

PATH_STEP = 0.05
"""Loads are approached from rest over every multiple of this [N]."""

MAX_LOAD = 50.0
"""Largest load that is simulated [N]: far beyond where an exosuit of silicone keeps its shape."""

_SAME_LOAD = 1e-10  # [N]; a multiple of PATH_STEP as typed and as computed differ by 1e-14


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

    Every load is reached over 0, ±0.05, ±0.10 … N and then, if it is none of these, in one last step, so the
    answer for one load does not depend on which others are asked for. Loads may be negative (the line pulls)
    and in any order.

    Raises InputError for a load that is not a finite number within ±50 N, or no load at all.
    """
    u = np.asarray(loads, dtype=float)
    if u.ndim != 1 or not len(u):
        raise InputError("u: expected at least one load in newtons, got none")
    wrong = u[~(np.abs(u) <= MAX_LOAD)]  # NaN is caught here too
    if wrong.size:
        raise InputError(f"u: expected finite loads within ±{MAX_LOAD:g} N, got {wrong[0]:g}")
    path, parents, where = _path(u)
    robot = assemble(exosuit)
    found = follow([robot], path[:, None], parents=parents)
    # One pose a call: the same compiled code whatever the number of loads.
    poses = [observe(stack([robot]), found.q[:, i : i + 1]) for i in where]
    return Simulation(
        u=u,
        equilibria=jax.tree.map(lambda leaf: leaf[0, where], found),
        pose=jax.tree.map(lambda *leaves: np.stack([leaf[0, 0] for leaf in leaves]), *poses),
    )


def _path(u: Float[np.ndarray, " loads"]) -> tuple[np.ndarray, list[int], list[int]]:
    """All loads to solve, from which earlier one each starts, and where those asked for are.

    The path goes up to 4 N at least, so that nearly all calls share one compiled size. Every part of it
    begins with a rest at 0 N: the solver's first step from a load depends on whether that load was the last
    one solved, and thus must not depend on which others are asked for.
    """
    path: list[float] = []
    parents: list[int] = []

    def solve(load: float, parent: int) -> int:
        path.append(load)
        parents.append(parent)
        return len(path) - 1

    grid = {0: solve(0.0, -1)}  # multiple of PATH_STEP → place on the path
    for sign, furthest in ((1, max(u.max(), MAX_FORCE)), (-1, -u.min())):
        for k in range(1, _whole_steps(furthest) + 1):
            grid[sign * k] = solve(sign * k * PATH_STEP, grid[sign * (k - 1)])
        solve(0.0, -1)
    where = []
    for load in u.tolist():
        before = int(np.sign(load)) * _whole_steps(abs(load))
        on_grid = abs(load - before * PATH_STEP) < _SAME_LOAD
        where.append(grid[before] if on_grid else solve(load, grid[before]))
    return np.array(path), parents, where


def _whole_steps(load: float) -> int:
    return int(np.floor((load + _SAME_LOAD) / PATH_STEP))
