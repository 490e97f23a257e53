"""Contact between two sets of spheres: f = k d n for an overlap d, otherwise zero.

Penalty energy Σ ½ k max(d, 0)², d = R_a + R_b − |p_a − p_b|, over all pairs; normal forces only.
Source: the paper's contact model (eq. 9 there).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.mechanics.kinematics import Motion, at_points, spread
from exosight.mechanics.term import (
    Bound,
    Expansion,
    Term,
    on_frames,
    point_stiffness,
    point_wrench,
    where_each,
    zero,
)
from exosight.mechanics.tree import Tree


class Pressing(NamedTuple):
    """What each point of a contact presses on.

    partner   (points,)        number of the frame, among those of the contact's second side
    place     (points, 3)      in the world [m]
    normal    (points, 3)      unit vector, from the second side to the first, in the world
    force     (points,)        [N]
    rate      (points, dofs)   its derivative
    stiffness (points,)        of what touches [N/m]
    """

    partner: Float[Array, " points"]
    place: Float[Array, "points 3"]
    normal: Float[Array, "points 3"]
    force: Float[AnyArray, " points"]
    rate: Float[Array, "points dofs"]
    stiffness: Float[AnyArray, " points"]


class Spheres(eqx.Module):
    """Spheres centred on frames.

    frames   (body, frame within it) of each (static)
    radius   (spheres,)   [m]
    """

    frames: tuple[tuple[str, int], ...] = eqx.field(static=True)
    radius: Float[AnyArray, " spheres"]

    def index(self, tree: Tree) -> tuple[int, ...]:
        """Each sphere's index among all frames of the tree; InputError if a body has no such frame."""
        own = {body: tree.frame_slice(body) for body in {name for name, _ in self.frames}}
        counts = {body: frames.stop - frames.start for body, frames in own.items()}
        # `tree.frame` takes 50 µs, and is right for the others too.
        return tuple(
            own[body].start + frame if 0 <= frame < counts[body] else tree.frame(body, frame)
            for body, frame in self.frames
        )


def fraction_to_contact(
    overlap: Float[Array, "..."],
    distance: Float[Array, "..."],
    closing: Float[Array, "..."],
    is_open: Bool[Array, "..."],
) -> Float[Array, ""]:
    """Fraction of a step to slightly beyond where the first of some open pairs touches; else infinite.

    overlap    [m]; negative: gap
    distance   what the pair's overlap is small against [m]
    closing    how much nearer the pair comes in the whole step [m]
    """
    ahead = is_open & (closing > 0)
    # 0.3 % of the distance, some 30 µm on a finger: enough for a contact force, too small to be rejected.
    fraction = (0.003 * distance - overlap) / jnp.where(ahead, closing, 1.0)
    return jnp.min(jnp.where(ahead, fraction, jnp.inf))


