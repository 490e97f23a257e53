"""A bushing: a stiff or soft spring between two frames, which closes a loop."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.term import Bound, Expansion, Term, on_frames, zero
from exosight.mechanics.tree import Tree

Frame = tuple[str, int]
"""A body and the number of a frame of it (−1: its last)."""


class Bushing(Term):
    """½ eᵀ diag(k) e with e = log(rest⁻¹ g_a⁻¹ g_b): holds frame b at its rest pose relative to frame a.

    A bushing between two bodies of a tree closes a loop. It is a spring, not a constraint, so that
    every equilibrium is a minimum of one energy and its stability is defined, without multipliers
    and their saddle point. The price is a gap of force/stiffness: 1e4 times as stiff as
    the parts it closes the loop to 1e-4 of their deflection. Higher stiffness is not always better: from 1e6
    on, round-off of the gap keeps the residual above 1e-10, and the problem becomes ill-conditioned.
    A stiffness of zero frees a direction: a pin about y is (0 about y, and a large one for the rest).

    first, second   (body, frame within it) (static)
    stiffness       (6,)     k about and along the axes of b's rest frame [N m/rad ×3; N/m ×3]
    rest            (4, 4)   b's rest pose relative to a [m]; by default they coincide

    Turning by more than half a turn from rest, the energy jumps. Raises InputError for a negative stiffness.
    """

    first: Frame = eqx.field(static=True)
    second: Frame = eqx.field(static=True)
    stiffness: Float[Array, "6"]
    rest: Float[Array, "4 4"]

    def __init__(
        self,
        first: Frame,
        second: Frame,
        stiffness: Float[AnyArray, "6"],
        rest: Float[AnyArray, "4 4"] | None = None,
    ) -> None:
        numbers = np.asarray(stiffness, dtype=float)
        if numbers.shape != (6,) or not (np.all(numbers >= 0) and np.all(np.isfinite(numbers))):
            raise InputError(
                f"Bushing {first}–{second}, stiffness: expected 6 finite numbers of at least 0, "
                f"N m/rad about x, y, z and N/m along them, got {stiffness}"
            )
        self.first, self.second = first, second
        self.stiffness = jnp.asarray(numbers)
        self.rest = jnp.eye(4) if rest is None else jnp.asarray(rest, dtype=float)

    def bind(self, tree: Tree) -> Bound:
        """Frame indices, and the coordinates that move either, are bound once; InputError if they are one.

        With e at rest's axes and T the left Jacobian, the wrench on b there is w = T⁻ᵀ diag(k) e and its
        stiffness the symmetric part of ∂w/∂e T⁻¹. Moving a by t_a and b by t_b is, to second order, moving b
        alone by t_b − t_a − ½ [t_a, t_b].
        """
        a, b = tree.frame(*self.first), tree.frame(*self.second)
        if a == b:
            raise InputError(f"Bushing: expected two frames, got {self.first} twice")
        both = np.array([a, b])

        def wrench(gap: Array) -> Array:
            return lie.tangent_inverse(gap).T @ (self.stiffness * gap)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            to_rest = lie.inverse(motion.pose[a] @ self.rest)
            gap = lie.log(to_rest @ motion.pose[b])
            stiffness = jax.jacfwd(wrench)(gap) @ lie.tangent_inverse(gap)
            from_world = lie.adjoint(to_rest)
            w = from_world.T @ wrench(gap)
            k = from_world.T @ (0.5 * (stiffness + stiffness.T)) @ from_world
            jacobian = motion.jacobian[both]
            coupling = -jacobian[1].T @ (k + 0.5 * lie.coad(w)) @ jacobian[0]
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(self.stiffness * gap**2),
                wrench=on_frames(jnp.stack([-w, w]), both, tree.frames),
                stiffness=on_frames(jnp.stack([k, k]), both, tree.frames),
                hessian=coupling + coupling.T,
            )

        return expand
