"""Contact of two soft tubes, or of one tube with itself: a traction t = k d n a length, for an overlap d.

Each point of the first tube carries a sphere of the tube's radius there; the second tube is what spheres
sweep along a curve through its rod's points: cubic Hermite pieces with the directions of the cross-
sections' normals and, for the radius, the slopes of parabolas. So its surface has no edges, and the
distance

    f = min over t of |p − c(t)| − r(t)

is as smooth as the curve wherever the closest place t is unique. With n = (p − c)/|p − c|, the derivative
of f is n · (δp − δc) at fixed t, and the second one follows from that of t, f_tt δt = −δf_t.

A rod touches itself between places further apart along it than FAR times the sum of their radii; each point
looks towards the tip, where a rod that curls up is convex as seen from its base.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.contact import Pressing, fraction_to_contact
from exosight.mechanics.kinematics import Motion, at_points, spread
from exosight.mechanics.rod import Rod
from exosight.mechanics.surfaces import NOWHERE, Tube, hermite, slopes
from exosight.mechanics.term import (
    Bound,
    Configuration,
    Expansion,
    Term,
    on_frames,
    point_stiffness,
    point_wrench,
    weighted_squares,
    where_each,
    zero,
)
from exosight.mechanics.tree import Tree

FAR = 1.9
"""A fifth more than a quarter turn: closer, a rod would be bent sharper than its own radius."""

NEWTON_STEPS = 4
"""From a secant, each squares the error of the closest place: 1e-2, 1e-4, 1e-8, 1e-16 of a piece."""


class Piece(NamedTuple):
    """One Hermite piece of a tube for each of some points: of its start and end nodes.

    position   (points, 2, 3)   of the nodes [m]
    tangent    (points, 2, 3)   derivative by t there [m]
    radius     (points, 2)      [m]
    slope      (points, 2)      its derivative by t [m]
    """

    position: Float[Array, "points 2 3"]
    tangent: Float[Array, "points 2 3"]
    radius: Float[Array, "points 2"]
    slope: Float[Array, "points 2"]


class Closest(NamedTuple):
    """For points of the first tube, the closest place of the second.

    exists     (points,)      whether there is one that may be touched
    piece      (points,)      number of the piece that holds it
    t          (points,)      place in that piece, 0 … 1
    free       (points,)      whether t follows when the point moves; not at the tube's ends
    overlap    (points,)      [m]; negative: gap
    distance   (points,)      from the axis [m]
    normal     (points, 3)    unit vector from there to the point
    nodes      the piece
    """

    exists: Bool[Array, " points"]
    piece: Int[Array, " points"]
    t: Float[Array, " points"]
    free: Bool[Array, " points"]
    overlap: Float[Array, " points"]
    distance: Float[Array, " points"]
    normal: Float[Array, "points 3"]
    nodes: Piece


class TubeContact(Term):
    """Contact of a tube with another one, or with itself.

    stiffness   ()   k, force a length of the first tube and a depth [N/m²]
    """

    first: Tube
    second: Tube
    stiffness: Float[AnyArray, ""]

    def frames(self, tree: Tree) -> list[int]:
        """The first tube's points, then the second's; once if they are the same."""
        return list(dict.fromkeys([*self.first.frames(tree).tolist(), *self.second.frames(tree).tolist()]))

    def closest(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Closest:
        """Where each point of the first tube is closest to the second, at poses of all frames."""
        nodes = pose[self.second.frames(tree)]
        return self._closest(tree, pose[self.first.frames(tree), :3, 3], nodes[:, :3, 3], nodes[:, :3, 0])

    def forces(
        self, tree: Tree, pose: Float[Array, "frames 4 4"]
    ) -> tuple[Float[AnyArray, "points 3"], Closest]:
        """The force on the first tube at each of its points, in the world [N], and where it acts."""
        at = self.closest(tree, pose)
        push = self.point_stiffness(tree) * jnp.maximum(at.overlap, 0.0)
        return push[:, None] * at.normal, at

    def point_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the first tube's points."""
        return self.first.frames(tree)

    def partner_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the second tube's points."""
        return self.second.frames(tree)

    def point_stiffness(self, tree: Tree) -> Float[AnyArray, " points"]:
        """Of the length of tube that each point stands for [N/m]."""
        return self.stiffness * self.first.lengths(tree)

    def pressing(self, tree: Tree, motion: Motion) -> Pressing:
        """What each point presses on: the nearer node of the piece of the second tube."""
        at = self.closest(tree, motion.pose)
        own, other = (motion.jacobian[tube.frames(tree)] for tube in (self.first, self.second))
        place = motion.position[self.first.frames(tree)]
        moved = _moved(at, own, other, place)
        k = self.point_stiffness(tree)
        closing = -jnp.einsum("pi,pia->pa", at.normal, moved)
        touching = jnp.where(at.overlap > 0, k, 0.0)
        return Pressing(
            at.piece + jnp.where(at.t > 0.5, 1.0, 0.0),
            place - (self.first.radius - 0.5 * at.overlap)[:, None] * at.normal,
            at.normal,
            k * jnp.maximum(at.overlap, 0.0),
            touching[:, None] * closing,
            touching,
        )

    def energy(self, tree: Tree, at: Configuration, loads: Float[Array, " loads"]) -> Float[Array, ""]:
        """∫ ½ k max(d, 0)² ds."""
        order = self.frames(tree)
        own, other = (
            np.array([order.index(i) for i in tube.frames(tree)]) for tube in (self.first, self.second)
        )
        found = self._closest(tree, at.position[own], at.position[other], at.pose[other, :3, 0])
        weight = self.point_stiffness(tree)
        return 0.5 * jnp.sum(weight * jnp.maximum(found.overlap, 0.0) ** 2)

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open point; the expansion there contains it."""
        at = self.closest(tree, motion.pose)
        twist = motion.twist(step)
        own, other = twist[self.first.frames(tree)], twist[self.second.frames(tree)]
        place = motion.position[self.first.frames(tree)]
        velocity = jnp.stack([_row(other, at.piece), _row(other, at.piece + 1)], axis=1)
        levers, weights = _levers(at, 0)
        moved = own[:, 3:] + jnp.cross(own[:, :3], place)
        moved = moved - jnp.sum(
            weights[..., None] * velocity[..., 3:] + jnp.cross(velocity[..., :3], levers), axis=1
        )
        closing = -jnp.sum(at.normal * moved, axis=1)
        return fraction_to_contact(at.overlap, at.distance, closing, at.exists & (at.overlap < 0))

    def bind(self, tree: Tree) -> Bound:
        """Wrenches on the point and on both nodes of its piece, and the second derivative by coordinates."""
        a, b = self.first.frames(tree), self.second.frames(tree)
        moving = np.array(tree.moving(self.frames(tree)), int)
        weight = self.point_stiffness(tree)
        may_touch = _may_touch(self, tree)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            at, position = self.closest(tree, motion.pose), motion.position[a]
            jacobian = motion.jacobian[:, :, moving]
            push = weight * jnp.maximum(at.overlap, 0.0)
            force = -push[:, None] * at.normal
            levers, weights = _levers(at, 0)
            # Frames: on each point the force, on the nodes of its piece its opposite by their weights.
            touches = at.overlap > 0
            wrench = on_frames(where_each(touches, point_wrench(position, force)), a, tree.frames)
            stiffness = on_frames(where_each(touches, point_stiffness(position, force)), a, tree.frames)
            for node in range(2):
                of_node = (at.piece[:, None] + node == np.arange(len(b))) & may_touch
                share = weights[:, node, None]
                on_node = jnp.concatenate([jnp.cross(levers[:, node], force), share * force], axis=1)
                blocks = (
                    jnp.ones((len(a), 6, 6))
                    .at[:, 3:, :3]
                    .set(share[..., None])
                    .at[:, :3, 3:]
                    .set(share[..., None])
                )
                bent = point_stiffness(levers[:, node], force) * blocks
                chosen = jnp.where(of_node & touches[:, None], 1.0, 0.0)
                wrench -= on_frames(chosen.T @ on_node, b, tree.frames)
                stiffness -= on_frames(jnp.einsum("pn,pij->nij", chosen, bent), b, tree.frames)
            moved = _moved(at, jacobian[a], jacobian[b], position)
            turned = jnp.zeros(moved.shape[::2])
            rates, rate_weights = _levers(at, 1)
            for node in range(2):
                columns = _row(jacobian[b], at.piece + node)
                turned += jnp.einsum(
                    "pi,pia->pa",
                    at.normal,
                    rate_weights[:, node, None, None] * columns[:, 3:]
                    - lie.hat(rates[:, node]) @ columns[:, :3],
                )
            along = jnp.sum(rates, axis=1)
            normal = jnp.einsum("pi,pia->pa", at.normal, moved)
            aside = moved - at.normal[..., None] * normal[:, None]
            bend = push / at.distance
            slid = -jnp.einsum("pi,pia->pa", along, aside) / at.distance[:, None] - turned
            follows = jnp.where(at.free, push / jnp.where(at.free, _second(at), 1.0), 0.0)
            columns = jnp.concatenate([normal[:, None], aside, slid[:, None]], axis=1)
            factors = jnp.stack([jnp.asarray(weight), -bend, -bend, -bend, follows], axis=1)
            block = weighted_squares(columns, factors, touches)
            whole = spread(
                spread(block, tuple(moving.tolist()), tree.dofs).T, tuple(moving.tolist()), tree.dofs
            )
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(weight * jnp.maximum(at.overlap, 0.0) ** 2),
                wrench=wrench,
                stiffness=stiffness,
                hessian=whole,
            )

        return expand

    def _closest(
        self,
        tree: Tree,
        point: Float[Array, "points 3"],
        node: Float[Array, "nodes 3"],
        direction: Float[Array, "nodes 3"],
    ) -> Closest:
        rod = tree[self.second.rod]
        assert isinstance(rod, Rod)
        spacing = rod.length * np.diff(rod.quadrature.points)
        radius = jnp.asarray(self.second.radius)
        slope = slopes(radius, spacing)
        away = point[:, None] - node[None]
        distance = jnp.sqrt(jnp.sum(away**2, axis=-1) + 1e-30)
        # Whether the second tube comes closer further along it than at a node.
        closer = jnp.einsum("pni,ni->pn", away, direction) + slope * distance > 0
        gap = distance - radius
        always = jnp.ones((len(point), 1), bool)
        holds = jnp.concatenate([always, closer], axis=1) & ~jnp.concatenate([closer, ~always], axis=1)
        lowest = jnp.concatenate([gap[:, :1], jnp.minimum(gap[:, 1:], gap[:, :-1]), gap[:, -1:]], axis=1)
        may = _may_touch(self, tree)
        may = np.concatenate([may[:, :1], may], axis=1)
        near = jnp.concatenate([self._far(tree)[:, :1], self._far(tree)], axis=1)
        score = jnp.where(holds & may & near, lowest, NOWHERE)
        best = jnp.argmin(score, axis=1)
        last = len(node) - 1
        piece = jnp.clip(best - 1, 0, last - 1)
        free = (best > 0) & (best <= last)
        long = jnp.concatenate([spacing, jnp.zeros(1)])
        table = jnp.concatenate([node, direction, radius[:, None], slope[:, None], long[:, None]], axis=1)
        start, end = _row(table, piece), _row(table, piece + 1)
        length = start[:, 8]
        both = jnp.stack([start, end], axis=1)
        nodes = Piece(
            both[..., :3],
            both[..., 3:6] * length[:, None, None],
            both[..., 6],
            both[..., 7] * length[:, None],
        )
        t = jnp.where(free, _solve(point, nodes), jnp.where(best > 0, 1.0, 0.0))
        between = point - jnp.sum(hermite(t, 0)[..., None] * _four(nodes), axis=1)
        distance = jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30)
        thick = jnp.sum(hermite(t, 0) * _four_radii(nodes), axis=1)
        exists = jnp.min(score, axis=1) < NOWHERE
        overlap = jnp.where(exists, self.first.radius + thick - distance, -NOWHERE)
        return Closest(exists, piece, t, free, overlap, distance, between / distance[:, None], nodes)

    def _far(self, tree: Tree) -> Bool[AnyArray, "points nodes"]:
        """Whether places of one rod are far enough apart along it; all of two rods are."""
        if self.first.rod != self.second.rod:
            return jnp.ones((len(self.first.frames(tree)), len(self.second.frames(tree))), bool)
        rod = tree[self.first.rod]
        assert isinstance(rod, Rod)
        place = rod.length * rod.quadrature.points
        radius = jnp.asarray(self.first.radius)
        return place[None] - place[:, None] > FAR * (radius[:, None] + radius[None])


def _may_touch(contact: TubeContact, tree: Tree) -> Bool[np.ndarray, "points nodes"]:
    """Which nodes a point is compared with: all of another rod; of its own, those towards the tip."""
    shape = len(contact.first.frames(tree)), len(contact.second.frames(tree))
    own = contact.first.rod == contact.second.rod
    return np.triu(np.ones(shape, bool), 1) if own else np.ones(shape, bool)


def _row(table: Float[Array, "nodes ..."], number: Int[Array, " points"]) -> Float[Array, "points ..."]:
    """The rows with these numbers, which lie inside."""
    return table.at[number].get(mode="promise_in_bounds")


def _four(nodes: Piece) -> Float[Array, "points 4 3"]:
    """What the Hermite functions multiply: start, its tangent, end, its tangent."""
    return jnp.stack([nodes.position, nodes.tangent], axis=2).reshape(-1, 4, 3)


def _four_radii(nodes: Piece) -> Float[Array, "points 4"]:
    return jnp.stack([nodes.radius, nodes.slope], axis=2).reshape(-1, 4)


def _levers(at: Closest, order: int) -> tuple[Float[Array, "points 2 3"], Float[Array, "points 2"]]:
    """Derivative by t of the curve's share that moves with each node: it moves by weight v + ω × lever."""
    functions = hermite(at.t, order).reshape(-1, 2, 2)
    levers = functions[..., :1] * at.nodes.position + functions[..., 1:] * at.nodes.tangent
    return levers, functions[..., 0]


