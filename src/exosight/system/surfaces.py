"""Surfaces: the geometry that bodies carry, for contact and for pictures."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.contact import Spheres
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.link import Link
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod
from exosight.mechanics.surfaces import Plane, Solids, Tube
from exosight.mechanics.tree import Tree
from exosight.system.sensors import ContactForce, PlaceZone, SphereZone

Node = tuple[str, int | Literal["end"]]
"""A body, and one of its frames by number, or its end."""


class SphereSurface(eqx.Module):
    """Spheres centred on frames of bodies: what presses on another set of them.

    name      of the surface (static)
    spheres   frames and radii [m]
    """

    name: str = eqx.field(static=True)
    spheres: Spheres

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that carry it."""
        return tuple(dict.fromkeys(body for body, _ in self.spheres.frames))


class TubeSurface(eqx.Module):
    """A tapered tube with round ends along the frames of one body or several: what cameras see and contacts
    act between.

    name     of the surface (static)
    nodes    the frames that its axis runs through (static)
    radius   (nodes,)   [m], linear in between
    shade    gray of the lit surface, 0 black … 1 white (static)
    """

    name: str = eqx.field(static=True)
    nodes: tuple[Node, ...] = eqx.field(static=True)
    radius: Float[AnyArray, " nodes"]
    shade: float = eqx.field(static=True)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that carry it."""
        return tuple(dict.fromkeys(body for body, _ in self.nodes))

    def along(self, tree: Tree) -> Float[Array, " nodes"]:
        """Distance of the nodes from the first one, along the unbent tube [m]."""
        body = tree[self.nodes[0][0]]
        if isinstance(body, Rod):
            return jnp.asarray(body.length * body.quadrature.points)
        return jnp.cumsum(jnp.stack([jnp.zeros(()), *(jnp.asarray(x.length) for x in self._links(tree))]))

    def contact_side(self, tree: Tree) -> Tube | Solids:
        """The surface as mechanics knows it: around a rod, or tapered solids."""
        body = tree[self.nodes[0][0]]
        if isinstance(body, Rod):
            return Tube(body.name, self.radius)
        radius = jnp.asarray(self.radius)
        return Solids(
            tuple((link.name, 0) for link in self._links(tree)),
            jnp.stack([jnp.asarray(link.length) for link in self._links(tree)]),
            jnp.stack([radius[:-1], radius[1:]], axis=1),
        )

    def _links(self, tree: Tree) -> list[Link]:
        bodies = [tree[body] for body, frame in self.nodes if frame != "end"]
        return [body for body in bodies if isinstance(body, Link)]

    def axis(self, robot: Robot, motion: Motion) -> Float[Array, "nodes 3"]:
        """Where the nodes are in the world [m]."""
        return jnp.stack(
            [
                motion[body].end[:3, 3] if frame == "end" else motion[body].pose[frame, :3, 3]
                for body, frame in self.nodes
            ]
        )


class PlaneSurface(eqx.Module):
    """A plane with a half-space behind it, which contacts act on; cameras do not see it.

    name    of the surface (static)
    plane   what it is fixed to, a point on it and its normal
    """

    name: str = eqx.field(static=True)
    plane: Plane

    @property
    def bodies(self) -> tuple[str, ...]:
        """Name of the body that carries it; of the world, none."""
        return () if self.plane.body is None else (self.plane.body,)

    @property
    def radius(self) -> Float[AnyArray, "1"]:
        """At its one place: none."""
        return jnp.zeros(1)

    def along(self, tree: Tree) -> Float[Array, "1"]:
        """Its one place, as of a tube."""
        return jnp.zeros(1)

    def contact_side(self, tree: Tree) -> Plane:
        """The surface as mechanics knows it."""
        return self.plane

    def axis(self, robot: Robot, motion: Motion) -> Float[Array, "1 3"]:
        """Its point in the world [m]."""
        return self.plane.in_world(motion.pose[self.plane.index(robot)])[0][None]


Surface = SphereSurface | TubeSurface | PlaneSurface


def zone_middle(zone: ContactForce, surface: Surface, robot: Robot, motion: Motion) -> Float[Array, "3"]:
    """The middle of a zone, on its surface's axis [m]."""
    match zone.zone, surface:
        case SphereZone(spheres), SphereSurface():
            index = surface.spheres.index(robot)
            return motion.position[jnp.array([index[i] for i in spheres])].mean(axis=0)
        case PlaceZone(), TubeSurface() | PlaneSurface():
            middle, along = zone.zone.middle, surface.along(robot)
            axis = surface.axis(robot, motion)
            return jnp.stack([jnp.interp(middle, along, axis[:, i]) for i in range(3)])
    raise TypeError(f"a zone of {type(zone.zone).__name__} on {type(surface).__name__}")


def zone_radius(zone: ContactForce, surface: Surface, tree: Tree) -> Float[Array, ""]:
    """The mean radius of the surface in a zone, for places along a tube that in its middle [m]."""
    match zone.zone, surface:
        case SphereZone(spheres), SphereSurface():
            return jnp.asarray(surface.spheres.radius)[jnp.array(spheres)].mean()
        case PlaceZone(), TubeSurface() | PlaneSurface():
            return jnp.interp(zone.zone.middle, surface.along(tree), jnp.asarray(surface.radius))
    raise TypeError(f"a zone of {type(zone.zone).__name__} on {type(surface).__name__}")
