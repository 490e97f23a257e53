"""Sensors of a description: forces on zones and along tubes, their sums, and joint angles."""

from collections.abc import Mapping

import numpy as np

from exosight.arrays import floats
from exosight.errors import InputError
from exosight.system.build_bodies import check_joint
from exosight.system.description import Description, SensorTable
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
from exosight.system.surfaces import PlaneSurface, SphereSurface, Surface, TubeSurface
from exosight.validation import check_name

# Zones of a tube are at one place or at least this far apart [m]; a share is divided by the distance.
ZONES_APART = 1e-6


def build_sensors(description: Description, surfaces: Mapping[str, Surface]) -> tuple[Sensor, ...]:
    """The sensors in the file's order.

    surfaces   of the description, by name

    Raises InputError for a zone that is not on its surface, or a surface that nothing presses on.
    """
    return tuple(
        sensor
        for name, table in description.sensors.items()
        for sensor in at_place(f"sensors.{name}", _sensors, description, name, table, surfaces)
    )


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
        if isinstance(found, PlaneSurface):
            if table.at is not None or table.spheres is not None or table.body is not None:
                raise InputError(f"expected no part of {surface}, which is a plane and one zone")
            return (ContactForce(force, surface, PlaceZone(0, floats([0.0]))),)
        if table.at is None and table.spheres is None and table.body is None:
            raise InputError("expected the zone as one of spheres, body and at, got none")
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
        if each.at != table.at and abs((each.at or 0.0) - table.at) < ZONES_APART:
            raise InputError(
                f"at: expected the very place of {other} or one at least {ZONES_APART:g} m from it, "
                f"got {table.at!r} m and {each.at!r} m"
            )
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
