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
from exosight.system.schema import Component, SensorSpec


class SurfaceForces(NamedTuple):
    """Contact forces on a surface.

    force    (forces, 3)   in the world [N]
    normal   (forces, 3)   the part of each along the normal of its contact [N]; the rest is tangential
    place    (forces,)     where each acts: a sphere's number, or the distance along a tube [m]
    """

    force: Float[AnyArray, "forces 3"]
    normal: Float[AnyArray, "forces 3"]
    place: Float[AnyArray, " forces"]

    def part(self, component: Component) -> Float[AnyArray, "forces 3"]:
        """The forces whole, or one of their parts [N]."""
        match component:
            case "magnitude":
                return self.force
            case "normal":
                return self.normal
            case "tangential":
                return self.force - self.normal


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
        middles, own = jnp.asarray(self.middles), self.number
        share = jnp.ones_like(jnp.asarray(place))
        for other in {max(own - 1, 0), min(own + 1, len(middles) - 1)} - {own}:
            share = jnp.minimum(share, (place - middles[other]) / (middles[own] - middles[other]))
        return jnp.maximum(share, 0.0)


class ContactForce(eqx.Module):
    """Magnitude of the summed contact force on a zone, or of its normal or tangential part [N].

    spec      name, unit and component (static)
    surface   name of the surface (static)
    zone      of that surface
    """

    spec: SensorSpec = eqx.field(static=True)
    surface: str = eqx.field(static=True)
    zone: SphereZone | PlaceZone

    def vector(self, at: SensorInput, component: Component) -> Float[Array, "3"]:
        """The summed force itself, or one of its parts, in the world [N]."""
        forces = at.forces[self.surface]
        return self.zone.weights(forces.place) @ forces.part(component)

    def read(self, at: SensorInput) -> Float[Array, ""]:
        """|Σ f|."""
        return _magnitude(self.vector(at, self.spec.component))


class ForcePerLength(eqx.Module):
    """Force per length of a tube at a place, or its normal or tangential part [N/m].

    It is the force on a zone over the zone's length, so the forces per length at all places, each times its
    length, sum to the force on the tube as vectors.

    spec      name, unit and component (static)
    surface   name of the tube (static)
    zone      of the tube, around the place
    length    ()   of the zone, see `zone_lengths` [m]
    """

    spec: SensorSpec = eqx.field(static=True)
    surface: str = eqx.field(static=True)
    zone: PlaceZone
    length: Float[AnyArray, ""]

    def read(self, at: SensorInput) -> Float[Array, ""]:
        """|Σ f| / length."""
        forces = at.forces[self.surface]
        return _magnitude(self.zone.weights(forces.place) @ forces.part(self.spec.component)) / self.length


class CentreOfPressure(eqx.Module):
    """Where along a tube, or a zone of it, the normal forces act in the mean: Σ p s / Σ p [m].

    Without contact it is the middle of the zone.

    spec      name and unit (static)
    surface   name of the tube (static)
    zone      of the tube; one with a single middle is all of it
    """

    spec: SensorSpec = eqx.field(static=True)
    surface: str = eqx.field(static=True)
    zone: PlaceZone

    def read(self, at: SensorInput) -> Float[Array, ""]:
        """Distance from the tube's beginning [m]."""
        forces = at.forces[self.surface]
        pressure = self.zone.weights(forces.place) * _magnitude(forces.normal)
        total = jnp.sum(pressure)
        pressed = total > 0
        return jnp.where(pressed, pressure @ forces.place / jnp.where(pressed, total, 1.0), self.zone.middle)


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


Sensor = ContactForce | NetForce | JointAngle | ForcePerLength | CentreOfPressure


def zone_lengths(middles: Float[AnyArray, " zones"], length: Float[AnyArray, ""]) -> Float[Array, " zones"]:
    """The length of tube that each zone stands for, the integral of its share over all of the tube [m].

    middles   of all zones, ascending, within the tube's length
    """
    middles = jnp.asarray(middles)
    between = (middles[1:] + middles[:-1]) / 2
    return jnp.diff(between, prepend=0.0, append=length)


def force_per_length(
    forces: Float[AnyArray, "forces 3"],
    at: Float[AnyArray, " forces"],
    places: Float[AnyArray, " places"],
    length: Float[AnyArray, ""],
) -> Float[Array, "places 3"]:
    """Force per length of a tube at some places, linear in between and constant beyond the last ones [N/m].

    Its integral along the tube is the sum of all forces. Places closer than the points of the rod that
    presses resolve these points.

    forces   in the world [N]
    at       distance along the tube where each acts [m]
    places   ascending, within the tube's length [m]
    length   of the tube [m]
    """
    shares = jnp.stack([PlaceZone(i, places).weights(at) for i in range(len(places))])
    return shares @ forces / zone_lengths(places, length)[:, None]


def _magnitude(vector: Float[AnyArray, "*batch 3"]) -> Float[Array, "*batch"]:
    """|x|; the root of 0 has no derivative, but a force that is none has: 0."""
    squared = jnp.sum(vector**2, axis=-1)
    some = squared > 0
    return jnp.where(some, jnp.sqrt(jnp.where(some, squared, 1.0)), 0.0)
