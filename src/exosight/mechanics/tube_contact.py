"""Contact of two soft tubes, or of one tube with itself: a traction t = k d n a length, for an overlap d.

The first tube's places between its rod's points (`Samples`) carry spheres of its radius; the second tube is
what spheres sweep along a curve through its rod's points: cubic Hermite pieces with the directions of the
cross-sections' normals and, for the radius, the slopes of parabolas. So its surface has no edges, and the
distance

    f = min over t of |p − c(t)| − r(t)

is as smooth as the curve wherever the closest place t is unique. With n = (p − c)/|p − c|, the derivative
of f is n · (δp − δc) at fixed t, and the second one follows from that of t, f_tt δt = −δf_t.

A rod touches itself between places further apart along it than FAR times the sum of their radii; each place
looks towards the tip, where a rod that curls up is convex as seen from its base. Places are searched only
from pieces of the first tube, and on groups of pieces of the second, that lie in balls close to each other.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.contact import Pressing, fraction_to_contact
from exosight.mechanics.kinematics import Motion, at_points, spread
from exosight.mechanics.rod import Rod, step_samples
from exosight.mechanics.surfaces import NOWHERE, Samples, Tube, hermite, slopes
from exosight.mechanics.term import (
    Bound,
    Configuration,
    Expansion,
    Term,
    on_frames,
    square,
    weighted_squares,
    where_each,
    zero,
)
from exosight.mechanics.tree import Tree

FAR = 1.9
"""A fifth more than a quarter turn: closer, a rod would be bent sharper than its own radius."""

NEWTON_STEPS = 4
"""From a secant, each squares the error of the closest place: 1e-2, 1e-4, 1e-8, 1e-16 of a piece."""

MARGIN = 0.6
"""Distance between balls around two pieces, in the radius of the first one's: a closer piece is searched, and
no step lets others come closer than touching."""

GROUP = 6
"""Pieces of the second tube that are searched together."""

SAMPLES = 1.25
"""Places of contact for each piece between a rod's points, in the mean."""

