"""From a description to a system: bodies, surfaces, contacts, actuators, sensors and cameras."""

from collections.abc import Mapping

import jax.numpy as jnp

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
from exosight.system.sensors import ContactForce, JointAngle, NetForce, PlaceZone, Sensor, SphereZone
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
            at_place(f"sensors.{name}", _sensor, description, name, table, named)
            for name, table in description.sensors.items()
        ),
        cameras=tuple(
            (name, Camera(table.centre, table.pixel, table.width, table.height))
            for name, table in description.cameras.items()
        ),
        energies=weight,
        visibility=description.visibility,
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


def _sensor(
    description: Description, name: str, table: SensorTable, surfaces: Mapping[str, Surface]
) -> Sensor:
    if table.type == "joint_angle":
        body = table.body or ""
        check_joint(description, body, table.coordinate)
        spec = SensorSpec(name, "joint angle", "rad", estimated=table.estimated)
        return JointAngle(spec, body, table.coordinate)
    if table.type == "net_force":
        for part in table.parts or ():
            if part in description.sensors and description.sensors[part].type == "joint_angle":
                raise InputError(f"parts: expected forces, but {part} is a joint angle")
        return NetForce(SensorSpec(name, "net force", "N", parts=table.parts or (), limit=table.limit))
    surface = table.surface or ""
    check_name("surface", surface, surfaces)
    pressed = {side for each in description.contacts.values() for side in (each.first, each.second)}
    if surface not in pressed:
        raise InputError(f"surface: nothing presses on {surface}; name it in a contact")
    spec = SensorSpec(name, "contact force", "N", estimated=table.estimated, limit=table.limit)
    found = surfaces[surface]
    if isinstance(found, SphereSurface):
        return ContactForce(spec, surface, SphereZone(_zone(table, surface, found)))
    return ContactForce(spec, surface, _place(description, name, table, found))


def _place(description: Description, name: str, table: SensorTable, surface: TubeSurface) -> PlaceZone:
    """The zone among all of a tube."""
    if table.at is None:
        raise InputError(
            f"at: expected a distance along {surface.name}, which is a tube, got spheres or a body"
        )
    zones = {
        other: each.at
        for other, each in description.sensors.items()
        if each.surface == surface.name and each.at is not None
    }
    length = sum((description.rods.get(body) or description.links[body]).length for body in surface.bodies)
    if table.at > length:
        raise InputError(
            f"at: expected at most {length:g} m, the length of {surface.name}, got {table.at:g} m"
        )
    same = [other for other, at in zones.items() if at == table.at and other != name]
    if same:
        raise InputError(f"at: expected another place than that of {same[0]}, got {table.at:g} m for both")
    order = sorted(zones, key=zones.__getitem__)
    return PlaceZone(order.index(name), floats([zones[each] for each in order]))


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