class SphereContact(Term):
    """Contact of every sphere of `first` with every sphere of `second`.

    stiffness   ()   k [N/m]
    """

    first: Spheres
    second: Spheres
    stiffness: Float[AnyArray, ""]

    def pairs(
        self, tree: Tree, position: Float[Array, "frames 3"]
    ) -> tuple[Float[Array, "first second"], Float[Array, "first second 3"], Float[Array, "first second"]]:
        """Overlap [m] (negative: gap), unit normal from second to first, and distance of centres [m]."""
        a, b = jnp.array(self.first.index(tree)), jnp.array(self.second.index(tree))
        between = position[a][:, None] - position[b][None]
        # Coincident centres have no normal; the tiny offset makes it zero there instead of NaN.
        distance = jnp.sqrt(_dot(between, between) + 1e-30)
        overlap = jnp.asarray(self.first.radius)[:, None] + self.second.radius[None] - distance
        return overlap, between / distance[..., None], distance

    def forces(
        self, tree: Tree, position: Float[Array, "frames 3"]
    ) -> tuple[Float[Array, "first 3"], Float[Array, "second 3"]]:
        """The summed force [N] on each sphere of `first` and on each of `second`, in the world."""
        overlap, normal, _ = self.pairs(tree, position)
        push = self.stiffness * jnp.maximum(overlap, 0.0)[..., None] * normal
        return jnp.sum(push, axis=1), -jnp.sum(push, axis=0)

    def point_frames(self, tree: Tree) -> np.ndarray:
        """The frame of each pair's first sphere."""
        return np.repeat(self.first.index(tree), len(self.second.frames))

    def partner_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the second spheres."""
        return np.array(self.second.index(tree))

    def point_stiffness(self, tree: Tree) -> Float[AnyArray, " points"]:
        """Of each pair [N/m]."""
        return self.stiffness * np.ones(len(self.first.frames) * len(self.second.frames))

    def pressing(self, tree: Tree, motion: Motion) -> Pressing:
        """What each pair presses on."""
        overlap, normal, _ = self.pairs(tree, motion.position)
        a, b = self.point_frames(tree), np.tile(self.partner_frames(tree), len(self.first.frames))
        normal, overlap = normal.reshape(-1, 3), overlap.ravel()
        columns = [at_points(motion.jacobian[i], motion.position[i]) for i in (a, b)]
        closing = -jnp.einsum("pi,pia->pa", normal, columns[0] - columns[1])
        radius = jnp.tile(self.second.radius, len(self.first.frames)) - 0.5 * overlap
        touching = jnp.where(overlap > 0, self.stiffness, 0.0)
        return Pressing(
            jnp.asarray(np.tile(np.arange(len(self.second.frames)) * 1.0, len(self.first.frames))),
            motion.position[b] + radius[:, None] * normal,
            normal,
            self.stiffness * jnp.maximum(overlap, 0.0),
            touching[:, None] * closing,
            touching,
        )

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open pair; the expansion there contains it."""
        overlap, normal, distance = self.pairs(tree, motion.position)
        twist = motion.twist(step)
        moved = twist[:, 3:] + jnp.cross(twist[:, :3], motion.position)
        a, b = jnp.array(self.first.index(tree)), jnp.array(self.second.index(tree))
        closing = -_dot(normal, moved[a][:, None] - moved[b][None])
        return fraction_to_contact(overlap, distance, closing, overlap < 0)

    def bind(self, tree: Tree) -> Bound:
        """Frame indices, and the coordinates that move either side, are bound once."""
        a, b = np.array(self.first.index(tree)), np.array(self.second.index(tree))
        move_a, move_b = tree.moving(a), tree.moving(b)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            position = motion.position
            overlap, n, distance = self.pairs(tree, position)
            depth = jnp.maximum(overlap, 0.0)
            # ∂²E/∂p²: k n nᵀ − (k d / r)(I − n nᵀ) where the pair touches
            bend = self.stiffness * depth / distance
            along = (jnp.where(overlap > 0, self.stiffness, 0.0) + bend)[..., None] * n
            touches = jnp.any(overlap > 0, axis=1)
            each = depth, bend, along
            touching = tuple(where_each(touches, values) for values in each)
            wrench, stiffness = jnp.zeros((tree.frames, 6)), jnp.zeros((tree.frames, 6, 6))
            for frames, sign, normal, (deep, bent, pushed) in (
                (a, -1.0, n, each),
                (b, 1.0, jnp.swapaxes(n, 0, 1), [jnp.swapaxes(values, 0, 1) for values in touching]),
            ):
                force = sign * self.stiffness * (deep[:, None] @ normal)[:, 0]
                k = jnp.swapaxes(pushed, 1, 2) @ normal
                k = k - jnp.sum(bent, axis=1)[:, None, None] * jnp.eye(3)
                parts = point_wrench(position[frames], force), point_stiffness(position[frames], force, k)
                if frames is a:
                    parts = tuple(where_each(touches, part) for part in parts)
                wrench += on_frames(parts[0], frames, tree.frames)
                stiffness += on_frames(parts[1], frames, tree.frames)
            # Coupling of the two sides.
            da, db = motion.points(a, move_a), motion.points(b, move_b)
            moved = sum(n[:, :, i, None] * db[None, :, i] for i in range(3))  # n · db, by pair
            between = jnp.swapaxes(along, 1, 2) @ moved - jnp.einsum("ab,biq->aiq", bend, db)
            between = where_each(touches, between)
            block = -between.reshape(3 * len(a), len(move_b)).T @ da.reshape(3 * len(a), len(move_a))
            coupling = spread(spread(block, move_a, tree.dofs).T, move_b, tree.dofs)
            return zero(tree, loads)._replace(
                energy=0.5 * self.stiffness * jnp.sum(depth**2),
                wrench=wrench,
                stiffness=stiffness,
                hessian=coupling + coupling.T,
            )

        return expand


def _dot(x: Float[Array, "*batch 3"], y: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
    # Written out, it stays one loop with what is around it; a reduction over three numbers does not.
    return x[..., 0] * y[..., 0] + x[..., 1] * y[..., 1] + x[..., 2] * y[..., 2]
