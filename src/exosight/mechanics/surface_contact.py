"""Contact of a soft tube with tapered solids or a plane: a traction t = k d n a length of tube, overlap d.

The tube is what spheres of its radius sweep along a rod's axis, round ends included; a solid is the convex
hull of two spheres on a body's axis, whose distance has a closed form. The energy ∫ ½ k max(d, 0)² ds over
the rod's arc length is integrated at its quadrature points, so refining the rod does not change the force.
Normal forces only.

With axis x, s = (r₀ − r₁)/ℓ and ρ the distance from the axis, the place on the axis that is nearest to a
point, seen along the normal of the surface, is t = x − s ρ/√(1 − s²), limited to [0, ℓ]; the distance from
the surface is |p − (t, 0, 0)| − (r₀ − s t).

Solids that meet make an edge where they bend towards the tube. There a fillet of width w joins the two
overlaps d₁ ≥ d₂ that are largest at a point, d = d₁ + w h²/4 with h = max(1 − (d₁ − d₂)/w, 0), and the
force is shared by 1 − h/2 and h/2; without it, poses at rest on the edge would have no derivative.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.contact import Pressing, fraction_to_contact
from exosight.mechanics.kinematics import Motion, at_points, spread
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import (
    Bound,
    Configuration,
    Expansion,
    Term,
    on_frames,
    point_stiffness,
    point_wrench,
    square,
    where_each,
    zero,
)
from exosight.mechanics.tree import Tree

TIP = 0.5
"""Length of rod that its round end counts for, in radii: the secant of Hertz's sphere at 0.14 radii, of which
the force is 4/3 E* √r d^1.5, against the line's π/4 E* d a length."""

FILLET = 0.02
"""Width of the fillets between solids, in their mean radius."""

NOWHERE = 1e3
"""Stands for the distance [m] of what cannot touch."""


def line_stiffness(young: float, poisson: float) -> float:
    """π/4 · E/(1 − ν²): force a length and a depth of a long cylinder pressed on a flat rigid body [N/m²].

    Source: V. L. Popov, Contact Mechanics and Friction (2010), section 5.2. It neglects that a line contact
    also depends, by a logarithm, on how thick the body is.
    """
    return np.pi / 4 * young / (1 - poisson**2)


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

    @property
    def starts(self) -> Float[Array, " solids"]:
        """Distance of each one's beginning from that of the first, along a straight chain of them [m]."""
        length = jnp.asarray(self.length)
        return jnp.cumsum(length) - length


