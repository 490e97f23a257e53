"""Rods and links of a description, and the sizes that surfaces and actuators take from them."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    Fixed,
    Gauss,
    Link,
    NodalQuadratic,
    Revolute,
    Rod,
    Spherical,
    Universal,
)
from exosight.mechanics.joint import Joint, Springs
from exosight.mechanics.tree import Body
from exosight.system.description import (
    JOINT_COORDINATES,
    Description,
    JointTable,
    LinkTable,
    RadiusProfile,
    RodTable,
)
from exosight.system.faults import at_place
from exosight.system.profile import Points, Profile, from_formula, from_points
from exosight.system.units import LENGTH
from exosight.validation import check_name

SMALLEST_RADIUS, LARGEST_RADIUS = 1e-6, 10.0  # [m]
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def build_bodies(description: Description) -> tuple[Body, ...]:
    """The bodies, parents before children, otherwise as in the file: rods first.

    Raises InputError for a parent that is not there, a cycle, or a radius that is none.
    """
    return tuple(
        at_place(f"rods.{name}", _rod, name, description.rods[name])
        if name in description.rods
        else at_place(f"links.{name}", _link, description, name)
        for name in _order(description)
    )


def _order(description: Description) -> list[str]:
    parents = {name: table.parent for name, table in [*description.rods.items(), *description.links.items()]}
    placed: dict[str, None] = {}  # in order; an ordered set
    for start in parents:
        chain: list[str] = []
        name: str | None = start
        while name is not None and name not in placed:
            if name not in parents:
                check_name(f"{_place(description, chain[-1])}.parent", name, parents)
            if name in chain:
                cycle = " sits on ".join([*chain[chain.index(name) :], name])
                raise InputError(
                    f"{_place(description, name)}.parent: {cycle}, a cycle; one body must sit on the ground"
                )
            chain.append(name)
            name = parents[name]
        placed |= dict.fromkeys(reversed(chain))
    return list(placed)


def _place(description: Description, body: str) -> str:
    return f"rods.{body}" if body in description.rods else f"links.{body}"


def _rod(name: str, table: RodTable) -> Rod:
    return Rod(
        name,
        table.length,
        Circular(rod_radii(table)),
        young=table.young,
        poisson=table.poisson,
        density=table.density,
        viscosity=table.viscosity,
        strains={strain: NodalQuadratic(table.elements) for strain in table.strains},
        quadrature=rod_points(table),
        parent=table.parent,
        mount=_mount(table),
    )


def _link(description: Description, name: str) -> Link:
    """A link with sites at its base, at each place of a sphere, and at its middle, which carries the mass."""
    table = description.links[name]
    shares = [0.0, *(place for _, place in _spheres_on(description, name)), 0.5]
    mass = np.zeros(len(shares))
    mass[-1] = table.mass
    return Link(
        name,
        table.length,
        np.outer(shares, [table.length, 0.0, 0.0]),
        parent=table.parent,
        joint=_joint(table.joint),
        mount=_mount(table),
        mass=mass,
    )


def _spheres_on(description: Description, link: str) -> list[tuple[str, float]]:
    """Every sphere on a link, surface by surface: whose it is, and where along the link, as a share.

    Each has a frame of its own, so that the structure stays where places vary from design to design.
    """
    return [
        (name, place)
        for name, surface in description.surfaces.items()
        if surface.type == "spheres" and link in surface.bodies
        for place in surface.at or ()
    ]


def sphere_frames(description: Description, surface: str, link: str) -> list[int]:
    """Frames of a link that are the spheres of a surface, in the order of its places."""
    return [i for i, (owner, _) in enumerate(_spheres_on(description, link), start=1) if owner == surface]


def _joint(table: JointTable) -> Joint:
    if table.type == "fixed":
        return Fixed()
    limits = (-np.inf, np.inf) if table.range is None else table.range
    held = 0.0 if table.range is None else table.limit_stiffness
    springs = Springs(stiffness=table.stiffness, limits=limits, limit_stiffness=held, damping=table.damping)
    if table.type == "universal":
        return Universal(**springs)
    if table.type == "spherical":
        return Spherical(**springs)
    return Revolute(_AXES[table.axis], **springs)


def check_joint(description: Description, body: str, coordinate: int) -> None:
    """InputError unless a body is a link whose joint has this coordinate, counted from 0."""
    link = description.links.get(body)
    if coordinate >= (0 if link is None else JOINT_COORDINATES[link.joint.type]):
        raise InputError(
            f"body: expected a link with a joint of more than {coordinate} coordinates, got {body!r}"
        )


def _mount(table: LinkTable | RodTable) -> Float[np.ndarray, "4 4"]:
    mount = np.eye(4)
    mount[:3, :3] = Rotation.from_rotvec(table.rotation).as_matrix()
    mount[:3, 3] = table.position
    return mount


def rod_points(table: RodTable) -> Gauss:
    """The points along a rod: its frames."""
    return Gauss(table.elements, table.points_per_element)


def rod_profile(table: RodTable) -> Profile:
    """The radius along a rod [m]; ValueError for a formula that is none, or places that do not rise."""
    radius = table.radius
    if not isinstance(radius, RadiusProfile):
        size = float(radius)
        return Profile(lambda x: np.full(len(x), size), lambda x: np.zeros(len(x)))
    unit = LENGTH.units[radius.unit] * radius.scale
    if radius.formula is not None:
        return from_formula(radius.formula, unit)
    if radius.values is None:
        raise InputError("csv: the file is read with the system file; expected values in its place")
    values = np.array(radius.values)
    x = np.linspace(0, 1, len(values)) if radius.x is None else np.array(radius.x)
    return from_points(x, unit * values)


def rod_radii(table: RodTable) -> Points:
    """The radius at each point of a rod [m]; InputError where it is none."""
    x = rod_points(table).points
    radii = at_place("radius", lambda: rod_profile(table).value(x))
    wrong = ~((radii >= SMALLEST_RADIUS) & (radii <= LARGEST_RADIUS))  # NaN is caught here too
    if np.any(wrong):
        first = int(np.argmax(wrong))
        raise InputError(
            f"radius: expected {SMALLEST_RADIUS:g} to {LARGEST_RADIUS:g} m all along the rod, got "
            f"{radii[first]:g} m at X = {x[first]:.3f}"
        )
    return radii
