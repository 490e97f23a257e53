"""From a description to a system: bodies, surfaces, contacts, actuators, sensors and cameras."""

import jax.numpy as jnp

from exosight.arrays import floats
from exosight.errors import InputError
from exosight.mechanics import Gravity
from exosight.system.build_actuators import build_actuators
from exosight.system.build_bodies import build_bodies, check_joint, rod_points
from exosight.system.build_surfaces import build_surfaces
from exosight.system.camera import Camera
from exosight.system.description import JOINT_COORDINATES, Description, SensorTable
from exosight.system.faults import at_place
from exosight.system.schema import SensorSpec
from exosight.system.sensors import ContactForce, JointAngle, NetForce, Sensor
from exosight.system.surfaces import SphereSurface
from exosight.system.system import Contact, System
from exosight.validation import check_name

LARGEST = {"coordinates": 500, "points and spheres": 5000, "pairs of spheres": 100_000}
"""What a system may have at most; one of these sizes takes seconds a load."""


def build(description: Description) -> System:
    """The system that a description describes.

    Raises InputError, beginning with the place in the file, for entries that contradict each other, and for
    a system that is too large to be solved.
    """
    _check_size(description)
    bodies = build_bodies(description)
    surfaces = build_surfaces(description)
    spheres = {each.name: each for each in surfaces if isinstance(each, SphereSurface)}
    contacts = tuple(_contact(description, name, spheres) for name in description.contacts)
    weight = () if description.gravity is None else (Gravity(jnp.array(description.gravity)),)
    system = System(
        name=description.name,
        bodies=bodies,
        surfaces=surfaces,
        contacts=contacts,
        actuators=build_actuators(description),
        sensors=tuple(
            at_place(f"sensors.{name}", _sensor, description, name, table, spheres)
            for name, table in description.sensors.items()
        ),
        cameras=tuple(
            (name, Camera(table.centre, table.pixel, table.width, table.height))
            for name, table in description.cameras.items()
        ),
        energies=weight,
    )
    _check_use(system)
    return system


def _contact(description: Description, name: str, spheres: dict[str, SphereSurface]) -> Contact:
    table = description.contacts[name]
    for side, surface in (("first", table.first), ("second", table.second)):
        check_name(f"contacts.{name}.{side}", surface, spheres)
    both = {body for body, _ in spheres[table.first].spheres.frames} & {
        body for body, _ in spheres[table.second].spheres.frames
    }
    if both:
        raise InputError(f"contacts.{name}: both surfaces are on {min(both)}; a body cannot press on itself")
    return Contact(name, table.first, table.second, floats(table.stiffness))


def _sensor(
    description: Description, name: str, table: SensorTable, spheres: dict[str, SphereSurface]
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
    check_name("surface", surface, spheres)
    pressed = {side for each in description.contacts.values() for side in (each.first, each.second)}
    if surface not in pressed:
        raise InputError(f"surface: nothing presses on {surface}; name it in a contact")
    spec = SensorSpec(name, "contact force", "N", estimated=table.estimated, limit=table.limit)
    return ContactForce(spec, surface, _zone(table, surface, spheres[surface]))


def _zone(table: SensorTable, name: str, surface: SphereSurface) -> tuple[int, ...]:
    """Numbers of the spheres that a contact force is summed over."""
    frames = surface.spheres.frames
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
    spheres = {
        name: sum(points.get(body, len(surface.at or ())) for body in surface.bodies)
        for name, surface in description.surfaces.items()
        if surface.type == "spheres"
    }
    found = {
        "coordinates": sum(len(rod.strains) * (2 * rod.elements + 1) for rod in description.rods.values())
        + sum(JOINT_COORDINATES[link.joint.type] for link in description.links.values()),
        "points and spheres": sum(points.values()) + sum(spheres.values()),
        "pairs of spheres": sum(
            spheres.get(each.first, 0) * spheres.get(each.second, 0) for each in description.contacts.values()
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
