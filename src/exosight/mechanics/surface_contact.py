"""Contact of a soft tube with tapered solids or a plane: a traction t = k d n a length of tube, overlap d.

The tube is what spheres of its radius sweep along a rod's axis, round ends included; a solid is the convex
hull of two spheres on a body's axis, whose distance has a closed form. The energy ∫ ½ k max(d, 0)² ds over
the rod's arc length is integrated at places between the rod's points (`Samples`), so refining the rod does
not change the force. Normal forces only.

With axis x, s = (r₀ − r₁)/ℓ and ρ the distance from the axis, the place on the axis that is nearest to a
point, seen along the normal of the surface, is t = x − s ρ/√(1 − s²), limited to [0, ℓ]; the distance from
the surface is |p − (t, 0, 0)| − (r₀ − s t).

Solids that meet make an edge where they bend towards the tube. There a fillet of width w joins the two
overlaps d₁ ≥ d₂ that are largest at a point, d = d₁ + w h²/4 with h = max(1 − (d₁ − d₂)/w, 0), and the
force is shared by 1 − h/2 and h/2; without it, poses at rest on the edge would have no derivative.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.contact import Pressing, fraction_to_contact
from exosight.mechanics.kinematics import Motion, at_points, spread
from exosight.mechanics.surfaces import NOWHERE, SAMPLES, Plane, Samples, Solids, Tube
from exosight.mechanics.term import (
    Bound,
    Configuration,
    Expansion,
    Term,
    on_frames,
    point_wrench,
    where_each,
    zero,
)
from exosight.mechanics.tree import Tree

FILLET = 0.02
"""Width of the fillets between solids, in their mean radius."""


class Touch(NamedTuple):
    """For points of a tube, a solid or a plane that each overlaps.

    which      (points, solids)   1 for that solid, else 0
    overlap    (points,)          [m]; negative: gap
    normal     (points, 3)        unit vector out of the solid, in the world
    place      (points,)          t, along the solid's axis [m]
    distance   (points,)          of the point from that place; of a plane, the tube's radius [m]
    bent       (points,)          curvature across the solid of the surface through the point [1/m]
    tangent    (points, 3)        unit vector along the solid on that surface, in the world; of a plane, zero
    on_end     (points,)          whether it touches a round end, which is bent along the solid too
    """

    which: Float[Array, "points solids"]
    overlap: Float[Array, " points"]
    normal: Float[Array, "points 3"]
    place: Float[Array, " points"]
    distance: Float[Array, " points"]
    bent: Float[Array, " points"]
    tangent: Float[Array, "points 3"]
    on_end: Bool[Array, " points"]


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
    turn, start = pose[:, :3, :3], jnp.asarray(solids.radius)[:, 0]
    local = jnp.einsum("sji,psj->psi", turn, point[:, None] - pose[None, :, :3, 3])
    slope = (start - solids.radius[:, 1]) / solids.length
    tilt, length = slope / jnp.sqrt(1 - slope**2), jnp.asarray(solids.length)
    place, away, _ = _on_axis(local, tilt, length)
    overlap = radius[:, None] - jnp.sqrt((local[..., 0] - place) ** 2 + away**2) + start - slope * place

    def largest(of: Float[AnyArray, "points solids"]) -> Touch:
        most = of == jnp.max(of, axis=1, keepdims=True)
        which = jnp.where(most & (jnp.cumsum(most, axis=1) == 1), 1.0, 0.0)
        own = jnp.einsum("ps,psi->pi", which, local)
        place, away, on_end = _on_axis(own, which @ tilt, which @ length)
        along = own[:, 0] - place
        distance = jnp.sqrt(along**2 + away**2)
        cosine, sine = (away / distance)[:, None], (along / distance)[:, None]
        outward = jnp.concatenate([jnp.zeros((len(own), 1)), own[:, 1:] / away[:, None]], axis=1)
        axis, frame = np.array([1.0, 0.0, 0.0]), jnp.einsum("ps,sij->pij", which, turn)
        normal, tangent = (
            jnp.einsum("pij,pj->pi", frame, direction)
            for direction in (sine * axis + cosine * outward, cosine * axis - sine * outward)
        )
        gap = jnp.sum(which * of, axis=1)
        return Touch(which, gap, normal, place, distance, 1 / distance, tangent, on_end)

    first = largest(overlap)
    second = largest(jnp.where(first.which > 0, -NOWHERE, overlap))
    width = _width(solids)
    near = jnp.maximum(1 - (first.overlap - second.overlap) / width, 0.0)
    return Contacts((first, second), (1 - 0.5 * near, 0.5 * near), first.overlap + 0.25 * width * near**2)


def _on_axis(
    local: Float[Array, "*points 3"], tilt: Float[AnyArray, "*#points"], length: Float[AnyArray, "*#points"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"], Bool[Array, "*points"]]:
    """Place on a solid's axis, distance from the axis [m], and whether that place is an end of it."""
    # On the axis the direction away from it is undefined; the tiny offset keeps its derivatives finite.
    away = jnp.sqrt(local[..., 1] ** 2 + local[..., 2] ** 2 + 1e-30)
    free = local[..., 0] - tilt * away
    place = jnp.clip(free, 0.0, length)
    return place, away, place != free


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
    ones = jnp.ones((len(point), len(pose)))
    touch = Touch(ones, overlap, normals, none, radius, none, 0.0 * point, none > 0)
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
        """The rod's points, then the solids."""
        return [*self.first.frames(tree).tolist(), *self.second.index(tree).tolist()]

    def contacts(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Contacts:
        """What the tube's samples overlap, at poses of all frames."""
        return self._overlaps(
            self.samples(tree), pose[self.first.frames(tree)], pose[self.second.index(tree)]
        )

    def pressure(self, tree: Tree, at: Contacts) -> Float[AnyArray, " samples"]:
        """The force on each sample, all solids together [N]."""
        return self.stiffness * self.samples(tree).length * jnp.maximum(at.overlap, 0.0)

    def samples(self, tree: Tree) -> Samples:
        """Where on the tube contact is integrated."""
        return self.first.samples(tree, SAMPLES)

    def pushes(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Float[AnyArray, " samples"]:
        """The same at poses of all frames."""
        return self.pressure(tree, self.contacts(tree, pose))

    def point_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the rod's points."""
        return self.first.frames(tree)

    def partner_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the solids."""
        return self.second.index(tree)

    def point_stiffness(self, tree: Tree) -> Float[AnyArray, " points"]:
        """Of the length of tube that each of the rod's points stands for [N/m]."""
        samples = self.samples(tree)
        return self.stiffness * (samples.lumping @ samples.length)

    def pressing(self, tree: Tree, motion: Motion) -> Pressing:
        """What each of the rod's points presses on, the solid that it is nearest to, and its share of the
        force of the samples on either side."""
        a, b, samples = self.first.frames(tree), self.second.index(tree), self.samples(tree)
        place, radius = motion.position[a], jnp.asarray(self.first.radius)
        own = contacts(self.second, motion.pose[b], place, radius)
        at, nearest = self._overlaps(samples, motion.pose[a], motion.pose[b]), own.touches[0]
        levers = samples.levers(motion.pose[a])
        rows = _rows(samples, levers, at, motion.jacobian[a], motion.jacobian[b])
        touching = jnp.where(at.overlap > 0, self.stiffness * samples.length, 0.0)
        return Pressing(
            nearest.which @ np.arange(float(len(b))),
            place - (radius - 0.5 * own.overlap)[:, None] * nearest.normal,
            nearest.normal,
            samples.lumping @ self.pressure(tree, at),
            jnp.dot(samples.lumping, where_each(at.overlap > 0, -touching[:, None] * rows)),
            samples.lumping @ touching,
        )

    def energy(self, tree: Tree, at: Configuration, loads: Float[Array, " loads"]) -> Float[Array, ""]:
        """∫ ½ k max(d, 0)² ds."""
        count = len(self.first.frames(tree))
        found = self._overlaps(self.samples(tree), at.pose[:count], at.pose[count:])
        return 0.5 * jnp.sum(self.pressure(tree, found) * jnp.maximum(found.overlap, 0.0))

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open sample, which the expansion contains."""
        a, b, samples = self.first.frames(tree), self.second.index(tree), self.samples(tree)
        twist, levers = motion.twist(step)[:, :, None], samples.levers(motion.pose[a])
        at = self._overlaps(samples, motion.pose[a], motion.pose[b])
        nearest = at.touches[0]
        moved = samples.moved(levers, twist[a]) - _carried(nearest, levers, twist[b])
        closing = -jnp.sum(nearest.normal * moved[..., 0], axis=1)
        return fraction_to_contact(at.overlap, nearest.distance, closing, at.overlap < 0)

    def bind(self, tree: Tree) -> Bound:
        """The energy depends on the motion of each sample against its solids.

        With twists that move the sample by A to first order, and its solid by c = (ω, v) the same place p by
        D = v + ω × p, the sample moves in the solid by A − D + ½ ω × D − ω × A and what A has to second
        order: the energy of a point, by force and stiffness, and the force on −ω × A couples both.

        A piece of the tube depends on the twists t₀, t₁ of its two points and on the coordinates of the
        solids. With t₁ = t₀ + S of the step between them, t₀ᵀ K t₁ = t₀ᵀ K t₀ + t₀ᵀ K S: the first part is
        a stiffness of the frame, and the step's columns S belong to few coordinates.
        """
        a, b = self.first.frames(tree), self.second.index(tree)
        solids = tree.moving(b)
        weight = self.stiffness * self.samples(tree).length
        width = _width(self.second)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            samples, points = self.samples(tree), motion.pose[a]
            at, levers = self._overlaps(samples, points, motion.pose[b]), samples.levers(points)
            push = weight * jnp.maximum(at.overlap, 0.0)
            touches = at.overlap > 0
            two = touches & (at.share[1] > 0)
            position, jacobian = jnp.sum(levers, axis=1), motion.jacobian
            of_solids = jacobian[b][:, :, np.array(solids, int)]
            moved = _by_points(samples, levers)
            size = moved.shape[2] + len(solids)
            wrench = jnp.zeros((tree.frames, 6))
            rows, squares = [], []
            for counts, touch, share in zip((touches, two), at.touches, at.share, strict=True):
                carried = _carried(touch, levers, of_solids)
                relative = jnp.concatenate([moved, -carried], axis=2)
                directions = (touch.normal, jnp.cross(touch.normal, touch.tangent), touch.tangent)
                along = [jnp.einsum("pi,pia->pa", direction, relative) for direction in directions]
                rows.append(along[0])
                bend = -share * push * touch.bent
                bends = [(along[1], bend), (along[2], jnp.where(touch.on_end, bend, 0.0))]
                force = -(share * push)[:, None] * touch.normal
                turned = lie.hat(force) @ jnp.einsum("ps,sia->pia", touch.which, of_solids[:, :3])
                squares.append((bends, _turning(samples, levers, force, relative, turned)))
                on_solids = where_each(counts, point_wrench(position, force))
                wrench -= on_frames(touch.which.T @ on_solids, b, tree.frames)
            apart = rows[0] - rows[1]
            both = rows[0] - where_each(two, at.share[1][:, None] * apart)
            squares[0][0].append((both, jnp.where(touches, weight, 0.0)))
            squares[1][0].append((apart, jnp.where(two, 0.5 * push / width, 0.0)))
            pressed, crossed = (
                jnp.max(jnp.where((samples.of_piece > 0) & of, 1.0, 0.0), axis=1) > 0 for of in (touches, two)
            )
            whole = -push[:, None] * at.touches[0].normal
            whole += where_each(
                two, (at.share[1] * push)[:, None] * (at.touches[0].normal - at.touches[1].normal)
            )
            k = _by_pieces(samples, *squares[0]) + where_each(crossed, _by_pieces(samples, *squares[1]))
            start, end, own = slice(0, 6), slice(6, 12), slice(12, size)
            step = motion[self.first.rod].steps[-1]
            columns = step.columns @ step.basis  # of the coordinates of the rod
            coordinates = tuple(range(step.first, step.first + step.size))
            before = jacobian[a[:-1]]
            tie, drag = k[:, start, end], k[:, start, own] + k[:, end, own]
            along = jnp.einsum("jka,jkb->ab", before, where_each(pressed, tie @ columns))
            dragged = jnp.einsum("jka,jkb->ab", before, where_each(pressed, drag))
            swept = jnp.einsum("jka,jkb->ab", columns, where_each(pressed, k[:, end, own]))
            half = spread(along, coordinates, tree.dofs) + spread(dragged, solids, tree.dofs)
            half += spread(spread(swept, solids, tree.dofs).T, coordinates, tree.dofs).T
            still = jnp.sum(where_each(pressed, k[:, own, own]), axis=0)
            stiffness = jnp.zeros((tree.frames, 6, 6))
            on_start = k[:, start, start] + tie + jnp.swapaxes(tie, 1, 2)
            on_ends = (a[:-1], on_start), (a[1:], k[:, end, end])
            for pulls, (frames, on_end) in zip(samples.on_points(levers, whole), on_ends, strict=True):
                pulled = jnp.dot(samples.of_piece, where_each(touches, pulls))
                wrench += on_frames(pulled, frames, tree.frames)
                stiffness += on_frames(where_each(pressed, on_end), frames, tree.frames)
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(push * jnp.maximum(at.overlap, 0.0)),
                wrench=wrench,
                stiffness=stiffness,
                hessian=half + half.T + spread(spread(still, solids, tree.dofs).T, solids, tree.dofs),
            )

        return expand

    def _overlaps(
        self, samples: Samples, points: Float[Array, "points 4 4"], solids: Float[Array, "frames 4 4"]
    ) -> Contacts:
        """What samples overlap, with the poses of the rod's points and of the solids."""
        place = jnp.sum(samples.levers(points), axis=1)
        return contacts(self.second, solids, place, samples.radius)


def _carried(
    touch: Touch, levers: Float[Array, "samples 2 3"], solids: Float[Array, "frames 6 some"]
) -> Float[Array, "samples 3 some"]:
    """How samples would move with the solid that each overlaps, from the solids' twists."""
    return at_points(jnp.einsum("ps,sik->pik", touch.which, solids), jnp.sum(levers, axis=1))


def _rows(
    samples: Samples,
    levers: Float[Array, "samples 2 3"],
    at: Contacts,
    points: Float[Array, "points 6 dofs"],
    solids: Float[Array, "frames 6 dofs"],
) -> Float[Array, "samples dofs"]:
    """By how much the overlap of each sample falls, by coordinates."""
    moved = samples.moved(levers, points)
    first, second = (
        jnp.einsum("pi,pia->pa", share[:, None] * touch.normal, moved - _carried(touch, levers, solids))
        for share, touch in zip(at.share, at.touches, strict=True)
    )
    return first + second


def _by_points(samples: Samples, levers: Float[Array, "samples 2 3"]) -> Float[Array, "samples 3 12"]:
    """How samples move by the twists of the two points on either side, one after the other."""
    turning = -lie.hat(levers)
    sliding = samples.share[..., None, None] * np.eye(3)
    return jnp.concatenate([turning[:, 0], sliding[:, 0], turning[:, 1], sliding[:, 1]], axis=2)


def _turning(
    samples: Samples,
    levers: Float[Array, "samples 2 3"],
    force: Float[Array, "samples 3"],
    relative: Float[Array, "samples 3 variables"],
    turned: Float[Array, "samples 3 solids"],
) -> Float[Array, "samples variables variables"]:
    """Second derivative of a constant force's work, by the twists of both points and coordinates of solids.

    relative   how samples move in the solid
    turned     force × ω of the solid, by its coordinates
    """
    first, second = samples.stiffness(levers, force)
    none = jnp.zeros_like(first)
    coupled = -jnp.einsum("pia,pib->pab", relative, turned)
    across, own = coupled[:, :12], 0.5 * (coupled[:, 12:] + jnp.swapaxes(coupled[:, 12:], 1, 2))
    points = jnp.concatenate(
        [jnp.concatenate([first, none], axis=2), jnp.concatenate([none, second], axis=2)], axis=1
    )
    return jnp.concatenate(
        [
            jnp.concatenate([points, across], axis=2),
            jnp.concatenate([jnp.swapaxes(across, 1, 2), own], axis=2),
        ],
        axis=1,
    )


def _by_pieces(
    samples: Samples,
    squares: Sequence[tuple[Float[Array, "samples variables"], Float[Array, " samples"]]],
    others: Float[Array, "samples variables variables"],
) -> Float[Array, "pieces variables variables"]:
    """Sums over the samples of each piece, of factor xᵀ x for pairs (x, factor), and of other matrices."""
    size = others.shape[2]
    i, j = np.triu_indices(size)
    half = jnp.einsum("jp,pa->ja", samples.of_piece, others[:, i, j])
    for x, factor in squares:
        half += jnp.einsum("jp,pa->ja", samples.of_piece, (factor[:, None] * x)[:, i] * x[:, j])
    place = np.zeros((size, size), int)
    place[i, j] = place[j, i] = np.arange(len(i))
    return half[:, place]
