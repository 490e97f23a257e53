"""Contact of two soft tubes, or of one tube with itself: a traction t = k d n a length, for an overlap d.

At places along the first tube (`tube_distance`) the overlap is d = r − f with f = min over t of
|p − c(t)| − r(t) over the second one. With n = (p − c)/|p − c|, the derivative of f is n · (δp − δc) at
fixed t, and the second one follows from that of t, f_tt δt = −δf_t.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.contact import Pressing, fraction_to_contact
from exosight.mechanics.kinematics import Motion, at_points, spread
from exosight.mechanics.rod import Rod, step_samples
from exosight.mechanics.surfaces import NOWHERE, Samples, Tube
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
from exosight.mechanics.tube_distance import Closest, TubePair, row


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
        return self._pair(tree).samples

    def closest(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Closest:
        """Where each of the first tube's samples is closest to the second one, at poses of all frames.

        Of those that cannot touch it, the overlap is −NOWHERE.
        """
        return self._pair(tree).of_samples(pose[self.first.frames(tree)], pose[self.second.frames(tree)])

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
        place, radius = motion.position[a], jnp.asarray(self.first.radius)
        own = self._pair(tree).of_points(motion.pose[a], motion.pose[b])
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
        found = self._pair(tree).of_samples(at.pose[own], at.pose[other])
        return 0.5 * jnp.sum(self._weight(tree) * jnp.maximum(found.overlap, 0.0) ** 2)

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open sample, which the expansion contains, or
        to where pieces that are not searched may touch."""
        a, b, samples = self.first.frames(tree), self.second.frames(tree), self.samples(tree)
        twist = motion.twist(step)[:, :, None]
        points, nodes = motion.pose[a], motion.pose[b]
        pair = self._pair(tree)
        at = pair.of_samples(points, nodes)
        moved = samples.moved(samples.levers(points), twist[a]) - _carried(at, twist[b])
        reached = at.overlap > -NOWHERE
        closing, distance = where_each(
            reached, jnp.stack([-jnp.sum(at.normal * moved[..., 0], axis=1), at.distance], axis=1)
        ).T
        touching = fraction_to_contact(at.overlap, distance, closing, at.overlap < 0)
        apart, margin = pair.apart(points, nodes)
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
        may_hold = _of_pieces(self._pair(tree).may_touch(samples.piece))
        bends = self._bends(tree, coordinates)[samples.piece]

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            at, own = self.closest(tree, motion.pose), samples.levers(motion.pose[a])
            push = weight * jnp.maximum(at.overlap, 0.0)
            force = -push[:, None] * at.normal
            levers, weights = at.levers(0)
            touches = at.overlap > 0
            holds = (at.piece[:, None] == pieces) & may_hold
            chosen = where_each(touches, jnp.where(holds, 1.0, 0.0))
            # On both points beside the sample the force, on the nodes of its piece its opposite.
            pulls = jnp.zeros((tree.frames, PULL))
            lean = (push * at.distance)[:, None, None] * (square(at.normal) - np.eye(3))
            leaning = jnp.concatenate([jnp.zeros((len(push), 6)), lean[:, *_UPPER]], axis=1)
            for i, (points, nodes) in enumerate(((a[:-1], b[:-1]), (a[1:], b[1:]))):
                pull = _pulls(samples.share[:, i], own[:, i], force) + (leaning if i == 0 else 0.0)
                pull = jnp.dot(samples.of_piece, where_each(touches, pull))
                pulls += on_frames(pull, points, tree.frames)
                pull = chosen.T @ _pulls(weights[:, i], levers[:, i], force)
                pulls -= on_frames(pull, nodes, tree.frames)
            wrench, stiffness = _of_pulls(pulls)
            jacobian = motion.jacobian[:, :, moving]
            first, second = (jacobian[a[samples.piece + i]] for i in range(2))
            relative = _moves(samples.share[:, 1], own[:, 1], jnp.where(bends[:, None], second - first, 0.0))
            slid = jnp.zeros(relative.shape[::2])
            rates, rate_weights = at.levers(1)
            for i in range(2):
                node = jnp.where(bends[:, None], row(jacobian[b], at.piece + i) - first, 0.0)
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
            follows = jnp.where(at.free, push / jnp.where(at.free, at.curvature(), 1.0), 0.0)
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

    def _pair(self, tree: Tree) -> TubePair:
        return TubePair(tree, self.first, self.second)

    def _weight(self, tree: Tree) -> Float[AnyArray, " samples"]:
        """Of the length of tube that each sample stands for [N/m]."""
        return self.stiffness * self.samples(tree).length


def _of_pieces(nodes: Bool[np.ndarray, "points nodes"]) -> Bool[np.ndarray, "points pieces"]:
    """Of the piece that begins at each node; what holds for the last node holds for the last piece."""
    pieces = nodes[:, :-1].copy()
    pieces[:, -1] |= nodes[:, -1]
    return pieces


def _length(values: Float[Array, "points 3"]) -> Float[Array, " points"]:
    return jnp.sqrt(jnp.sum(values**2, axis=1) + 1e-30)


PULL = 12
"""Numbers of a force on a point: see `_pulls`."""

_UPPER = np.triu_indices(3)


def _pulls(
    share: Float[AnyArray, " points"],
    lever: Float[Array, "points 3"],
    force: Float[AnyArray, "points 3"],
) -> Float[Array, "points 12"]:
    """Of a constant force on what moves by share v + ω × lever: the force on v, its torque, and the second
    derivative of its work by ω."""
    outer = lever[:, :, None] * force[:, None]
    work = jnp.sum(lever * force, axis=1)[:, None, None]
    turn = 0.5 * (outer + jnp.swapaxes(outer, 1, 2)) - work * np.eye(3)
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
    return jnp.asarray(share)[:, None, None] * twists[:, 3:] - lie.hat(lever) @ twists[:, :3]


def _across(normal: Float[Array, "points 3"]) -> tuple[Float[Array, "points 3"], Float[Array, "points 3"]]:
    """Two unit vectors t₁, t₂ with n × t₁ = t₂; for a normal in the x-y plane the first one is too."""
    x, y, z = normal.T
    none = jnp.zeros_like(x)
    flat = (jnp.abs(z) < 0.9)[:, None]
    first = jnp.where(flat, jnp.stack([y, -x, none], axis=1), jnp.stack([none, z, -y], axis=1))
    first = first / jnp.sqrt(jnp.sum(first**2, axis=1))[:, None]
    return first, jnp.cross(normal, first)


def _carried(at: Closest, nodes: Float[Array, "nodes 6 some"]) -> Float[Array, "points 3 some"]:
    """How the closest places move at fixed t, from twists of the second tube's nodes."""
    levers, weights = at.levers(0)
    first, second = (_moves(weights[:, i], levers[:, i], row(nodes, at.piece + i)) for i in range(2))
    return first + second