class Plane(eqx.Module):
    """A plane with a half-space behind it.

    body     that it is fixed to, or None: the world (static)
    point    (3,)   on it, in that body's first frame [m]
    normal   (3,)   out of it, of any length
    """

    body: str | None = eqx.field(static=True)
    point: Float[AnyArray, "3"]
    normal: Float[AnyArray, "3"]

    def index(self, tree: Tree) -> np.ndarray:
        """The body's first frame among all of the tree; of the world, none."""
        return np.array([] if self.body is None else [tree.frame(self.body, 0)], int)

    @property
    def starts(self) -> Float[Array, " frames"]:
        """As of `Solids`: a plane has one place, 0."""
        return jnp.zeros(0 if self.body is None else 1)

    def in_world(self, pose: Float[Array, "frames 4 4"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Its point [m] and unit normal there, with the pose of its body's frame, if it has one."""
        normal = jnp.asarray(self.normal) / jnp.sqrt(jnp.sum(jnp.asarray(self.normal) ** 2))
        if self.body is None:
            return jnp.asarray(self.point), normal
        turn = pose[0, :3, :3]
        return pose[0, :3, 3] + turn @ self.point, turn @ normal


class Touch(NamedTuple):
    """For points of a tube, a solid or a plane that each overlaps.

    which      (points, solids)   1 for that solid, else 0
    overlap    (points,)          [m]; negative: gap
    normal     (points, 3)        unit vector out of the solid, in the world
    place      (points,)          t, along the solid's axis [m]
    distance   (points,)          of the point from that place; of a plane, the tube's radius [m]
    bent       (points,)          curvature across the tangent of the surface through the point [1/m]
    tangent    (points, 3)        unit vector along the solid's side, in the world; zero at its round ends
    """

    which: Float[Array, "points solids"]
    overlap: Float[Array, " points"]
    normal: Float[Array, "points 3"]
    place: Float[Array, " points"]
    distance: Float[Array, " points"]
    bent: Float[Array, " points"]
    tangent: Float[Array, "points 3"]


class Contacts(NamedTuple):
    """For points of a tube, the two solids that each overlaps most, and both as one.

    touches    of the first and of the second
    share      (points,) each   of the force on the point
    overlap    (points,)        with the fillet [m]; negative: gap
    """

    touches: tuple[Touch, Touch]
    share: tuple[Float[Array, " points"], Float[Array, " points"]]
    overlap: Float[Array, " points"]


def contacts(
    solids: Solids | Plane,
    pose: Float[Array, "frames 4 4"],
    point: Float[Array, "points 3"],
    radius: Float[AnyArray, " points"],
) -> Contacts:
    """What spheres around points overlap, with poses of the solids' frames."""
    if isinstance(solids, Plane):
        return _on_plane(solids, pose, point, jnp.asarray(radius))
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
    outward = jnp.concatenate([jnp.zeros((*away.shape, 1)), local[..., 1:] / away[..., None]], axis=-1)
    axis = np.array([1.0, 0.0, 0.0])
    cosine, sine = (away / distance)[..., None], (along / distance)[..., None]
    normal, tangent = sine * axis + cosine * outward, cosine * axis - sine * outward

    def largest(of: Float[AnyArray, "points solids"]) -> Touch:
        most = of == jnp.max(of, axis=1, keepdims=True)
        which = jnp.where(most & (jnp.cumsum(most, axis=1) == 1), 1.0, 0.0)
        single = [jnp.sum(which * values, axis=1) for values in (of, place, distance)]
        world = [
            jnp.einsum("ps,sij,psj->pi", weight, turn, values)
            for weight, values in ((which, normal), (jnp.where(place == free, which, 0.0), tangent))
        ]
        return Touch(which, single[0], world[0], single[1], single[2], 1 / single[2], world[1])

    first = largest(overlap)
    second = largest(jnp.where(first.which > 0, -NOWHERE, overlap))
    width = _width(solids)
    near = jnp.maximum(1 - (first.overlap - second.overlap) / width, 0.0)
    return Contacts((first, second), (1 - 0.5 * near, 0.5 * near), first.overlap + 0.25 * width * near**2)


def _on_plane(
    plane: Plane,
    pose: Float[Array, "frames 4 4"],
    point: Float[Array, "points 3"],
    radius: Float[Array, " points"],
) -> Contacts:
    """It is flat and has no edges: the first of two touches carries the whole force."""
    origin, normal = plane.in_world(pose)
    none = jnp.zeros(len(point))
    overlap = radius - (point - origin) @ normal
    normals = jnp.broadcast_to(normal, point.shape)
    touch = Touch(jnp.ones((len(point), len(pose))), overlap, normals, none, radius, none, 0.0 * point)
    return Contacts((touch, touch), (none + 1.0, none), overlap)


def _width(solids: Solids | Plane) -> Float[Array, ""]:
    return jnp.ones(()) if isinstance(solids, Plane) else FILLET * jnp.mean(jnp.asarray(solids.radius))


class SolidContact(Term):
    """Contact of a tube with solids, or with a plane.

    stiffness   ()   k, force a length of tube and a depth [N/m²]
    """

    first: Tube
    second: Solids | Plane
    stiffness: Float[AnyArray, ""]

    def frames(self, tree: Tree) -> list[int]:
        """The tube's points, then the solids."""
        return [*self.first.frames(tree).tolist(), *self.second.index(tree).tolist()]

    def contacts(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Contacts:
        """What the tube's points overlap, at poses of all frames."""
        points = pose[self.first.frames(tree), :3, 3]
        return contacts(self.second, pose[self.second.index(tree)], points, self.first.radius)

    def pressure(self, tree: Tree, at: Contacts) -> Float[AnyArray, " points"]:
        """The force on each point, all solids together [N]."""
        return self.point_stiffness(tree) * jnp.maximum(at.overlap, 0.0)

    def point_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the tube's points."""
        return self.first.frames(tree)

    def partner_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the solids."""
        return self.second.index(tree)

    def point_stiffness(self, tree: Tree) -> Float[AnyArray, " points"]:
        """Of the length of tube that each point stands for [N/m]."""
        return self.stiffness * self.first.lengths(tree)

    def pressing(self, tree: Tree, motion: Motion) -> Pressing:
        """What each point of the tube presses on: the solid that it overlaps most."""
        at = self.contacts(tree, motion.pose)
        first = at.touches[0]
        place = motion.position[self.first.frames(tree)]
        own = at_points(motion.jacobian[self.first.frames(tree)], place)
        solids = motion.jacobian[self.second.index(tree)]
        closing = jnp.zeros(own.shape[::2])
        for touch, share in zip(at.touches, at.share, strict=True):
            other = at_points(jnp.einsum("ps,sij->pij", touch.which, solids), place)
            closing -= jnp.einsum("pi,pia->pa", share[:, None] * touch.normal, own - other)
        touching = jnp.where(at.overlap > 0, self.point_stiffness(tree), 0.0)
        return Pressing(
            first.which @ np.arange(float(len(solids))),
            place - (self.first.radius - 0.5 * at.overlap)[:, None] * first.normal,
            first.normal,
            self.pressure(tree, at),
            touching[:, None] * closing,
        )

    def energy(self, tree: Tree, at: Configuration, loads: Float[Array, " loads"]) -> Float[Array, ""]:
        """∫ ½ k max(d, 0)² ds."""
        count = len(self.first.frames(tree))
        found = contacts(self.second, at.pose[count:], at.position[:count], self.first.radius)
        return 0.5 * jnp.sum(self.pressure(tree, found) * jnp.maximum(found.overlap, 0.0))

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open point; the expansion there contains it."""
        at = self.contacts(tree, motion.pose)
        (nearest, _), twist = at.touches, motion.twist(step)
        relative = twist[self.first.frames(tree)] - nearest.which @ twist[self.second.index(tree)]
        position = motion.position[self.first.frames(tree)]
        moved = relative[:, 3:] + jnp.cross(relative[:, :3], position)
        closing = -jnp.sum(nearest.normal * moved, axis=1)
        return fraction_to_contact(at.overlap, nearest.distance, closing, at.overlap < 0)

    def bind(self, tree: Tree) -> Bound:
        """The energy depends on the motion of each point against its solids.

        With the twists p of a point and c of a solid, exp(c)⁻¹ exp(p) ≈ exp(p − c − ½ [c, p]), so by p − c
        the stiffness S is that of a point at rest, and p and c are coupled by −(S + ½ C(W)) for its wrench
        W; two solids of one point by the product of their wrenches.
        """
        a, b = self.first.frames(tree), self.second.index(tree)
        move_a, move_b = tree.moving(a), tree.moving(b)
        weight = self.point_stiffness(tree)
        width = _width(self.second)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            at, position, jacobian = self.contacts(tree, motion.pose), motion.position[a], motion.jacobian
            of_points = jacobian[a][:, :, np.array(move_a, int)]
            of_solids = jacobian[b][:, :, np.array(move_b, int)]
            push = self.pressure(tree, at)
            touching = jnp.where(at.overlap > 0, weight, 0.0)
            fillet = jnp.where(at.share[1] > 0, 0.5 * push / width, 0.0)
            units = [point_wrench(position, touch.normal) for touch in at.touches]
            factor = touching * at.share[0] * at.share[1] - fillet
            both = factor[:, None, None] * units[0][:, :, None] * units[1][:, None, :]
            wrench, stiffness = jnp.zeros((tree.frames, 6)), jnp.zeros((tree.frames, 6, 6))
            block = jnp.zeros((len(move_a), len(move_b)))
            touches = at.overlap > 0
            two = touches & (at.share[1] > 0)
            for counts, touch, share, unit, cross in zip(
                (touches, two), at.touches, at.share, units, (jnp.swapaxes(both, 1, 2), both), strict=True
            ):
                along = square(touch.normal) + square(touch.tangent) - jnp.eye(3)
                bend = (share * push * touch.bent)[:, None, None] * along
                own = point_stiffness(position, -(share * push)[:, None] * touch.normal, bend)
                own += (touching * share**2 + fillet)[:, None, None] * square(unit)
                force = -(share * push)[:, None] * unit
                on_points = where_each(counts, force)
                wrench += on_frames(on_points, a, tree.frames)
                wrench -= on_frames(touch.which.T @ on_points, b, tree.frames)
                stiffness += on_frames(where_each(counts, own + cross), a, tree.frames)
                on_solids = jnp.einsum("ps,pij->sij", touch.which, where_each(counts, own))
                stiffness += on_frames(on_solids, b, tree.frames)
                of_solid = jnp.einsum("ps,sik->pik", touch.which, of_solids)
                coupled = (own + cross + 0.5 * lie.coad(force)) @ of_solid
                block -= jnp.einsum("pia,pib->ab", of_points, where_each(counts, coupled))
            which = [touch.which for touch in at.touches]
            pairs = jnp.einsum("ps,pz,pij->szij", *which, where_each(two, both))
            between = jnp.einsum("sia,szij,zjb->ab", of_solids, pairs, of_solids)
            hessian = spread(spread(block.T, move_a, tree.dofs).T, move_b, tree.dofs)
            hessian += spread(spread(between.T, move_b, tree.dofs).T, move_b, tree.dofs)
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(push * jnp.maximum(at.overlap, 0.0)),
                wrench=wrench,
                stiffness=stiffness,
                hessian=hessian + hessian.T,
            )

        return expand
