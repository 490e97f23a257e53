"""Surfaces of a description: tubes that cameras see, spheres and planes that press."""

from exosight.arrays import floats
from exosight.errors import InputError
from exosight.mechanics.contact import Spheres
from exosight.mechanics.surfaces import Plane
from exosight.system.build_bodies import rod_points, rod_radii, sphere_frames
from exosight.system.description import Description, SurfaceTable
from exosight.system.faults import at_place
from exosight.system.surfaces import Node, PlaneSurface, SphereSurface, Surface, TubeSurface
from exosight.validation import check_name, check_unique


def build_surfaces(description: Description) -> tuple[Surface, ...]:
    """The surfaces in the file's order.

    Raises InputError for a body that is not there, a tube that does not follow its bodies, spheres on a link
    without places, or a plane on what is not one link.
    """
    return tuple(
        at_place(f"surfaces.{name}", _surface, description, name, table)
        for name, table in description.surfaces.items()
    )


def _surface(description: Description, name: str, table: SurfaceTable) -> Surface:
    known = [*description.rods, *description.links]
    for i, body in enumerate(table.bodies):
        check_name(f"bodies.{i}", body, known)
    check_unique("bodies", table.bodies)
    return {"tube": _tube, "spheres": _spheres, "plane": _plane}[table.type](description, name, table)


def _plane(description: Description, name: str, table: SurfaceTable) -> PlaneSurface:
    if len(table.bodies) > 1 or any(body in description.rods for body in table.bodies):
        raise InputError("bodies: expected one link that carries the plane, or none for the world")
    body = table.bodies[0] if table.bodies else None
    return PlaneSurface(name, Plane(body, floats(table.position), floats(table.normal)))


def _tube(description: Description, name: str, table: SurfaceTable) -> TubeSurface:
    """A rod's points, or the bases of links in a chain and the end of the last one."""
    first, last = table.bodies[0], table.bodies[-1]
    if first in description.rods:
        if len(table.bodies) > 1:
            raise InputError("bodies: expected one rod, or links in a chain, got a rod and more")
        rod = description.rods[first]
        along: tuple[Node, ...] = tuple((first, i) for i in range(rod_points(rod).size))
        return TubeSurface(name, along, floats(rod_radii(rod)), table.shade)
    for before, after in zip(table.bodies, table.bodies[1:], strict=False):
        if after not in description.links or description.links[after].parent != before:
            raise InputError(f"bodies: expected links in a chain, but {after} does not sit on {before}")
    links = [description.links[body] for body in table.bodies]
    radii = [*(link.radius[0] for link in links), links[-1].radius[1]]
    nodes: tuple[Node, ...] = (*((body, 0) for body in table.bodies), (last, "end"))
    return TubeSurface(name, nodes, floats(radii), table.shade)


def _spheres(description: Description, name: str, table: SurfaceTable) -> SphereSurface:
    """A sphere at each point of a rod, or at the given places along each link, as thick as the body there."""
    frames: list[tuple[str, int]] = []
    radii: list[float] = []
    for body in table.bodies:
        if body in description.rods:
            rod = description.rods[body]
            frames += [(body, i) for i in range(rod_points(rod).size)]
            radii += rod_radii(rod).tolist()
            continue
        if table.at is None:
            raise InputError(f"at: expected places along {body} from 0 to 1, got none")
        base, end = description.links[body].radius
        frames += [(body, i) for i in sphere_frames(description, name, body)]
        radii += [base + (end - base) * place for place in table.at]
    return SphereSurface(name, Spheres(tuple(frames), floats(radii)))
