"""From a description to a system: bodies, surfaces, contacts, actuators, sensors and cameras."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from exosight.arrays import floats
from exosight.errors import InputError
from exosight.mechanics import Gravity
from exosight.mechanics.surface_contact import line_stiffness
from exosight.system.build_actuators import build_actuators
from exosight.system.build_bodies import build_bodies, check_joint, rod_points
from exosight.system.build_surfaces import build_surfaces
from exosight.system.camera import Camera
from exosight.system.description import JOINT_COORDINATES, Description, SensorTable
from exosight.system.faults import at_place
from exosight.system.schema import SensorSpec
from exosight.system.sensors import (
    CentreOfPressure,
    ContactForce,
    ForcePerLength,
    JointAngle,
    NetForce,
    PlaceZone,
    Sensor,
    SphereZone,
)
from exosight.system.surfaces import SphereSurface, Surface, TubeSurface
from exosight.system.system import Contact, System
from exosight.validation import check_name

LARGEST = {"coordinates": 500, "points and spheres": 5000, "pairs that could touch": 100_000}
"""What a system may have at most; one of these sizes takes seconds a load."""


def build(description: Description) -> System:
    """The system that a description describes.

    Raises InputError, beginning with the place in the file, for entries that contradict each other, and for
    a system that is too large to be solved.
    """
    _check_size(description)
    bodies = build_bodies(description)
    surfaces = build_surfaces(description)
    named = {surface.name: surface for surface in surfaces}
    contacts = tuple(_contact(description, name, named) for name in description.contacts)
    weight = () if description.gravity is None else (Gravity(jnp.array(description.gravity)),)
    system = System(
        name=description.name,
        bodies=bodies,
        surfaces=surfaces,
        contacts=contacts,
        actuators=build_actuators(description),
        sensors=tuple(
            sensor
            for name, table in description.sensors.items()
            for sensor in at_place(f"sensors.{name}", _sensors, description, name, table, named)
        ),
        cameras=tuple(
            (name, Camera(table.centre, table.pixel, table.width, table.height))
            for name, table in description.cameras.items()
        ),
        energies=weight,
    )
    _check_use(system)
    return system


def _contact(description: Description, name: str, surfaces: Mapping[str, Surface]) -> Contact:
    table = description.contacts[name]
    for side, surface in (("first", table.first), ("second", table.second)):
        check_name(f"contacts.{name}.{side}", surface, surfaces)
    first, second = surfaces[table.first], surfaces[table.second]
    both = set(first.bodies) & set(second.bodies)
    if isinstance(first, SphereSurface) and isinstance(second, SphereSurface):
        if both:
            raise InputError(
                f"contacts.{name}: both surfaces are on {min(both)}; spheres of a body cannot press on it"
            )
        if table.stiffness is None or table.line_stiffness is not None:
            raise InputError(f"contacts.{name}: expected stiffness, not line_stiffness, between spheres")
        return Contact(name, table.first, table.second, floats(table.stiffness))
    if table.stiffness is not None:
        raise InputError(f"contacts.{name}: expected line_stiffness, not stiffness, between tubes")
    if first.bodies[0] not in description.rods:
        first, second = second, first
    if both and (first.name != second.name or first.bodies[0] not in description.rods):
        raise InputError(f"contacts.{name}: both surfaces are on {min(both)}, which is no rod on its own")
    rods = [
        description.rods[surface.bodies[0]]
        for surface in (first, second)
        if surface.bodies[0] in description.rods
    ]
    soft = [line_stiffness(rod.young, rod.poisson) for rod in rods]
    stiffness = table.line_stiffness or 1 / sum(1 / each for each in soft) if soft else 0.0
    return Contact(name, first.name, second.name, floats(stiffness))


def _sensors(
    description: Description, name: str, table: SensorTable, surfaces: Mapping[str, Surface]
) -> tuple[Sensor, ...]:
    """The sensor of a table, or the row of them along a tube."""
    if table.type == "joint_angle":
        body = table.body or ""
        check_joint(description, body, table.coordinate)
        spec = SensorSpec(name, "joint angle", "rad", estimated=table.estimated)
        return (JointAngle(spec, body, table.coordinate),)
    if table.type == "net_force":
        return (NetForce(SensorSpec(name, "net force", "N", parts=table.parts or (), limit=table.limit)),)
    surface = table.surface or ""
    check_name("surface", surface, surfaces)
    pressed = {side for each in description.contacts.values() for side in (each.first, each.second)}
    if surface not in pressed:
        raise InputError(f"surface: nothing presses on {surface}; name it in a contact")
    found, component = surfaces[surface], table.component
    if table.type == "contact_force":
        force = SensorSpec(name, "contact force", "N", table.estimated, (), table.limit, component)
        if isinstance(found, SphereSurface):
            return (ContactForce(force, surface, SphereZone(_zone(table, surface, found))),)
        return (ContactForce(force, surface, _place(description, name, table, found)),)
    if not isinstance(found, TubeSurface):
        raise InputError(f"surface: expected a tube for type {table.type}, got {surface}")
    length = _length(description, found)
    if table.type == "centre_of_pressure":
        whole = PlaceZone(0, floats([length / 2]))
        zone = whole if table.at is None else _place(description, name, table, found)
        return (CentreOfPressure(SensorSpec(name, "centre of pressure", "m"), surface, zone),)
    places = table.places or 0
    middles, zone_length = floats((np.arange(places) + 0.5) * length / places), floats(length / places)
    return tuple(
        ForcePerLength(
            SensorSpec(f"{name}_{i}", "force per length", "N/m", component=component),
            *(surface, PlaceZone(i, middles), zone_length),
        )
        for i in range(places)
    )


def _length(description: Description, tube: TubeSurface) -> float:
    return sum((description.rods.get(body) or description.links[body]).length for body in tube.bodies)


def _place(description: Description, name: str, table: SensorTable, surface: TubeSurface) -> PlaceZone:
    """The zone among all of a tube."""
    if table.at is None:
        raise InputError(
            f"at: expected a distance along {surface.name}, which is a tube, got spheres or a body"
        )
    length = _length(description, surface)
    if table.at > length:
        raise InputError(
            f"at: expected at most {length:g} m, the length of {surface.name}, got {table.at:g} m"
        )
    zones = {
        other: each
        for other, each in description.sensors.items()
        if each.surface == surface.name and each.at is not None
    }
    for other, each in zones.items():
        read = (each.type, each.component, each.at)
        if other != name and read == (table.type, table.component, table.at):
            raise InputError(f"at: expected another place than that of {other}, got {table.at:g} m for both")
    middles = sorted({each.at or 0.0 for each in zones.values()})
    return PlaceZone(middles.index(table.at), floats(middles))


def _zone(table: SensorTable, name: str, surface: SphereSurface) -> tuple[int, ...]:
    """Numbers of the spheres that a contact force is summed over."""
    frames = surface.spheres.frames
    if table.at is not None:
        raise InputError(f"at: expected spheres or a body; {name} is a surface of spheres")
    if table.spheres is None:
        chosen = tuple(i for i, (body, _) in enumerate(frames) if body == table.body)
        if not chosen:
            raise InputError(f"body: {name} has no sphere on {table.body!r}")
        return chosen
    if max(table.spheres) >= len(frames) or len(set(table.spheres)) < len(table.spheres):
        raise InputError(
            f"spheres: expected different numbers from 0 to {len(frames) - 1}, the spheres of {name}, got "
            f"{list(table.spheres)}"
        )
    return table.spheres


def _check_size(description: Description) -> None:
    """InputError for a system that is too large, before anything of it is made."""
    points = {name: rod_points(rod).size for name, rod in description.rods.items()}
    sizes = {
        name: sum(
            points.get(body, len(surface.at or ()) if surface.type == "spheres" else 1)
            for body in surface.bodies
        )
        for name, surface in description.surfaces.items()
    }
    spheres = [size for name, size in sizes.items() if description.surfaces[name].type == "spheres"]
    found = {
        "coordinates": sum(len(rod.strains) * (2 * rod.elements + 1) for rod in description.rods.values())
        + sum(JOINT_COORDINATES[link.joint.type] for link in description.links.values()),
        "points and spheres": sum(points.values()) + sum(spheres),
        "pairs that could touch": sum(
            sizes.get(each.first, 0) * sizes.get(each.second, 0) for each in description.contacts.values()
        ),
    }
    for what, count in found.items():
        if count > LARGEST[what]:
            raise InputError(
                f"system: expected at most {LARGEST[what]} {what}, got {count}; choose fewer elements, "
                "points or places"
            )


def _check_use(system: System) -> None:
    """InputError for a system of which no dataset can be made: sums before their parts, nothing to see."""
    schema = at_place("sensors", lambda: system.schema)
    if not system.tubes:
        raise InputError("surfaces: expected at least one of type tube, for the cameras, got none")
    if not schema.estimated:
        raise InputError("sensors: expected at least one with estimated = true, for networks, got none")