HALF = 0.6
"""Half of a piece's length between points, in that of the unloaded rod: it may be stretched by a fifth."""


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
    """For places of the first tube, the closest one of the second.

    piece      (points,)      number of the piece that holds it
    t          (points,)      place in that piece, 0 … 1
    free       (points,)      whether t follows when the point moves; not at the tube's ends
    overlap    (points,)      [m]; negative: gap
    distance   (points,)      from the axis [m]
    normal     (points, 3)    unit vector from there to the point
    nodes      the piece
    """

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

    def samples(self, tree: Tree) -> Samples:
        """Where on the first tube contact is integrated."""
        return self.first.samples(tree, SAMPLES)

    def closest(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Closest:
        """Where each of the first tube's samples is closest to the second one, at poses of all frames.

        Of those that cannot touch it, the overlap is −NOWHERE.
        """
        return self._of_samples(tree, pose[self.first.frames(tree)], pose[self.second.frames(tree)])

    def forces(
        self, tree: Tree, pose: Float[Array, "frames 4 4"]
    ) -> tuple[Float[AnyArray, "samples 3"], Closest]:
        """The force on the first tube at each of its samples, in the world [N], and where it acts."""
        at = self.closest(tree, pose)
        return (self._weight(tree) * jnp.maximum(at.overlap, 0.0))[:, None] * at.normal, at

    def pushes(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Float[AnyArray, " samples"]:
        """The normal force on each sample, at poses of all frames [N]."""
        return self._weight(tree) * jnp.maximum(self.closest(tree, pose).overlap, 0.0)

    def point_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the first tube's points."""
        return self.first.frames(tree)

    def partner_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the second tube's points."""
        return self.second.frames(tree)

    def point_stiffness(self, tree: Tree) -> Float[AnyArray, " points"]:
        """Of the length of tube that each point stands for [N/m]."""
        return self.samples(tree).lumping @ self._weight(tree)

    def pressing(self, tree: Tree, motion: Motion) -> Pressing:
        """What each of the rod's points presses on, the nearer node of the second tube's piece that it is
        closest to, and its share of the force of the samples on either side."""
        a, b, samples = self.first.frames(tree), self.second.frames(tree), self.samples(tree)
        place, nodes, radius = motion.position[a], motion.pose[b], jnp.asarray(self.first.radius)
        along = self._lengthwise(tree)
        candidates = self._candidates(tree, np.arange(len(a)), along, radius)
        every = np.ones((len(a), len(self._groups(tree))), bool)
        own = self._closest(tree, place, radius, *candidates, nodes, every)
        at, levers = self.closest(tree, motion.pose), samples.levers(motion.pose[a])
        touches, weight = at.overlap > 0, self._weight(tree)
        moved = samples.moved(levers, motion.jacobian[a]) - _carried(at, motion.jacobian[b])
        closing = -jnp.einsum("pi,pia->pa", at.normal, moved)
        touching = jnp.where(touches, weight, 0.0)
        return Pressing(
            own.piece + jnp.where(own.t > 0.5, 1.0, 0.0),
            place - (radius - 0.5 * own.overlap)[:, None] * own.normal,
            own.normal,
            samples.lumping @ (weight * jnp.maximum(at.overlap, 0.0)),
            jnp.dot(samples.lumping, where_each(touches, touching[:, None] * closing)),
            samples.lumping @ touching,
        )

    def energy(self, tree: Tree, at: Configuration, loads: Float[Array, " loads"]) -> Float[Array, ""]:
        """∫ ½ k max(d, 0)² ds."""
        order = self.frames(tree)
        own, other = (
            np.array([order.index(i) for i in tube.frames(tree)]) for tube in (self.first, self.second)
        )
        found = self._of_samples(tree, at.pose[own], at.pose[other])
        return 0.5 * jnp.sum(self._weight(tree) * jnp.maximum(found.overlap, 0.0) ** 2)

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open sample, which the expansion contains, or
        to where pieces that are not searched may touch."""
        a, b, samples = self.first.frames(tree), self.second.frames(tree), self.samples(tree)
        twist = motion.twist(step)[:, :, None]
        points, nodes = motion.pose[a], motion.pose[b]
        at = self._of_samples(tree, points, nodes)
        moved = samples.moved(samples.levers(points), twist[a]) - _carried(at, twist[b])
        reached = at.overlap > -NOWHERE
        closing, distance = where_each(
            reached, jnp.stack([-jnp.sum(at.normal * moved[..., 0], axis=1), at.distance], axis=1)
        ).T
        touching = fraction_to_contact(at.overlap, distance, closing, at.overlap < 0)
        apart, margin = self._apart(tree, points, nodes)
        ways = [_length(at_points(twist[each], motion.position[each])[..., 0]) for each in (a, b)]
        fastest = jnp.maximum(ways[0][1:], ways[0][:-1]) + jnp.max(ways[1]) + 1e-30
        meeting = jnp.where(apart < margin, jnp.inf, apart / fastest[:, None])
        return jnp.minimum(touching, jnp.min(meeting))

    def bind(self, tree: Tree) -> Bound:
        """Wrenches on both points beside a sample and on both nodes of the piece that it is closest to, and
        the second derivative by coordinates.

        That depends on how the other points and nodes move against the first of the two points, which no
        coordinate before it changes. With its turn ω, and a the motion of the sample against the closest
        place across the normal n as seen from there, the motion across n in the world is a + d ω × n at the
        distance d of both, so −½ f/d of its square for a force f is

            −½ f/d a² − f ω · (n × a) − ½ f d |ω × n|².
        """
        a, b, samples = self.first.frames(tree), self.second.frames(tree), self.samples(tree)
        coordinates = tree.moving(self.frames(tree))
        moving = np.array(coordinates, int)
        weight = self._weight(tree)
        pieces = np.arange(len(b) - 1)
        may_hold = _of_pieces(self._may_touch(tree, samples.piece))
        bends = self._bends(tree, coordinates)[samples.piece]

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            at, own = self.closest(tree, motion.pose), samples.levers(motion.pose[a])
            push = weight * jnp.maximum(at.overlap, 0.0)
            force = -push[:, None] * at.normal
            levers, weights = _levers(at, 0)
            touches = at.overlap > 0
            holds = (at.piece[:, None] == pieces) & may_hold
            chosen = where_each(touches, jnp.where(holds, 1.0, 0.0))
            # On both points beside the sample the force, on the nodes of its piece its opposite.
            pulls = jnp.zeros((tree.frames, PULL))
            lean = (push * at.distance)[:, None, None] * (square(at.normal) - np.eye(3))
            for i, (points, nodes) in enumerate(((a[:-1], b[:-1]), (a[1:], b[1:]))):
                pull = _pulls(samples.share[:, i], own[:, i], force, lean if i == 0 else 0 * lean)
                pull = samples.of_piece @ where_each(touches, pull)
                pulls += on_frames(pull, points, tree.frames)
                pull = chosen.T @ _pulls(weights[:, i], levers[:, i], force, 0 * lean)
                pulls -= on_frames(pull, nodes, tree.frames)
            wrench, stiffness = _of_pulls(pulls)
            jacobian = motion.jacobian[:, :, moving]
            first, second = (jacobian[a[samples.piece + i]] for i in range(2))
            relative = _moves(samples.share[:, 1], own[:, 1], jnp.where(bends[:, None], second - first, 0.0))
            slid = jnp.zeros(relative.shape[::2])
            rates, rate_weights = _levers(at, 1)
            for i in range(2):
                node = jnp.where(bends[:, None], _row(jacobian[b], at.piece + i) - first, 0.0)
                relative -= _moves(weights[:, i], levers[:, i], node)
                slid -= jnp.einsum("pi,pia->pa", at.normal, _moves(rate_weights[:, i], rates[:, i], node))
            across = _across(at.normal)
            normal, *aside = (jnp.einsum("pi,pia->pa", n, relative) for n in (at.normal, *across))
            for direction, moved in zip(across, aside, strict=True):
                slid -= (jnp.sum(direction * jnp.sum(rates, axis=1), axis=1) / at.distance)[:, None] * moved
            turning = across[1][..., None] * aside[0][:, None] - across[0][..., None] * aside[1][:, None]
            turning = samples.of_piece @ where_each(touches, push[:, None, None] * turning).reshape(
                len(push), -1
            )
            turning = turning.reshape(-1, 3, len(moving))
            pressed = jnp.max(jnp.where((samples.of_piece > 0) & touches, 1.0, 0.0), axis=1) > 0
            half = -jnp.einsum("jia,jib->ab", jacobian[a[:-1], :3], where_each(pressed, turning))
            follows = jnp.where(at.free, push / jnp.where(at.free, _second(at), 1.0), 0.0)
            bend = -push / at.distance
            block = weighted_squares(
                jnp.stack([normal, *aside, slid], axis=1),
                jnp.stack([jnp.asarray(weight), bend, bend, follows], axis=1),
                touches,
            )
            block += half + half.T
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(weight * jnp.maximum(at.overlap, 0.0) ** 2),
                wrench=wrench,
                stiffness=stiffness,
                hessian=spread(spread(block, coordinates, tree.dofs).T, coordinates, tree.dofs),
            )

        return expand

    def _bends(self, tree: Tree, coordinates: tuple[int, ...]) -> Bool[np.ndarray, "pieces coordinates"]:
        """Which coordinates move anything that the places on each piece may touch against its first point."""
        rod = tree[self.first.rod]
        assert isinstance(rod, Rod)
        if self.first.rod != self.second.rod:
            return np.ones((rod.frames - 1, len(coordinates)), bool)
        own = tree.dof_slice(rod.name)
        first = own.start + rod.joint.dofs
        samples = rod.functions(step_samples(rod.quadrature.points).ravel())
        of_step = np.any(samples.reshape(rod.frames - 1, -1, own.stop - first) != 0, axis=1)
        later = np.logical_or.accumulate(of_step[::-1], axis=0)[::-1]
        place = np.array(coordinates) - first
        inside = (place >= 0) & (place < own.stop - first)
        return later[:, np.where(inside, place, 0)] & inside

    def _weight(self, tree: Tree) -> Float[AnyArray, " samples"]:
        """Of the length of tube that each sample stands for [N/m]."""
        return self.stiffness * self.samples(tree).length

    def _of_samples(
        self, tree: Tree, points: Float[Array, "points 4 4"], nodes: Float[Array, "nodes 4 4"]
    ) -> Closest:
        """At the poses of both tubes' points."""
        samples = self.samples(tree)
        place = jnp.sum(samples.levers(points), axis=1)
        apart, margin = self._apart(tree, points, nodes)
        some = jnp.min(apart, axis=1) < margin[:, 0]
        reached = (some[:, None] & (apart < margin))[samples.piece]
        found = self._closest(tree, place, samples.radius, *self._candidates_of_samples(tree), nodes, reached)
        return found._replace(overlap=jnp.where(some[samples.piece], found.overlap, -NOWHERE))

    def _groups(self, tree: Tree) -> list[slice]:
        """The second tube's pieces, GROUP at a time."""
        pieces = len(self.second.frames(tree)) - 1
        return [slice(first, min(first + GROUP, pieces)) for first in range(0, pieces, GROUP)]

    def _apart(
        self, tree: Tree, points: Float[Array, "points 4 4"], nodes: Float[Array, "nodes 4 4"]
    ) -> tuple[Float[Array, "pieces groups"], Float[Array, "pieces 1"]]:
        """How far balls around each piece of the first tube and around the next piece of each group of the
        second one that it may touch are apart; and up to where they are searched [m]."""
        samples = self.samples(tree)

        def ball(tube: Tube) -> Float[Array, " pieces"]:
            rod = tree[tube.rod]
            assert isinstance(rod, Rod)
            radius = jnp.asarray(tube.radius)
            return jnp.maximum(radius[1:], radius[:-1]) + HALF * rod.length * np.diff(rod.quadrature.points)

        far, _ = self._candidates_of_samples(tree)
        # With the nodes of its end that samples of a piece may touch.
        may = (samples.of_piece @ jnp.where(far, 1.0, 0.0))[:, 1:] > 0
        may &= self._may_touch(tree, np.arange(len(points) - 1))[:, 1:]
        between = _middles(points[:, :3, 3])[:, None] - _middles(nodes[:, :3, 3])
        apart = jnp.where(may, jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30) - ball(self.second), NOWHERE)
        own = ball(self.first)[:, None]
        least = [jnp.min(apart[:, group], axis=1) for group in self._groups(tree)]
        return jnp.stack(least, axis=1) - own, MARGIN * own

    def _closest(
        self,
        tree: Tree,
        point: Float[Array, "points 3"],
        thick: Float[AnyArray, " points"],
        far: Bool[AnyArray, "points nodes"],
        may: Bool[np.ndarray, "points nodes"],
        nodes: Float[Array, "nodes 4 4"],
        reached: Bool[AnyArray, "points groups"],
    ) -> Closest:
        """Of spheres with these centres and radii, among the groups of pieces that are `reached`; `far` and
        `may`: see `_candidates`."""
        rod = tree[self.second.rod]
        assert isinstance(rod, Rod)
        node, direction = nodes[:, :3, 3], nodes[:, :3, 0]
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
        may = np.concatenate([may[:, :1], may], axis=1)
        near = jnp.concatenate([far[:, :1], far], axis=1)
        score = jnp.where(holds & may & near, lowest, NOWHERE)
        last = len(node) - 1
        least, best = jnp.full(len(point), NOWHERE), jnp.zeros(len(point), int)
        for group, searched in zip(self._groups(tree), reached.T, strict=True):
            # Number i is in piece i − 1, and at the ends of the tube in the first and the last one.
            first, end = (0 if group.start == 0 else group.start + 1), group.stop + 1 + (group.stop == last)
            lowest = jnp.where(searched, jnp.min(score[:, first:end], axis=1), NOWHERE)
            place = jnp.where(searched, first + jnp.argmin(score[:, first:end], axis=1), 0)
            best = jnp.where(lowest < least, place, best)
            least = jnp.minimum(lowest, least)
        piece = jnp.clip(best - 1, 0, last - 1)
        free = (best > 0) & (best <= last)
        long = jnp.concatenate([spacing, jnp.zeros(1)])
        table = jnp.concatenate([node, direction, radius[:, None], slope[:, None], long[:, None]], axis=1)
        start, end = _row(table, piece), _row(table, piece + 1)
        length = start[:, 8]
        both = jnp.stack([start, end], axis=1)
        piece_nodes = Piece(
            both[..., :3],
            both[..., 3:6] * length[:, None, None],
            both[..., 6],
            both[..., 7] * length[:, None],
        )
        t = jnp.where(free, _solve(point, piece_nodes), jnp.where(best > 0, 1.0, 0.0))
        between = point - jnp.sum(hermite(t, 0)[..., None] * _four(piece_nodes), axis=1)
        distance = jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30)
        other = jnp.sum(hermite(t, 0) * _four_radii(piece_nodes), axis=1)
        overlap = jnp.where(least < NOWHERE, thick + other - distance, -NOWHERE)
        return Closest(piece, t, free, overlap, distance, between / distance[:, None], piece_nodes)

    def _lengthwise(self, tree: Tree) -> Float[AnyArray, " points"]:
        """Distance of the first tube's points from its beginning, unbent [m]."""
        rod = tree[self.first.rod]
        assert isinstance(rod, Rod)
        return rod.length * rod.quadrature.points

    def _candidates_of_samples(
        self, tree: Tree
    ) -> tuple[Bool[AnyArray, "samples nodes"], Bool[np.ndarray, "samples nodes"]]:
        samples = self.samples(tree)
        along = samples.lumping.T @ self._lengthwise(tree)
        return self._candidates(tree, samples.piece, along, samples.radius)

    def _candidates(
        self,
        tree: Tree,
        piece: Int[np.ndarray, " points"],
        along: Float[AnyArray, " points"],
        radius: Float[AnyArray, " points"],
    ) -> tuple[Bool[AnyArray, "points nodes"], Bool[np.ndarray, "points nodes"]]:
        """Which of its nodes a tube of these places and radii may touch: far enough apart along one rod, of
        two rods all, and which may be so (static).

        piece   beginning at which node, or later
        along   distance from the beginning of the tube [m]
        """
        may = self._may_touch(tree, piece)
        if self.first.rod != self.second.rod:
            return jnp.ones(may.shape, bool), may
        second = jnp.asarray(self._lengthwise(tree))
        return second[None] - along[:, None] > FAR * (radius[:, None] + jnp.asarray(self.second.radius)), may

    def _may_touch(self, tree: Tree, piece: Int[np.ndarray, " points"]) -> Bool[np.ndarray, "points nodes"]:
        """Which nodes places on these pieces are compared with: all of another rod; of its own, those towards
        the tip."""
        nodes = np.arange(len(self.second.frames(tree)))
        own = self.first.rod == self.second.rod
        return nodes > piece[:, None] if own else np.ones((len(piece), len(nodes)), bool)


