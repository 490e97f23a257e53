"""Actuators that act along a line on a rod."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray, known
from exosight.errors import InputError
from exosight.mechanics.kinematics import Motion, spread
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import Bound, Expansion, Term, one_channel, strain_columns, zero
from exosight.mechanics.tree import Tree

Path = Callable[[Array], tuple[Array, Array]]
"""Maps X in [0, 1] along a rod to (y, z) in its section [m]; smooth, of JAX operations."""


def straight(y: float, z: float) -> Path:
    """A line at constant (y, z) [m]."""
    return lambda x: (jnp.asarray(y, dtype=float), jnp.asarray(z, dtype=float))


def helix(radius: float | Callable[[Array], Array], turns: float = 0.0, phase: float = 0.0) -> Path:
    """A line that winds about the axis, from the y axis towards the z axis for positive `turns`.

    radius   of the helix [m], or a function of X: the radius of a tapered rod winds it on the surface
    turns    from base to tip; none keeps it on one side
    phase    angle at the base, from the y axis [rad]
    """

    def path(x: Array) -> tuple[Array, Array]:
        r = jnp.asarray(radius(x) if callable(radius) else radius, dtype=float)
        angle = 2 * np.pi * turns * x + phase
        return r * jnp.cos(angle), r * jnp.sin(angle)

    return path


class PressureLine(Term):
    """A line along a rod that pushes with u at its ends (u < 0 pulls, as a cable does): Π = −u ℓ(q).

    The line runs at offset d(X) from the axis; its stretch is y = ξ_v + ξ_ω × d + d′, its length
    ℓ = ∫ |y| ds, and ∂ℓ/∂ξ = (d × t, t) with t = y/|y|: the actuation matrix B of the paper's statics.
    A cable under tension T is u = −T. `along` makes one from a path.

    rod       name of the rod (static)
    channel   which load it is (static)
    offset    (points, 3)   d at the quadrature points, in the section's frame [m]
    slope     (points, 3)   d′ = ∂d/∂s [-]
    """

    rod: str = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    offset: Float[AnyArray, "points 3"]
    slope: Float[AnyArray, "points 3"]

    @staticmethod
    def along(rod: Rod, channel: int, path: Path) -> "PressureLine":
        """The line that runs along a path of `rod`, such as `straight` or `helix`.

        path   from X in [0, 1] to (y, z) [m]; the slope is its derivative over the length

        Raises InputError for a path that is not finite at the rod's points.
        """

        def at(x: Array) -> Array:
            y, z = path(x)
            return jnp.stack([jnp.zeros_like(y), y, z])

        points = jnp.asarray(rod.quadrature.points)
        offset = jax.vmap(at)(points)
        slope = jax.vmap(jax.jacfwd(at))(points) / rod.length
        if known(slope) and not (np.all(np.isfinite(offset)) and np.all(np.isfinite(slope))):
            raise InputError(
                f"PressureLine along {rod.name!r}: expected a path with finite y, z [m] and slope on [0, 1]; "
                "got NaN or infinity"
            )
        return PressureLine(rod.name, channel, offset, slope)

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
