"""A system: bodies, surfaces, contacts, actuators, sensors and cameras, all named, all plural."""

from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.contact import SphereContact
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Term
from exosight.mechanics.tree import Body
from exosight.system.camera import Camera
from exosight.system.schema import Channel, Schema, ViewSpec
from exosight.system.sensors import ContactForce, JointAngle, Sensor
from exosight.system.surfaces import SphereSurface, Surface, TubeSurface
from exosight.validation import check_name, check_unique

Part = TypeVar("Part", bound=eqx.Module)


class Contact(eqx.Module):
    """Two surfaces that press on each other.

    name            of the contact (static)
    first, second   names of two sphere surfaces (static)
    stiffness       ()   of a pair of spheres [N/m]
    """

    name: str = eqx.field(static=True)
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    stiffness: Float[AnyArray, ""]


class Actuator(eqx.Module):
    """A channel, and the energy that its command acts by.

    channel   name, unit, range, rate of the command (static)
    term      an energy linear in one load, that of this channel's place among all
    gain      ()   load of the term a unit of the command [N or N m per unit]
    """

    channel: Channel = eqx.field(static=True)
    term: Term
    gain: Float[AnyArray, ""]


class System(eqx.Module):
    """What is simulated, actuated, sensed and seen.

    It is a JAX pytree, as robots are: numbers can be batched, traced and differentiated; names, kinds and
    counts are fixed, and select the compiled code.

    name        (static)
    bodies      rods and links in a tree, parents first
    surfaces    geometry of the bodies; tubes are drawn in this order, later ones over earlier ones
    contacts    pairs of surfaces
    actuators   one a load channel, in the order of the channels
    sensors     in the order in which they are read
    cameras     names and cameras (static)
    energies    further terms, such as weight

    Raises InputError for a name that is used twice, or one that names nothing.
    """

    name: str = eqx.field(static=True)
    bodies: tuple[Body, ...]
    surfaces: tuple[Surface, ...]
    contacts: tuple[Contact, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[Sensor, ...]
    cameras: tuple[tuple[str, Camera], ...] = eqx.field(static=True)
    energies: tuple[Term, ...] = ()

    def __check_init__(self) -> None:
        bodies = [body.name for body in self.bodies]
        surfaces = {surface.name: surface for surface in self.surfaces}
        spheres = [name for name, surface in surfaces.items() if isinstance(surface, SphereSurface)]
        check_unique("surfaces", (surface.name for surface in self.surfaces))
        check_unique("contacts", (contact.name for contact in self.contacts))
        for contact in self.contacts:
            for side in (contact.first, contact.second):
                check_name(f"sphere surface of contact {contact.name}", side, spheres)
        for sensor in self.sensors:
            if isinstance(sensor, ContactForce):
                check_name(f"sphere surface of sensor {sensor.spec.name}", sensor.surface, spheres)
                surface = surfaces[sensor.surface]
                count = len(surface.spheres.frames) if isinstance(surface, SphereSurface) else 0
                if not sensor.spheres or not all(0 <= i < count for i in sensor.spheres):
                    raise InputError(
                        f"sensor {sensor.spec.name}: expected spheres 0…{count - 1} of {sensor.surface}, got "
                        f"{sensor.spheres}"
                    )
            if isinstance(sensor, JointAngle):
                check_name(f"body of sensor {sensor.spec.name}", sensor.body, bodies)

    @property
    def robot(self) -> Robot:
        """The bodies with all their energies, as mechanics solves them; a load a channel."""
        return Robot(self.bodies, (*(a.term for a in self.actuators), *self.contact_terms, *self.energies))

    @property
    def contact_terms(self) -> tuple[SphereContact, ...]:
        """The energy of each contact."""
        spheres = {s.name: s.spheres for s in self.surfaces if isinstance(s, SphereSurface)}
        return tuple(SphereContact(spheres[c.first], spheres[c.second], c.stiffness) for c in self.contacts)

    @property
    def schema(self) -> Schema:
        """Names, units and ranges of channels and sensors; names and sizes of cameras."""
        return Schema(
            self.name,
            tuple(actuator.channel for actuator in self.actuators),
            tuple(sensor.spec for sensor in self.sensors),
            tuple(ViewSpec(name, camera.width, camera.height) for name, camera in self.cameras),
        )

    @property
    def tubes(self) -> tuple[TubeSurface, ...]:
        """The surfaces that a camera sees, in the order in which they are drawn."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, TubeSurface))

    @property
    def camera(self) -> Camera:
        """The first camera."""
        return self.cameras[0][1]

    def loads(self, commands: Float[np.ndarray, "*batch channels"]) -> Float[np.ndarray, "*batch channels"]:
        """Loads of the robot [N or N m] at commands in the channels' units."""
        return np.asarray(commands, float) * self._gains

    def commands(self, loads: Float[np.ndarray, "*batch channels"]) -> Float[np.ndarray, "*batch channels"]:
        """Commands in the channels' units at loads of the robot [N or N m]."""
        return np.asarray(loads, float) / self._gains

    @property
    def _gains(self) -> Float[np.ndarray, " channels"]:
        return np.array([float(actuator.gain) for actuator in self.actuators])


def stack_systems(systems: Sequence[Part]) -> Part:
    """Systems (or robots) of one structure as a single batched one: every number gains a leading axis.

    Raises InputError for none, or for several structures.
    """
    if len({jax.tree.structure(system) for system in systems}) != 1:
        raise InputError("systems: expected at least one, all of one structure (parts, names, counts)")
    return jax.tree.map(lambda *leaves: np.stack(leaves), *systems)