def _of_pieces(nodes: Bool[np.ndarray, "points nodes"]) -> Bool[np.ndarray, "points pieces"]:
    """Of the piece that begins at each node; what holds for the last node holds for the last piece."""
    pieces = nodes[:, :-1].copy()
    pieces[:, -1] |= nodes[:, -1]
    return pieces


def _middles(values: Float[Array, "points 3"]) -> Float[Array, "pieces 3"]:
    """Means of each point and the next one."""
    return 0.5 * (values[1:] + values[:-1])


def _length(values: Float[Array, "points 3"]) -> Float[Array, " points"]:
    return jnp.sqrt(jnp.sum(values**2, axis=1) + 1e-30)


def _row(table: Float[Array, "nodes ..."], number: Int[Array, " points"]) -> Float[Array, "points ..."]:
    """The rows with these numbers, which lie inside."""
    return table.at[number].get(mode="promise_in_bounds")


def _four(nodes: Piece) -> Float[Array, "points 4 3"]:
    """What the Hermite functions multiply: start, its tangent, end, its tangent."""
    return jnp.stack([nodes.position, nodes.tangent], axis=2).reshape(-1, 4, 3)


def _four_radii(nodes: Piece) -> Float[Array, "points 4"]:
    return jnp.stack([nodes.radius, nodes.slope], axis=2).reshape(-1, 4)


