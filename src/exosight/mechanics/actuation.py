"""Actuators whose work is that of a line along a rod."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.errors import InputError
from exosight.mechanics.energy import Bound, Expansion, Term, zero
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod


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

    def bind(self, robot: Robot) -> Bound:
        """∂y/∂q is constant and bound once."""
        rod = robot[self.rod]
        if not isinstance(rod, Rod):
            raise InputError(f"PressureLine: {self.rod!r} is a link; a line runs along a rod")
        columns = robot.dof_slice(self.rod)
        start = columns.start + rod.joint.dofs
        weights = rod.weights()
        phi = jnp.asarray(rod.functions(rod.quadrature.points)) * rod.scale[:, None]
        angular = _rows(phi, rod.rows, (0, 1, 2))
        linear = _rows(phi, rod.rows, (3, 4, 5))
        dy = linear + jnp.cross(angular, self.offset[:, :, None], axis=1)  # (points, 3, size)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            xi = motion.strain[self.rod]
            y = xi[:, 3:] + jnp.cross(xi[:, :3], self.offset) + self.slope
            stretch = jnp.sqrt(jnp.sum(y**2, axis=-1) + 1e-30)
            t = y / stretch[:, None]
            u = loads[self.channel]
            none = zero(robot, loads)
            inside = slice(start, start + dy.shape[-1])
            lengthening = jnp.einsum("pkq,pk,p->q", dy, t, weights)
            across = dy - t[:, :, None] * jnp.einsum("pk,pkq->pq", t, dy)[:, None]
            bending = jnp.einsum("pka,p,pkb->ab", dy, weights / stretch, across)
            length = jnp.sum(weights * stretch)
            return none._replace(
                energy=-u * length,
                gradient=none.gradient.at[inside].set(-u * lengthening),
                hessian=none.hessian.at[inside, inside].set(-u * bending),
                load_energy=none.load_energy.at[self.channel].set(-length),
                load_gradient=none.load_gradient.at[self.channel, inside].set(-lengthening),
            )

        return expand


def _rows(phi: Float[Array, "points enabled size"], rows: tuple[int, ...], wanted: tuple[int, ...]) -> Array:
    """Rows `wanted` of the full strain basis; zero where a strain is not enabled."""
    none = jnp.zeros_like(phi[:, 0])
    return jnp.stack([phi[:, rows.index(r)] if r in rows else none for r in wanted], axis=1)
