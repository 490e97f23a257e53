"""Sensors: named scalars that are read off a state of a system.

A sensor is a class with `spec` and `read`; adding a kind means adding one.
"""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.mechanics.robot import Robot
from exosight.system.schema import SensorSpec


class SensorInput(NamedTuple):
    """What sensors are computed from.

    robot
    q        (dofs,)                    coordinates
    forces   (spheres, 3) a surface     contact force on each of its spheres, by the surface's name [N]
    values   ()                         of the sensors before, by name
    """

    robot: Robot
    q: Float[Array, " dofs"]
    forces: Mapping[str, Float[Array, "spheres 3"]]
    values: Mapping[str, Float[Array, ""]]


class ContactForce(eqx.Module):
    """Magnitude of the summed contact force on a zone: some spheres of a surface [N].

    spec      name and unit (static)
    surface   name of the surface (static)
    spheres   numbers of the spheres that are the zone (static)
    """

    spec: SensorSpec = eqx.field(static=True)
    surface: str = eqx.field(static=True)
    spheres: tuple[int, ...] = eqx.field(static=True)

    def vector(self, at: SensorInput) -> Float[Array, "3"]:
        """The summed force itself, in the world [N]."""
        return at.forces[self.surface][jnp.array(self.spheres)].sum(axis=0)

    def read(self, at: SensorInput) -> Float[Array, ""]:
        """|Σ f|; the root of 0 has no derivative, but a zone that nothing touches has: 0."""
        squared = jnp.sum(self.vector(at) ** 2)
        pressed = squared > 0
        return jnp.where(pressed, jnp.sqrt(jnp.where(pressed, squared, 1.0)), 0.0)


class NetForce(eqx.Module):
    """The sum of other sensors, those that its spec names [N]."""

    spec: SensorSpec = eqx.field(static=True)

    def read(self, at: SensorInput) -> Float[Array, ""]:
        """Σ of the parts."""
        return jnp.stack([at.values[part] for part in self.spec.parts]).sum()


class JointAngle(eqx.Module):
    """A coordinate of a body's joint [rad].

    spec         name and unit (static)
    body         behind the joint (static)
    coordinate   which of the joint's (static)
    """

    spec: SensorSpec = eqx.field(static=True)
    body: str = eqx.field(static=True)
    coordinate: int = eqx.field(static=True, default=0)

    def read(self, at: SensorInput) -> Float[Array, ""]:
        """q of the joint."""
        return at.q[at.robot.dof_slice(self.body).start + self.coordinate]


Sensor = ContactForce | NetForce | JointAngle