PULL = 12
"""Numbers of a force on a point: see `_pulls`."""

_UPPER = np.triu_indices(3)


def _pulls(
    share: Float[AnyArray, " points"],
    lever: Float[Array, "points 3"],
    force: Float[AnyArray, "points 3"],
    stiffness: Float[Array, "points 3 3"],
) -> Float[Array, "points 12"]:
    """Of a constant force on what moves by share v + ω × lever: the force on v, its torque, and the second
    derivative of its work by ω, and of another energy of ω."""
    outer = lever[:, :, None] * force[:, None]
    work = jnp.sum(lever * force, axis=1)[:, None, None]
    turn = 0.5 * (outer + jnp.swapaxes(outer, 1, 2)) - work * np.eye(3) + stiffness
    return jnp.concatenate([share[:, None] * force, jnp.cross(lever, force), turn[:, *_UPPER]], axis=1)


def _of_pulls(
    pulls: Float[Array, "frames 12"],
) -> tuple[Float[Array, "frames 6"], Float[Array, "frames 6 6"]]:
    """Spatial wrenches and stiffnesses of what acts on each frame."""
    force, torque, turn = pulls[:, :3], pulls[:, 3:6], pulls[:, 6:]
    place = np.zeros((3, 3), int)
    place[_UPPER] = place[_UPPER[::-1]] = np.arange(6)
    mixed = -0.5 * lie.hat(force)
    upper = jnp.concatenate([turn[:, place], mixed], axis=2)
    lower = jnp.concatenate([jnp.swapaxes(mixed, 1, 2), jnp.zeros_like(mixed)], axis=2)
    return jnp.concatenate([torque, force], axis=1), jnp.concatenate([upper, lower], axis=1)


