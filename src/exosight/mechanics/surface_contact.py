"""Contact of a soft tube with tapered solids: a traction t = k d n a length of the tube, for an overlap d.

The tube is what spheres of its radius sweep along a rod's axis, round ends included; a solid is the convex hull
of two spheres on a body's axis, whose distance has a closed form. The energy ∫ ½ k max(d, 0)² ds over the
rod's arc length is integrated at its quadrature points, each against the solid that it overlaps most, so
refining the rod does not change the force. Normal forces only.

With axis x, s = (r₀ − r₁)/ℓ and ρ the distance from the axis, the place on the axis that is nearest to a point,
seen along the normal of the surface, is t = x − s ρ/√(1 − s²), limited to [0, ℓ]; the distance from the surface is
|p − (t, 0, 0)| − (r₀ − s t).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.kinematics import Motion, spread
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import (
    Bound,
    Configuration,
    Expansion,
    Term,
    on_frames,
    point_stiffness,
    point_wrench,
    zero,
)
from exosight.mechanics.tree import Tree

TIP = 0.5
"""Length of rod that its round end counts for, in radii: the secant of Hertz's sphere at 0.14 radii, of which
the force is 4/3 E* √r d^1.5, against the line's π/4 E* d a length."""


class Tube(eqx.Module):
    """A tube around a rod.

    rod      its name (static)
    radius   (points,)   at the rod's quadrature points [m]
    """

    rod: str = eqx.field(static=True)
    radius: Float[AnyArray, " points"]

    def frames(self, tree: Tree) -> np.ndarray:
        """The rod's frames among all of the tree."""
        own = tree.frame_slice(self.rod)
        return np.arange(own.start, own.stop)

    def lengths(self, tree: Tree) -> Float[AnyArray, " points"]:
        """The length of tube that each point stands for, its round end with the last one [m]."""
        rod = tree[self.rod]
        assert isinstance(rod, Rod)
        last = np.zeros(rod.frames)
        last[-1] = TIP
        return rod.weights() + last * self.radius


class Solids(eqx.Module):
    """Tapered solids with round ends, along the x axes of frames.

    frames   (body, frame within it) where each begins (static)
    length   (solids,)     between the centres of its ends [m]
    radius   (solids, 2)   of its ends [m]; they differ by less than the length
    """

    frames: tuple[tuple[str, int], ...] = eqx.field(static=True)
    length: Float[AnyArray, " solids"]
    radius: Float[AnyArray, "solids 2"]

    def index(self, tree: Tree) -> np.ndarray:
        """The frames among all of the tree; InputError if a body has no such frame."""
        return np.array([tree.frame(body, frame) for body, frame in self.frames])


class Nearest(NamedTuple):
    """For points of a tube, the solid that each overlaps most.

    which      (points, solids)   1 for that solid, else 0
    overlap    (points,)          [m]; negative: gap
    normal     (points, 3)        unit vector out of the solid, in the world
    place      (points,)          t, along the solid's axis [m]
    distance   (points,)          of the point from that place [m]
    tangent    (points, 3)        unit vector along the solid's side, in the world; zero at its round ends
    """

    which: Float[Array, "points solids"]
    overlap: Float[Array, " points"]
    normal: Float[Array, "points 3"]
    place: Float[Array, " points"]
    distance: Float[Array, " points"]
    tangent: Float[Array, "points 3"]


def nearest(
    solids: Solids,
    pose: Float[Array, "solids 4 4"],
    point: Float[Array, "points 3"],
    radius: Float[AnyArray, " points"],
) -> Nearest:
    """The solid that spheres overlap most, with poses of the solids' frames."""
    turn = pose[:, :3, :3]
    local = jnp.einsum("sji,psj->psi", turn, point[:, None] - pose[None, :, :3, 3])
    # On the axis the direction away from it is undefined; the tiny offset keeps its derivatives finite.
    away = jnp.sqrt(local[..., 1] ** 2 + local[..., 2] ** 2 + 1e-30)
    start = jnp.asarray(solids.radius)[:, 0]
    slope = (start - solids.radius[:, 1]) / solids.length
    free = local[..., 0] - slope / jnp.sqrt(1 - slope**2) * away
    place = jnp.clip(free, 0.0, solids.length)
    along = local[..., 0] - place
    distance = jnp.sqrt(along**2 + away**2)
    overlap = radius[:, None] - distance + start - slope * place
    most = overlap == jnp.max(overlap, axis=1, keepdims=True)
    which = jnp.where(most & (jnp.cumsum(most, axis=1) == 1), 1.0, 0.0)
    side = jnp.where(place == free, which, 0.0)
    outward = jnp.concatenate([jnp.zeros((*away.shape, 1)), local[..., 1:] / away[..., None]], axis=-1)
    axis = np.array([1.0, 0.0, 0.0])
    cosine, sine = (away / distance)[..., None], (along / distance)[..., None]
    normal, tangent = sine * axis + cosine * outward, cosine * axis - sine * outward

    def chosen(weight: Array, values: Array) -> Array:
        return jnp.einsum("ps,sij,psj->pi", weight, turn, values)

    def single(values: Array) -> Array:
        return jnp.sum(which * values, axis=1)

    return Nearest(
        which, single(overlap), chosen(which, normal), single(place), single(distance), chosen(side, tangent)
    )


