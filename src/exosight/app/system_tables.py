"""What a system consists of, as tables."""

from collections.abc import Sequence

import numpy as np

from exosight.evaluation.tables import Cell, Column, Table
from exosight.mechanics.contact import SphereContact
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.rod import Rod
from exosight.mechanics.tree import Body
from exosight.system.camera import Camera, Visibility
from exosight.system.description import VaryTable
from exosight.system.schema import Channel
from exosight.system.sensors import (
    ContactForce,
    ForcePerLength,
    JointAngle,
    NetForce,
    PlaceZone,
    Sensor,
    SphereZone,
)
from exosight.system.surfaces import PlaneSurface, SphereSurface, Surface
from exosight.system.system import ContactTerm, System


def system_tables(system: System, varied: Sequence[VaryTable] = ()) -> list[Table]:
    """A table for each kind of part that the system has; `varied` is what differs from design to design."""
    schema = system.schema
    tables = [
        _bodies(system.bodies),
        Table(
            "relaxation",
            "Relaxation of rods",
            (Column("rod"), Column("share"), Column("time", "s")),
            tuple(
                (each.rod, float(share), float(time))
                for each in system.relaxations
                for share, time in zip(each.share, each.time, strict=True)
            ),
        ),
        _surfaces(system.surfaces),
        Table(
            "contacts",
            "Contacts",
            (Column("contact"), Column("first"), Column("second"), Column("stiffness"), Column("unit")),
            tuple(
                (each.name, each.first, each.second, float(each.stiffness), _stiffness_unit(term))
                for each, term in zip(system.contacts, system.contact_terms, strict=True)
            ),
        ),
        _channels(schema.channels),
        _sensors(system.sensors),
        _cameras(system.cameras, system.visibility),
        Table(
            "varied",
            "What differs from design to design",
            (Column("entry"), Column("low"), Column("high")),
            tuple((each.entry, _text(each.low), _text(each.high)) for each in varied),
        ),
    ]
    return [table for table in tables if table.rows]


def _bodies(bodies: Sequence[Body]) -> Table:
    columns = (
        Column("body"),
        Column("kind"),
        Column("parent"),
        Column("moves by"),
        Column("length", "mm"),
        Column("modulus", "kPa"),
        Column("coordinates"),
    )
    rows: list[tuple[Cell, ...]] = []
    for body in bodies:
        length = 1e3 * float(body.length)
        if isinstance(body, Rod):
            moves = ", ".join(name for name, _ in body.strains)
            kind, young = "rod", float(body.young) / 1e3
        else:
            kind, young, moves = "link", None, type(body.joint).__name__.lower()
        rows.append((body.name, kind, body.parent or "ground", moves, length, young, body.dofs))
    return Table("bodies", "Bodies", columns, tuple(rows))


def _surfaces(surfaces: Sequence[Surface]) -> Table:
    columns = (
        Column("surface"),
        Column("kind"),
        Column("bodies"),
        Column("points"),
        Column("radius from", "mm"),
        Column("to", "mm"),
    )
    rows: list[tuple[Cell, ...]] = []
    for surface in surfaces:
        bodies = ", ".join(surface.bodies) or "world"
        if isinstance(surface, PlaneSurface):
            rows.append((surface.name, "plane", bodies, None, None, None))
            continue
        spheres = isinstance(surface, SphereSurface)
        radii = 1e3 * np.asarray(surface.spheres.radius if spheres else surface.radius)
        kind = "spheres" if spheres else "tube"
        rows.append((surface.name, kind, bodies, len(radii), float(radii.min()), float(radii.max())))
    return Table("surfaces", "Surfaces", columns, tuple(rows))


def _channels(channels: Sequence[Channel]) -> Table:
    columns = (
        *(Column("channel"), Column("unit"), Column("lowest"), Column("highest")),
        *(Column("rate a second"), Column("far end of paths")),
    )
    rows = tuple((c.name, c.unit, c.low, c.high, c.rate, c.peak) for c in channels)
    return Table("channels", "Load channels", columns, rows)


def _sensors(sensors: Sequence[Sensor]) -> Table:
    columns = (
        *(Column("sensor"), Column("quantity"), Column("component"), Column("unit"), Column("of")),
        *(Column("estimated"), Column("limit")),
    )
    rows = tuple(
        (
            *(each.spec.name, each.spec.quantity, _component(each), each.spec.unit, _measured(each)),
            *("yes" if each.spec.estimated else "no", each.spec.limit),
        )
        for each in sensors
    )
    return Table("sensors", "Sensors", columns, rows)


def _component(sensor: Sensor) -> str | None:
    """What a sensor of a force reads; others have no components."""
    return sensor.spec.component if isinstance(sensor, ContactForce | ForcePerLength) else None


def _measured(sensor: Sensor) -> str:
    match sensor:
        case NetForce():
            return " + ".join(sensor.spec.parts)
        case JointAngle():
            return f"{sensor.body}, coordinate {sensor.coordinate}"
        case _:
            return f"{sensor.surface} {_zone(sensor.zone)}"


def _stiffness_unit(term: ContactTerm) -> str:
    """Of a pair of spheres or links, or of a length of a rod's tube."""
    return "N/m" if isinstance(term, SphereContact | RigidContact) else "N/m²"


def _zone(zone: SphereZone | PlaceZone) -> str:
    """Numbers of spheres, or the distance along a tube."""
    if isinstance(zone, SphereZone):
        return ", ".join(map(str, zone.spheres))
    if len(zone.middles) == 1:
        return "whole"
    return f"at {1e3 * float(zone.middle):.3g} mm"


def _cameras(cameras: Sequence[tuple[str, Camera]], visibility: Visibility) -> Table:
    columns = (
        *(Column("camera"), Column("width", "pixels"), Column("height", "pixels")),
        *(Column("pixel", "mm"), Column("middle x", "mm"), Column("middle z", "mm")),
        *(Column("distance", "mm"), Column("visibility")),
    )
    rows = tuple(
        (
            *(name, c.width, c.height, 1e3 * c.metres_per_pixel, 1e3 * c.centre[0], 1e3 * c.centre[1]),
            *("orthographic" if c.distance is None else 1e3 * c.distance, visibility),
        )
        for name, c in cameras
    )
    return Table("cameras", "Cameras", columns, rows)


def _text(limit: str | float) -> str:
    return limit if isinstance(limit, str) else f"{limit:g}"