def _moves(
    share: Float[AnyArray, " points"], lever: Float[Array, "points 3"], twists: Float[Array, "points 6 some"]
) -> Float[Array, "points 3 some"]:
    """share v + ω × lever of each twist."""
    return share[:, None, None] * twists[:, 3:] - lie.hat(lever) @ twists[:, :3]


def _across(normal: Float[Array, "points 3"]) -> tuple[Float[Array, "points 3"], Float[Array, "points 3"]]:
    """Two unit vectors t₁, t₂ with n × t₁ = t₂; for a normal in the x-y plane the first one is too."""
    x, y, z = normal.T
    none = jnp.zeros_like(x)
    flat = (jnp.abs(z) < 0.9)[:, None]
    first = jnp.where(flat, jnp.stack([y, -x, none], axis=1), jnp.stack([none, z, -y], axis=1))
    first = first / jnp.sqrt(jnp.sum(first**2, axis=1))[:, None]
    return first, jnp.cross(normal, first)


def _levers(at: Closest, order: int) -> tuple[Float[Array, "points 2 3"], Float[Array, "points 2"]]:
    """Derivative by t of the curve's share that moves with each node: it moves by weight v + ω × lever."""
    functions = hermite(at.t, order).reshape(-1, 2, 2)
    levers = functions[..., :1] * at.nodes.position + functions[..., 1:] * at.nodes.tangent
    return levers, functions[..., 0]


def _carried(at: Closest, nodes: Float[Array, "nodes 6 some"]) -> Float[Array, "points 3 some"]:
    """How the closest places move at fixed t, from twists of the second tube's nodes."""
    levers, weights = _levers(at, 0)
    first, second = (_moves(weights[:, i], levers[:, i], _row(nodes, at.piece + i)) for i in range(2))
    return first + second


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
