"""Loads from outside: weight, forces and moments at points, loads spread along rods, torques of motors."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.mechanics.kinematics import Motion
from exosight.mechanics.term import (
    Bound,
    Expansion,
    Term,
    on_frames,
    one_channel,
    point_stiffness,
    point_wrench,
    zero,
)
from exosight.mechanics.tree import Tree


class Gravity(Term):
    """Weight: −Σ m_i γ · p_i over the masses of rods and links.

    acceleration   (3,)   γ [m/s²]
    """

    acceleration: Float[Array, "3"]

    def bind(self, tree: Tree) -> Bound:
        """The weight of every frame's mass is bound once."""
        mass = jnp.concatenate([b.mass() if callable(b.mass) else b.mass for b in tree.bodies])
        pull = -mass[:, None] * self.acceleration

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            position = motion.position
            return zero(tree, loads)._replace(
                energy=jnp.sum(pull * position),
                wrench=point_wrench(position, pull),
                stiffness=point_stiffness(position, pull),
            )

        return expand


class DeadForce(Term):
    """A force of constant direction on one frame: −u direction · p.

    body, frame   the frame: index within the body (static)
    channel       which load scales it (static)
    direction     (3,)   in the world; the force is u · direction [N]
    """

    body: str = eqx.field(static=True)
    frame: int = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    direction: Float[Array, "3"]

    @property
    def loads(self) -> int:
        """Its channel and those before it."""
        return self.channel + 1

    def bind(self, tree: Tree) -> Bound:
        """The frame's index is bound once."""
        i = tree.frame(self.body, self.frame)
        at = np.array([i])

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            position = motion.position[i]
            pull = -loads[self.channel] * self.direction
            by_load = -motion.point_jacobian()[i].T @ self.direction
            return zero(tree, loads)._replace(
                energy=pull @ position,
                wrench=on_frames(point_wrench(position, pull)[None], at, tree.frames),
                stiffness=on_frames(point_stiffness(position, pull)[None], at, tree.frames),
                load_energy=one_channel(-self.direction @ position, self.channel, len(loads)),
                load_gradient=one_channel(by_load, self.channel, len(loads)),
            )

        return expand
