"""From a description to a system: bodies, surfaces, contacts, actuators, sensors and cameras."""

from collections.abc import Mapping

import jax.numpy as jnp

from exosight.arrays import floats
from exosight.errors import InputError
from exosight.mechanics import Gravity
from exosight.mechanics.relaxation import relaxation
from exosight.mechanics.surfaces import line_stiffness
from exosight.mechanics.tree import Tree
from exosight.system.build_actuators import build_actuators
from exosight.system.build_bodies import build_bodies, rod_points
from exosight.system.build_sensors import build_sensors
from exosight.system.build_surfaces import build_surfaces
from exosight.system.camera import Camera
from exosight.system.description import JOINT_COORDINATES, CameraTable, Description
from exosight.system.faults import at_place
from exosight.system.surfaces import PlaneSurface, SphereSurface, Surface
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
    tree, channels = Tree(bodies), len(description.actuators)
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
        sensors=build_sensors(description, named),
        cameras=tuple((name, _camera(table)) for name, table in description.cameras.items()),
        energies=weight,
        relaxations=tuple(
            relaxation(
                name,
                [mode.share for mode in rod.relaxation],
                [mode.time for mode in rod.relaxation],
                channels,
                tree,
            )
            for name, rod in description.rods.items()
            if rod.relaxation
        ),
        visibility=description.visibility,
    )
    _check_use(system)
    return system


def first_camera(description: Description) -> Camera:
    """The camera whose pictures networks see, without the system."""
    return _camera(next(iter(description.cameras.values())))


def _camera(table: CameraTable) -> Camera:
    return Camera(
        centre=table.centre,
        metres_per_pixel=table.pixel,
        width=table.width,
        height=table.height,
        roll=table.roll,
        distance=table.distance,
        pan=table.pan,
        tilt=table.tilt,
        distortion=table.distortion,
        principal=table.principal,
    )


def _contact(description: Description, name: str, surfaces: Mapping[str, Surface]) -> Contact:
    table = description.contacts[name]
    for side, surface in (("first", table.first), ("second", table.second)):
        check_name(f"contacts.{name}.{side}", surface, surfaces)
    first, second = surfaces[table.first], surfaces[table.second]
    spheres = isinstance(first, SphereSurface)
    if spheres != isinstance(second, SphereSurface):
        raise InputError(f"contacts.{name}: expected both surfaces of spheres or none, got one")
    soft: list[float] = []
    if not spheres:
        first, second = sorted((first, second), key=lambda side: _rank(side, description))
        bodies = [*first.bodies[:1], *second.bodies[:1]]
        rods = [description.rods[body] for body in bodies if body in description.rods]
        soft = [line_stiffness(rod.young, rod.poisson) for rod in rods]
    both = set(first.bodies) & set(second.bodies)
    if both and not (soft and first.name == second.name):
        raise InputError(
            f"contacts.{name}: both surfaces are on {min(both)}; only the tube of a rod can press on itself"
        )
    right, wrong = ("line_stiffness", "stiffness") if soft else ("stiffness", "line_stiffness")
    if getattr(table, wrong) is not None or not (soft or table.stiffness):
        of = "a rod" if soft else "spheres" if spheres else "links"
        raise InputError(f"contacts.{name}: expected {right}, not {wrong}, for contact of {of}")
    stiffness = table.stiffness or table.line_stiffness or 1 / sum(1 / each for each in soft)
    friction = None if table.friction is None else floats(table.friction)
    damping = None if table.damping is None else floats(table.damping)
    return Contact(name, first.name, second.name, floats(stiffness), friction, damping)


def _rank(side: Surface, description: Description) -> int:
    """Rods' tubes before links' and these before planes, as contacts take them."""
    return 2 if isinstance(side, PlaneSurface) else int(description.rods.keys().isdisjoint(side.bodies))


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
