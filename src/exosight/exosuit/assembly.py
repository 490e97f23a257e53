"""The published plant: a soft exosuit clamped above a finger, as one robot of 25 degrees of freedom."""

from dataclasses import dataclass, field, replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray, Number, floats
from exosight.errors import InputError
from exosight.exosuit.finger import Finger
from exosight.exosuit.shapes import TABLE_I, ExosuitShape, radius, radius_slope
from exosight.exosuit.variation import Variant
from exosight.mechanics import Circular, Gauss, NodalQuadratic, PressureLine, Robot, Rod, SphereContact, walk
from exosight.mechanics.contact import Spheres

QUADRATURE = Gauss(elements=5, per_element=8)
"""42 points, each a contact sphere: 8 Gauss points in each of 5 elements, plus both ends."""

STRAINS = {"bend_y": NodalQuadratic(5), "stretch_x": NodalQuadratic(5)}
"""Bending about y and extension along x, 11 nodes each: 22 degrees of freedom."""

ROD = "exosuit"
"""Name of the rod in the robot."""

# The base's pose is I + sin(angle) _TURN + (cos(angle) − 1) _LEVEL + offset _ALONG + height _ABOVE.
_LEVEL = np.diag([1.0, 0.0, 1.0, 0.0])
_TURN, _ALONG, _ABOVE = np.zeros((3, 4, 4))
_TURN[0, 2], _TURN[2, 0], _ALONG[0, 3], _ABOVE[2, 3] = -1.0, 1.0, 1.0, 1.0

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
    """

    shape: ExosuitShape = TABLE_I
    finger: Finger = field(default_factory=Finger)
    young: float = 300e3
    contact_stiffness: float = 1000.0
    gap: float = 0.0
    mount_angle: float = 0.0
    mount_offset: float = 0.0

    def __post_init__(self) -> None:
        for name, unit, low, high in (
            ("young", "Pa", 1e3, 1e9),
            ("contact_stiffness", "N/m", 1.0, 1e6),
            ("gap", "m", 0.0, 0.1),
            ("mount_angle", "rad", -0.5, 0.5),
            ("mount_offset", "m", -0.02, 0.02),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name}: expected {low:g}…{high:g} {unit}, got {value}")


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
    )


def assemble(exosuit: Exosuit) -> Robot:
    """The robot of a worn exosuit: bodies `exosuit`, `finger_0` … and the energies of contact and actuation.

    Its single load is the actuation u [N]; u > 0 pushes along the line on the surface away from the finger.
    """
    x, shape = QUADRATURE.points, exosuit.shape
    return assemble_surface(
        radius(shape.surface, x),
        radius_slope(shape.surface, x),
        shape.length,
        finger=exosuit.finger,
        young=exosuit.young,
        contact_stiffness=exosuit.contact_stiffness,
        gap=exosuit.gap,
        mount_angle=exosuit.mount_angle,
        mount_offset=exosuit.mount_offset,
    )


def assemble_surface(
    surface: Float[AnyArray, " points"],
    slope: Float[AnyArray, " points"],
    length: Number,
    *,
    finger: Finger,
    young: Number,
    contact_stiffness: Number,
    gap: Number,
    mount_angle: Number = 0.0,
    mount_offset: Number = 0.0,
) -> Robot:
    """The same robot for an exosuit of any surface; JAX can differentiate by every number but the finger's.

    surface   (points,)   S at the points of QUADRATURE [m]
    slope     (points,)   dS/dX there [m]
    """
    height = finger.radii[0] + surface[0] + gap
    turned = jnp.sin(mount_angle) * _TURN + (jnp.cos(mount_angle) - 1) * _LEVEL
    rod = Rod(
        ROD,
        length,
        Circular(surface),
        young=young,
        poisson=0.5,
        density=1070.0,
        strains=STRAINS,
        quadrature=QUADRATURE,
        mount=np.eye(4) + turned + mount_offset * _ALONG + height * _ABOVE,
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
        first=Spheres(tuple((ROD, i) for i in range(QUADRATURE.size)), floats(surface)),
        second=Spheres(
            tuple((link.name, site) for link in links for site in range(link.frames)),
            floats(finger.sphere_radii()),
        ),
        stiffness=floats(contact_stiffness),
    )
    return Robot((rod, *links), (line, contact))


class Pose(eqx.Module):
    """A worn exosuit at one equilibrium, in the terms of the paper; leading batch dimensions allowed.

    forces        (*batch, 8)           magnitude of the summed contact force on C0…C7 [N]
    net_force     (*batch,)             F_net: the sum over C1…C7 [N]
    pushes        (*batch, 8, 3)        the summed contact force on C0…C7 itself [N]
    spheres       (*batch, 8, 3)        centres of the finger's spheres C0…C7 [m]
    joint_angles  (*batch, hinges)      flexion [rad]
    centreline    (*batch, points, 3)   the exosuit's axis [m]
    finger        (*batch, links + 1, 3)  joints and tip [m]
    tip_angle     (*batch,)             inclination of the exosuit's tip in the x–z plane [rad]: negative
                                        downwards, counted through full turns
    """

    forces: Float[AnyArray, "*batch spheres"]
    net_force: Float[AnyArray, "*batch"]
    pushes: Float[AnyArray, "*batch spheres 3"]
    spheres: Float[AnyArray, "*batch spheres 3"]
    joint_angles: Float[AnyArray, "*batch hinges"]
    centreline: Float[AnyArray, "*batch points 3"]
    finger: Float[AnyArray, "*batch nodes 3"]
    tip_angle: Float[AnyArray, "*batch"]

    @property
    def axes(self) -> dict[str, Float[AnyArray, "*batch nodes 3"]]:
        """Axes of the tubes of `exosight.exosuit.published`, by their names [m]."""
        return {"finger": self.finger, "exosuit": self.centreline}


@eqx.filter_jit
def observe(robots: Robot, q: Float[AnyArray, "robots loads dofs"]) -> Pose:
    """Forces and shape of stacked robots at coordinates q (see `exosight.mechanics.stack`)."""
    return jax.vmap(lambda robot, path: jax.vmap(partial(_observe, robot))(path))(robots, jnp.asarray(q))


def _observe(robot: Robot, q: Float[Array, " dofs"]) -> Pose:
    motion = walk(robot, q)
    contact = next(term for term in robot.terms if isinstance(term, SphereContact))
    _, force = contact.forces(robot, motion.position)
    squared = jnp.sum(force**2, axis=-1)
    pressed = squared > 0  # the root of 0 has no derivative, but a sphere that touches nothing has: 0
    forces = jnp.where(pressed, jnp.sqrt(jnp.where(pressed, squared, 1.0)), 0.0)
    links = [body for body in robot.bodies if body.name != ROD]
    joints = jnp.concatenate([q[robot.dof_slice(link.name)] for link in links])
    bases = jnp.stack([motion.position[robot.frame_slice(link.name)][0] for link in links])
    rod = robot[ROD]
    assert isinstance(rod, Rod)
    (steps,) = motion[ROD].steps
    return Pose(
        forces=forces,
        net_force=forces[1:].sum(),
        pushes=force,
        spheres=motion.position[np.array(contact.second.index(robot))],
        joint_angles=joints,
        centreline=motion.position[robot.frame_slice(ROD)],
        finger=jnp.concatenate([bases, motion[links[-1].name].end[:3, 3][None]]),
        tip_angle=jnp.arctan2(rod.mount[2, 0], rod.mount[0, 0]) - steps.curvature.twist[:, 1].sum(),
    )
