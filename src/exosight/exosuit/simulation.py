"""One exosuit under given loads: the answer to "what does it do at u = 2.4 N?"."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.errors import InputError
from exosight.exosuit.assembly import ROD, Exosuit
from exosight.exosuit.published import published
from exosight.mechanics import Equilibria, Robot, Rod, drive, walk
from exosight.system.observation import Observation, observe
from exosight.system.schema import Schema
from exosight.system.system import System, stack_systems

MAX_LOAD = 50.0
"""Largest load that is simulated [N]: far beyond where an exosuit of silicone keeps its shape."""


@dataclass(frozen=True)
class Simulation:
    """Equilibria at the loads asked for, in their order."""

    u: Float[np.ndarray, " loads"]
    """Actuation [N]."""
    equilibria: Equilibria
    """Convergence, stability and coordinates, each of shape (loads, …)."""
    observation: Observation
    """Readings and positions, each of shape (loads, …)."""
    tip_angle: Float[np.ndarray, " loads"]
    """Inclination of the exosuit's tip in the x–z plane [rad]: negative downwards, full turns counted."""
    system: System

    @property
    def schema(self) -> Schema:
        """Names and units of its channels and sensors."""
        return self.system.schema

    def reading(self, *sensors: str) -> Float[np.ndarray, "loads ..."]:
        """Readings of one sensor, such as F_net, or of several, a column each [their units]."""
        columns = [self.schema.index(sensor) for sensor in sensors]
        return np.asarray(self.observation.readings)[:, columns[0] if len(columns) == 1 else columns]

    def records(self) -> list[dict[str, Any]]:
        """One dictionary of plain numbers a load: newtons, metres, radians."""
        found, axes = self.equilibria, self.observation.axes
        forces, angles = (
            [sensor.name for sensor in self.schema.sensors if sensor.quantity == quantity]
            for quantity in ("contact force", "joint angle")
        )
        return [
            {
                "u": float(self.u[i]),
                "converged": bool(found.converged[i]),
                "residual": float(found.residual[i]),
                "min_eigenvalue": float(found.min_eigenvalue[i]),
                "iterations": int(found.iterations[i]),
                "forces": self.reading(*forces)[i].tolist(),
                "F_net": float(self.reading("F_net")[i]),
                "joint_angles": self.reading(*angles)[i].tolist(),
                "rod_tip": [*axes["exosuit"][i, -1, ::2].tolist(), float(self.tip_angle[i])],
                "finger_tip": axes["finger"][i, -1, ::2].tolist(),
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
    system = published(exosuit)
    rising, falling = np.unique(u[u >= 0]), np.unique(u[u < 0])[::-1]
    parts = [drive([system.robot], side[:, None]) for side in (rising, falling) if side.size]
    found = jax.tree.map(lambda *leaves: np.concatenate([leaf[0] for leaf in leaves]), *parts)
    order = np.concatenate([rising, falling])
    where = [int(np.flatnonzero(order == load)[0]) for load in u]
    found = jax.tree.map(lambda leaf: leaf[where], found)
    # One pose a call: the same compiled code whatever the number of loads.
    stacked = stack_systems([system])
    seen = [observe(stacked, found.q[None, i : i + 1]) for i in range(len(u))]
    return Simulation(
        u=u,
        equilibria=found,
        observation=jax.tree.map(lambda *leaves: np.stack([leaf[0, 0] for leaf in leaves]), *seen),
        tip_angle=np.array([_tip_angle(system.robot, jnp.asarray(q)) for q in found.q]),
        system=system,
    )


@jax.jit
def _tip_angle(robot: Robot, q: Float[Array, " dofs"]) -> Float[Array, ""]:
    rod = robot[ROD]
    assert isinstance(rod, Rod)
    (steps,) = walk(robot, q)[ROD].steps
    return jnp.arctan2(rod.mount[2, 0], rod.mount[0, 0]) - steps.curvature.twist[:, 1].sum()