class SolidContact(Term):
    """Contact of a tube with solids.

    stiffness   ()   k, force a length of tube and a depth [N/m²]
    """

    first: Tube
    second: Solids
    stiffness: Float[AnyArray, ""]

    def frames(self, tree: Tree) -> list[int]:
        """The tube's points, then the solids."""
        return [*self.first.frames(tree).tolist(), *self.second.index(tree).tolist()]

    def nearest(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Nearest:
        """What the tube's points touch, at poses of all frames."""
        points = pose[self.first.frames(tree), :3, 3]
        return nearest(self.second, pose[self.second.index(tree)], points, self.first.radius)

    def forces(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> tuple[Float[Array, "points 3"], Nearest]:
        """The force on the tube at each of its points, in the world [N], and where it acts."""
        at = self.nearest(tree, pose)
        push = self.stiffness * self.first.lengths(tree) * jnp.maximum(at.overlap, 0.0)
        return push[:, None] * at.normal, at

    def energy(self, tree: Tree, at: Configuration, loads: Float[Array, " loads"]) -> Float[Array, ""]:
        """∫ ½ k max(d, 0)² ds."""
        count = len(self.first.frames(tree))
        found = nearest(self.second, at.pose[count:], at.position[:count], self.first.radius)
        weight = self.stiffness * self.first.lengths(tree)
        return 0.5 * jnp.sum(weight * jnp.maximum(found.overlap, 0.0) ** 2)

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open point; the expansion there contains it."""
        at = self.nearest(tree, motion.pose)
        twist = motion.twist(step)
        relative = twist[self.first.frames(tree)] - at.which @ twist[self.second.index(tree)]
        position = motion.position[self.first.frames(tree)]
        moved = relative[:, 3:] + jnp.cross(relative[:, :3], position)
        closing = -jnp.sum(at.normal * moved, axis=1)
        ahead = (at.overlap < 0) & (closing > 0)
        # As in contact of spheres: enough for a contact force, too small to be rejected.
        fraction = (0.003 * at.distance - at.overlap) / jnp.where(ahead, closing, 1.0)
        return jnp.min(jnp.where(ahead, fraction, jnp.inf))

    def bind(self, tree: Tree) -> Bound:
        """The energy depends on the motion of each point against its solid: a wrench, and the opposite one.

        With twists a and b of the two, exp(b)⁻¹ exp(a) ≈ exp(a − b − ½ [b, a]) moves the point in the
        solid's frame, so both have the same stiffness S, and their coupling is −(S + ½ C(W)).
        """
        a, b = self.first.frames(tree), self.second.index(tree)
        move_a, move_b = tree.moving(a), tree.moving(b)
        weight = self.stiffness * self.first.lengths(tree)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            at, position, jacobian = self.nearest(tree, motion.pose), motion.position[a], motion.jacobian
            push = weight * jnp.maximum(at.overlap, 0.0)
            bend = (push / at.distance)[:, None, None]
            touching = jnp.where(at.overlap > 0, weight, 0.0)[:, None, None]
            across, along = _square(at.normal), _square(at.tangent)
            k = (touching + bend) * across - bend * (jnp.eye(3) - along)
            force = -push[:, None] * at.normal
            wrench, stiffness = point_wrench(position, force), point_stiffness(position, force, k)
            of_solid = jnp.einsum("ps,sik->pik", at.which, jacobian[b][:, :, np.array(move_b, int)])
            coupled = (stiffness + 0.5 * lie.coad(wrench)) @ of_solid
            block = -jnp.einsum("pia,pib->ab", jacobian[a][:, :, np.array(move_a, int)], coupled)
            coupling = spread(spread(block.T, move_a, tree.dofs).T, move_b, tree.dofs)
            frames = np.concatenate([a, b])
            wrenches = jnp.concatenate([wrench, -at.which.T @ wrench])
            stiffnesses = jnp.concatenate([stiffness, jnp.einsum("ps,pij->sij", at.which, stiffness)])
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(weight * jnp.maximum(at.overlap, 0.0) ** 2),
                wrench=on_frames(wrenches, frames, tree.frames),
                stiffness=on_frames(stiffnesses, frames, tree.frames),
                hessian=coupling + coupling.T,
            )

        return expand


def _square(x: Float[Array, "points 3"]) -> Float[Array, "points 3 3"]:
    """x xᵀ of each."""
    return x[:, :, None] * x[:, None, :]
