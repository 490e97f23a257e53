"""Damping of contacts after Hunt and Crossley: a normal force k δ (1 + d dδ/dt) for an overlap δ, at least 0.

The elastic part is the contact's own. With the linear law, a mass that arrives with speed v leaves with e v,

    d v (1 + e) = log((1 + d v) / (1 − d e v)),

whatever its mass and the stiffness; e ≈ 1 − ⅔ d v at low speeds. Friction follows the elastic part.

Source: K. H. Hunt, F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact,
Journal of Applied Mechanics 42, 1975, doi 10.1115/1.3423596.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray, Number, floats, known
from exosight.errors import InputError
from exosight.mechanics.friction import WithPoints
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.term import Bound, Resistance, Term, zero
from exosight.mechanics.tree import Tree


class ContactDamping(Term):
    """Damping of a contact, which is a term of its own.

    contact       whose overlaps it follows
    coefficient   ()   d [s/m]
    """

    contact: WithPoints
    coefficient: Float[AnyArray, ""]

    def __init__(self, contact: WithPoints, coefficient: Number) -> None:
        if known(coefficient) and not 0 <= coefficient < np.inf:
            raise InputError(f"contact damping: expected finite, at least 0 s/m, got {coefficient}")
        self.contact, self.coefficient = contact, floats(coefficient)

    def bind(self, tree: Tree) -> Bound:
        """It stores no energy."""
        return lambda q, motion, loads: zero(tree, loads)

    def resistance(self, tree: Tree, motion: Motion, v: Float[Array, " dofs"]) -> Resistance:
        """k δ d dδ/dt at each point; where the contact would pull, what takes away its elastic force."""
        now = self.contact.pressing(tree, motion)
        deepening = now.rate / jnp.where(now.stiffness > 0, now.stiffness, 1.0)[:, None]  # ∂δ/∂q
        part = self.coefficient * (deepening @ v)
        slope = jnp.where(part > -1, self.coefficient * now.force, 0.0)
        part = jnp.maximum(part, -1.0)
        return Resistance(
            (part * now.force) @ deepening,
            deepening.T @ (slope[:, None] * deepening),
            deepening.T @ (part[:, None] * now.rate),
        )
