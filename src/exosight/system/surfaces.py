"""Surfaces: the geometry that bodies carry, for contact and for pictures."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.contact import Spheres
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.robot import Robot

Node = tuple[str, int | Literal["end"]]
"""A body, and one of its frames by number, or its end."""


class SphereSurface(eqx.Module):
    """Spheres centred on frames of bodies: what presses on another set of them.

    name      of the surface (static)
    spheres   frames and radii [m]
    """

    name: str = eqx.field(static=True)
    spheres: Spheres


class TubeSurface(eqx.Module):
    """A tapered tube with round ends along the frames of one body or several: what a camera sees.

    name     of the surface (static)
    nodes    the frames that its axis runs through (static)
    radius   (nodes,)   [m], linear in between
    shade    gray of the lit surface, 0 black … 1 white (static)
    """

    name: str = eqx.field(static=True)
    nodes: tuple[Node, ...] = eqx.field(static=True)
    radius: Float[AnyArray, " nodes"]
    shade: float = eqx.field(static=True)

    def axis(self, robot: Robot, motion: Motion) -> Float[Array, "nodes 3"]:
        """Where the nodes are in the world [m]."""
        return jnp.stack(
            [
                motion[body].end[:3, 3] if frame == "end" else motion[body].pose[frame, :3, 3]
                for body, frame in self.nodes
            ]
        )


Surface = SphereSurface | TubeSurface
