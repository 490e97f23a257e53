"""The published plant: a soft exosuit clamped above a finger, as one robot of 25 degrees of freedom."""

from dataclasses import dataclass, field, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray, Number, floats
from exosight.errors import InputError
from exosight.exosuit.finger import Finger
from exosight.exosuit.shapes import TABLE_I, ExosuitShape, radius, radius_slope
from exosight.exosuit.variation import Variant
from exosight.mechanics import Circular, Gauss, NodalQuadratic, PressureLine, Robot, Rod, SphereContact
from exosight.mechanics.contact import Spheres

QUADRATURE = Gauss(elements=5, per_element=8)
"""42 points, each a contact sphere: 8 Gauss points in each of 5 elements, plus both ends."""

STRAINS = {"bend_y": NodalQuadratic(5), "stretch_x": NodalQuadratic(5)}
"""Bending about y and extension along x, 11 nodes each: 22 degrees of freedom."""

ROD = "exosuit"
"""Name of the rod in the robot."""

MAX_FORCE = 4.0
"""Largest actuation of the published data [N]."""


@dataclass(frozen=True)
class Exosuit:
    """A worn exosuit.

    shape               its surface and length
    finger              the finger below it
    young               Young's modulus [Pa]; the default is the one that reproduces the paper's forces
    contact_stiffness   penalty stiffness of the spheres [N/m]
    gap                 clearance between the two at the base [m]; 0 is touching
    mount_angle         inclination of the exosuit at its base [rad], positive away from the finger
    mount_offset        distance of the exosuit's base from the finger's, along the finger [m]
    friction            Coulomb's coefficient between the two, in systems with friction [-]
    """

    shape: ExosuitShape = TABLE_I
    finger: Finger = field(default_factory=Finger)
    young: float = 300e3
    contact_stiffness: float = 1000.0
    gap: float = 0.0
    mount_angle: float = 0.0
    mount_offset: float = 0.0
    friction: float = 0.3

    def __post_init__(self) -> None:
        for name, unit, low, high in (
            ("young", "Pa", 1e3, 1e9),
            ("contact_stiffness", "N/m", 1.0, 1e6),
            ("gap", "m", 0.0, 0.1),
            ("mount_angle", "rad", -0.5, 0.5),
            ("mount_offset", "m", -0.02, 0.02),
            ("friction", "", 0.0, 2.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                limits = f"{low:g}…{high:g} {unit}".rstrip()
                raise InputError(f"{name}: expected {limits}, got {value}")


def varied(exosuit: Exosuit, variant: Variant) -> Exosuit:
    """The exosuit with what a variant changes in it and its finger.

    Raises InputError if the finger has another number of links or hinges than the variant.
    """
    finger = exosuit.finger
    if len(finger.lengths) != len(variant.link_length) or len(finger.joint_stiffness) != len(
        variant.joint_stiffness
    ):
        raise InputError(
            f"finger: expected {len(variant.link_length)} links and {len(variant.joint_stiffness)} hinges, "
            f"got {len(finger.lengths)} and {len(finger.joint_stiffness)}; vary the published finger"
        )

    def scaled(values: tuple[float, ...], factors: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(value * factor for value, factor in zip(values, factors, strict=True))

    return replace(
        exosuit,
        finger=replace(
            finger,
            lengths=scaled(finger.lengths, variant.link_length),
            radii=tuple(size * variant.finger_radius for size in finger.radii),
            joint_stiffness=scaled(finger.joint_stiffness, variant.joint_stiffness),
        ),
        young=exosuit.young * variant.young,
        contact_stiffness=exosuit.contact_stiffness * variant.contact_stiffness,
        gap=exosuit.gap + variant.gap,
        mount_angle=exosuit.mount_angle + variant.mount_angle,
        mount_offset=exosuit.mount_offset + variant.mount_offset,
        friction=exosuit.friction + variant.friction,
    )


def assemble(exosuit: Exosuit, quadrature: Gauss = QUADRATURE) -> Robot:
    """The robot of a worn exosuit: bodies `exosuit`, `finger_0` … and the energies of contact and actuation.

    Its single load is the actuation u [N]; u > 0 pushes along the line on the surface away from the finger.

    quadrature   points along the rod, each a contact sphere
    """
    x, shape = quadrature.points, exosuit.shape
    surface, slope = radius(shape.surface, x), radius_slope(shape.surface, x)
    return assemble_surface(surface, slope, shape.length, exosuit, quadrature)


def assemble_surface(
    surface: Float[AnyArray, " points"],
    slope: Float[AnyArray, " points"],
    length: Number,
    exosuit: Exosuit,
    quadrature: Gauss = QUADRATURE,
) -> Robot:
    """The same robot for an exosuit of any surface and length; JAX can differentiate by these.

    surface      (points,)   S at the points of the rod [m]
    slope        (points,)   dS/dX there [m]
    length       of the rod [m]
    exosuit      gives all but the shape: finger, material, mount
    quadrature   points along the rod, each a contact sphere
    """
    finger = exosuit.finger
    height = finger.radii[0] + surface[0] + exosuit.gap
    sine, cosine = np.sin(exosuit.mount_angle), np.cos(exosuit.mount_angle)
    base = [[cosine, 0, -sine, exosuit.mount_offset], [0, 1, 0, 0], [sine, 0, cosine, height], [0, 0, 0, 1]]
    rod = Rod(
        ROD,
        length,
        Circular(surface),
        young=exosuit.young,
        poisson=0.5,
        density=1070.0,
        strains=STRAINS,
        quadrature=quadrature,
        mount=jnp.array(base),
    )
    links = finger.links()
    dorsal = np.array([0.0, 0.0, 1.0])
    line = PressureLine(
        rod=ROD,
        channel=0,
        offset=surface[:, None] * dorsal,
        slope=slope[:, None] / length * dorsal,
    )
    contact = SphereContact(
        first=Spheres(tuple((ROD, i) for i in range(quadrature.size)), floats(surface)),
        second=Spheres(
            tuple((link.name, site) for link in links for site in range(link.frames)),
            floats(finger.sphere_radii()),
        ),
        stiffness=floats(exosuit.contact_stiffness),
    )
    return Robot((rod, *links), (line, contact))