def _moved(
    at: Closest,
    own: Float[Array, "points 6 moving"],
    other: Float[Array, "nodes 6 moving"],
    place: Float[Array, "points 3"],
) -> Float[Array, "points 3 moving"]:
    """Derivative of each point's place against the closest one at fixed t, from both tubes' Jacobians."""
    levers, weights = _levers(at, 0)
    moved = at_points(own, place)
    for node in range(2):
        columns = _row(other, at.piece + node)
        moved -= weights[:, node, None, None] * columns[:, 3:]
        moved += lie.hat(levers[:, node]) @ columns[:, :3]
    return moved


def _slide(
    t: Float[Array, " points"], point: Float[Array, "points 3"], nodes: Piece
) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
    """f_t and f_tt of f = |p − c(t)| − r(t)."""
    curve = [jnp.sum(hermite(t, k)[..., None] * _four(nodes), axis=1) for k in range(3)]
    radius = [jnp.sum(hermite(t, k) * _four_radii(nodes), axis=1) for k in (1, 2)]
    between = point - curve[0]
    distance = jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30)
    normal = between / distance[:, None]
    along = jnp.sum(normal * curve[1], axis=1)
    first = -along - radius[0]
    second = (jnp.sum(curve[1] ** 2, axis=1) - along**2) / distance
    return first, second - jnp.sum(normal * curve[2], axis=1) - radius[1]


def _solve(point: Float[Array, "points 3"], nodes: Piece) -> Float[Array, " points"]:
    """The place t where f_t = 0, in pieces that hold one."""
    none = jnp.zeros(len(point))
    start, end = _slide(none, point, nodes)[0], _slide(none + 1.0, point, nodes)[0]
    t = jnp.clip(start / jnp.where(end - start > 0, start - end, -1.0), 0.0, 1.0)
    for _ in range(NEWTON_STEPS):
        first, second = _slide(t, point, nodes)
        t = jnp.clip(t - first / jnp.where(second > 0, second, 1.0), 0.0, 1.0)
    return t


def _second(at: Closest) -> Float[Array, " points"]:
    """f_tt at the closest place."""
    point = at.distance[:, None] * at.normal + jnp.sum(hermite(at.t, 0)[..., None] * _four(at.nodes), axis=1)
    return _slide(at.t, point, at.nodes)[1]
