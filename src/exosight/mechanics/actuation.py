"""Actuators whose work is that of a line along a rod."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.errors import InputError
from exosight.mechanics.kinematics import Motion, spread
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import Bound, Expansion, Term, one_channel, strain_columns, zero
from exosight.mechanics.tree import Tree


class PressureLine(Term):
    """A line along a rod that pushes with u at its ends (u < 0 pulls, as a cable does): Π = −u ℓ(q).

    The line runs at offset d(X) from the axis; its stretch is y = ξ_v + ξ_ω × d + d′, its length
    ℓ = ∫ |y| ds, and ∂ℓ/∂ξ = (d × t, t) with t = y/|y|: the actuation matrix B of the paper's statics.

    rod       name of the rod (static)
    channel   which load it is (static)
    offset    (points, 3)   d at the quadrature points, in the section's frame [m]
    slope     (points, 3)   d′ = ∂d/∂s [-]
    """

    rod: str = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    offset: Float[Array, "points 3"]
    slope: Float[Array, "points 3"]

    @property
    def loads(self) -> int:
        """Its channel and those before it."""
        return self.channel + 1

    def bind(self, tree: Tree) -> Bound:
        """∂y/∂q is constant and bound once."""
        rod = tree[self.rod]
        if not isinstance(rod, Rod):
            raise InputError(f"PressureLine: {self.rod!r} is a link; a line runs along a rod")
        own = tree.dof_slice(self.rod)
        inside = tuple(range(own.start + rod.joint.dofs, own.stop))
        weights = rod.weights()
        columns = strain_columns(tree, self.rod)[:, :, inside[0] : own.stop]
        dy = columns[:, 3:] + jnp.cross(columns[:, :3], self.offset[:, :, None], axis=1)  # (points, 3, size)

        size = dy.shape[-1]
        flat = dy.reshape(-1, size)  # (3 points, size)
        across = jnp.asarray(flat.T)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            xi = motion.strain[self.rod]
            y = xi[:, 3:] + jnp.cross(xi[:, :3], self.offset) + self.slope
            stretch = jnp.sqrt(jnp.sum(y**2, axis=-1) + 1e-30)
            t = y / stretch[:, None]
            u = loads[self.channel]
            lengthening = (weights[:, None] * t).reshape(-1) @ flat
            # ∂²|y|/∂y² = (I − t tᵀ) / |y|
            section = (weights / stretch)[:, None, None] * (jnp.eye(3) - t[:, :, None] * t[:, None, :])
            bending = across @ (section @ dy).reshape(-1, size)
            length = jnp.sum(weights * stretch)
            by_load = -spread(lengthening, inside, tree.dofs)
            return zero(tree, loads)._replace(
                energy=-u * length,
                gradient=u * by_load,
                hessian=-u * spread(spread(bending, inside, tree.dofs).T, inside, tree.dofs),
                load_energy=one_channel(-length, self.channel, len(loads)),
                load_gradient=one_channel(by_load, self.channel, len(loads)),
            )

        return expand
