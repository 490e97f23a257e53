"""Sensors: named scalars that are read off a state of a system.

A sensor is a class with `spec` and `read`; adding a kind means adding one.
"""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.robot import Robot
from exosight.system.schema import SensorSpec


class SurfaceForces(NamedTuple):
    """Contact forces on a surface.

    force   (forces, 3)   in the world [N]
    place   (forces,)     where each acts: a sphere's number, or the distance along a tube [m]
    """

    force: Float[AnyArray, "forces 3"]
    place: Float[AnyArray, " forces"]


class SensorInput(NamedTuple):
    """What sensors are computed from.

    robot
    q        (dofs,)                    coordinates
    forces                              on each surface, by its name
    values   ()                         of the sensors before, by name
    """

    robot: Robot
    q: Float[Array, " dofs"]
    forces: Mapping[str, SurfaceForces]
    values: Mapping[str, Float[Array, ""]]


class SphereZone(eqx.Module):
    """Some spheres of a surface.

    spheres   their numbers (static)
    """

    spheres: tuple[int, ...] = eqx.field(static=True)

    def weights(self, place: Float[AnyArray, " forces"]) -> Float[Array, " forces"]:
        """The share of each force that acts on the zone."""
        return jnp.isin(place, jnp.array(self.spheres, float)).astype(float)


class PlaceZone(eqx.Module):
    """A stretch of a tube: a force is shared by the zones whose middles are on either side of it.

    number    of the zone, counted along the tube (static)
    middles   (zones,)   of all zones of the tube: distances along it, ascending [m]
    """

    number: int = eqx.field(static=True)
    middles: Float[AnyArray, " zones"]

    @property
    def middle(self) -> Float[Array, ""]:
        """That of this zone [m]."""
        return jnp.asarray(self.middles)[self.number]

    def weights(self, place: Float[AnyArray, " forces"]) -> Float[Array, " forces"]:
        """The share of each force that acts on the zone; those of all zones sum to one."""
        middles = jnp.asarray(self.middles)
        return jnp.interp(place, middles, jnp.eye(len(middles))[self.number])


class ContactForce(eqx.Module):
    """Magnitude of the summed contact force on a zone [N].

    spec      name and unit (static)
    surface   name of the surface (static)
    zone      of that surface
    """

    spec: SensorSpec = eqx.field(static=True)
    surface: str = eqx.field(static=True)
    zone: SphereZone | PlaceZone

    def vector(self, at: SensorInput) -> Float[Array, "3"]:
        """The summed force itself, in the world [N]."""
        forces = at.forces[self.surface]
        return self.zone.weights(forces.place) @ forces.force

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
