"""A system: bodies, surfaces, contacts, actuators, sensors and cameras, all named, all plural."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.contact import SphereContact
from exosight.mechanics.contact_damping import ContactDamping
from exosight.mechanics.friction import friction
from exosight.mechanics.relaxation import Relaxation
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.robot import Robot
from exosight.mechanics.surface_contact import SolidContact
from exosight.mechanics.surfaces import Plane, Solids, Tube
from exosight.mechanics.term import Memories, Term
from exosight.mechanics.tree import Body, Tree
from exosight.mechanics.tube_contact import TubeContact
from exosight.system.camera import Camera, Visibility
from exosight.system.contact_checks import ContactTerm, check_contacts
from exosight.system.schema import Channel, Schema, ViewSpec
from exosight.system.sensors import (
    CentreOfPressure,
    ContactForce,
    ForcePerLength,
    JointAngle,
    PlaceZone,
    Sensor,
    SphereZone,
)
from exosight.system.surfaces import PlaneSurface, SphereSurface, Surface, TubeSurface
from exosight.validation import check_name, check_unique

Part = TypeVar("Part", bound=eqx.Module)


class Contact(eqx.Module):
    """Two surfaces that press on each other: two sets of spheres, or tubes and at most one plane.

    A rod's tube is the first one, a plane the second.

    name            of the contact (static)
    first, second   names of the surfaces; the same for a rod that presses on itself (static)
    stiffness       ()   of a length of a rod's tube [N/m²], else of a pair of spheres or links [N/m]
    friction        ()   Coulomb's coefficient μ [-]; None: frictionless
    damping         ()   Hunt and Crossley's coefficient, in motions with inertia [s/m]; None: undamped
    """

    name: str = eqx.field(static=True)
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    stiffness: Float[AnyArray, ""]
    friction: Float[AnyArray, ""] | None = None
    damping: Float[AnyArray, ""] | None = None


def _contact_term(contact: Contact, surfaces: Mapping[str, Surface], tree: Tree) -> ContactTerm:
    """The energy of a contact; InputError for surfaces that cannot press on each other."""
    first, second = surfaces[contact.first], surfaces[contact.second]
    if isinstance(first, SphereSurface) and isinstance(second, SphereSurface):
        return SphereContact(first.spheres, second.spheres, contact.stiffness)
    if not isinstance(first, SphereSurface) and not isinstance(second, SphereSurface):
        match first.contact_side(tree), second.contact_side(tree):
            case Tube() as tube, (Solids() | Plane()) as other:
                return SolidContact(tube, other, contact.stiffness)
            case Tube() as tube, Tube() as other:
                return TubeContact(tube, other, contact.stiffness)
            case Solids() as solids, (Solids() | Plane()) as other:
                return RigidContact(solids, other, contact.stiffness)
    raise InputError(
        f"contact {contact.name}: expected two surfaces of spheres, or two tubes, or a tube and a plane, a "
        f"rod's tube first, got {contact.first} and {contact.second}"
    )


def _check_zone(sensor: ContactForce | ForcePerLength | CentreOfPressure, surface: Surface) -> None:
    """InputError for a zone that is not on its surface."""
    match sensor.zone, surface:
        case SphereZone(spheres), SphereSurface():
            count = len(surface.spheres.frames)
            if not spheres or not all(0 <= i < count for i in spheres):
                raise InputError(
                    f"sensor {sensor.spec.name}: expected spheres 0…{count - 1} of {surface.name}, got "
                    f"{spheres}"
                )
        case PlaceZone(), TubeSurface():
            return
        case PlaceZone(), PlaneSurface() if isinstance(sensor, ContactForce):
            return
        case _:
            raise InputError(
                f"sensor {sensor.spec.name}: expected spheres of a surface of spheres, or a place along a "
                f"tube; {surface.name} is neither"
            )


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
    surfaces    geometry of the bodies
    contacts    pairs of surfaces
    actuators   one a load channel, in the order of the channels
    sensors     in the order in which they are read
    cameras     names and cameras (static)
    energies    further terms, such as weight
    relaxations of rods, on the channel after those of the actuators; they act where times are given
    visibility  which of several tubes cameras show, see `exosight.system.camera.Visibility` (static)

    Raises InputError for a name that is used twice, or one that names nothing, and for contacts of surfaces
    that are none or overlap at rest, or of a stiffness that steps cannot resolve.
    """

    name: str = eqx.field(static=True)
    bodies: tuple[Body, ...]
    surfaces: tuple[Surface, ...]
    contacts: tuple[Contact, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[Sensor, ...]
    cameras: tuple[tuple[str, Camera], ...] = eqx.field(static=True)
    energies: tuple[Term, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()
    visibility: Visibility = eqx.field(static=True, default="depth")

    def __check_init__(self) -> None:
        bodies = [body.name for body in self.bodies]
        surfaces = {surface.name: surface for surface in self.surfaces}
        check_unique("surfaces", (surface.name for surface in self.surfaces))
        check_unique("contacts", (contact.name for contact in self.contacts))
        terms, tree = {}, Tree(self.bodies)
        for contact in self.contacts:
            for side in (contact.first, contact.second):
                check_name(f"surface of contact {contact.name}", side, surfaces)
            terms[f"contacts.{contact.name}"] = _contact_term(contact, surfaces, tree)
        check_contacts(terms, tree)
        for sensor in self.sensors:
            if isinstance(sensor, ContactForce | ForcePerLength | CentreOfPressure):
                check_name(f"surface of sensor {sensor.spec.name}", sensor.surface, surfaces)
                _check_zone(sensor, surfaces[sensor.surface])
            if isinstance(sensor, JointAngle):
                check_name(f"body of sensor {sensor.spec.name}", sensor.body, bodies)

    @property
    def robot(self) -> Robot:
        """The bodies with all their energies, as mechanics solves them; a load a channel."""
        actuators = (actuator.term for actuator in self.actuators)
        contacts = self.contact_terms
        tree = Tree(self.bodies)
        frictions = (
            friction(term, contact.friction, tree)
            for contact, term in zip(self.contacts, contacts, strict=True)
            if contact.friction is not None
        )
        return Robot(self.bodies, (*actuators, *contacts, *frictions, *self.energies))

    @property
    def robot_in_time(self) -> Robot:
        """The same with relaxing rods and damped contacts; its last load, after those of the channels, is
        the time [s].

        Without it loads change infinitely slowly, so that of the modulus nothing is left that relaxes, and
        nothing is damped.
        """
        dampings = (
            ContactDamping(term, contact.damping)
            for contact, term in zip(self.contacts, self.contact_terms, strict=True)
            if contact.damping is not None
        )
        return Robot(self.bodies, (*self.robot.terms, *self.relaxations, *dampings))

    def robot_at(self, history: Memories) -> Robot:
        """The robot with the memories of a state, in time or not; InputError for other memories."""
        in_time = len(history) > len(self.robot.memories)
        return (self.robot_in_time if in_time else self.robot).with_memories(history)

    @property
    def contact_terms(self) -> tuple[ContactTerm, ...]:
        """The energy of each contact."""
        surfaces, tree = {surface.name: surface for surface in self.surfaces}, Tree(self.bodies)
        return tuple(_contact_term(contact, surfaces, tree) for contact in self.contacts)

    @property
    def schema(self) -> Schema:
        """Names, units and ranges of channels and sensors; names, sizes and visibility of cameras."""
        return Schema(
            self.name,
            tuple(actuator.channel for actuator in self.actuators),
            tuple(sensor.spec for sensor in self.sensors),
            tuple(
                ViewSpec(name, camera.width, camera.height, self.visibility) for name, camera in self.cameras
            ),
        )

    @property
    def zones(self) -> tuple[ContactForce, ...]:
        """The zones whose contact forces are read: of each the first sensor, in the order of the sensors."""
        found: dict[tuple[str, int | tuple[int, ...]], ContactForce] = {}
        for sensor in self.sensors:
            if isinstance(sensor, ContactForce):
                zone = sensor.zone
                place = zone.number if isinstance(zone, PlaceZone) else zone.spheres
                found.setdefault((sensor.surface, place), sensor)
        return tuple(found.values())

    @property
    def tubes(self) -> tuple[TubeSurface, ...]:
        """The surfaces that a camera sees, in the order in which they are named."""
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
