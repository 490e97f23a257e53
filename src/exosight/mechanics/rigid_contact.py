"""Contact of rigid solids with each other, or with a plane: a force f = k d n for an overlap d.

Two solids touch with their closest spheres (`cones`), so the force acts at one point of each pair, and moves
along parallel solids as they rock on each other; a solid touches a plane with the spheres at its two ends. At
an end that two neighbours of a chain share both press. Normal forces only.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.cones import SPREAD, Cones, between, dot, slide, smooth_pair
from exosight.mechanics.contact import Pressing, fraction_to_contact
from exosight.mechanics.kinematics import Motion, at_points, spread
from exosight.mechanics.surfaces import Plane, Solids
from exosight.mechanics.term import (
    Bound,
    Configuration,
    Expansion,
    Term,
    on_frames,
    point_stiffness,
    point_wrench,
    square,
    zero,
)
from exosight.mechanics.tree import Tree


class Pairs(NamedTuple):
    """Pairs of spheres, one on each side, that may touch.

    overlap    (pairs,)        [m]; negative: gap
    normal     (pairs, 3)      unit vector from the second to the first, in the world
    centre     (pairs, 2, 3)   of the first and the second; of a plane, the foot [m]
    distance   (pairs,)        between the centres; of a plane, the radius at the first [m]
    bent       (pairs,)        curvature of the surface through the first centre [1/m]; of a plane 0
    slide      (pairs, 2, 6)   with the first solid's twist ξ, |slide ξ|² is what −f gains as s and t follow
    solid      (pairs, 2)      number of the solid on each side; of a plane, 0
    place      (pairs, 2)      of the centres, along the solids from their beginnings [m]
    """

    overlap: Float[Array, " pairs"]
    normal: Float[Array, "pairs 3"]
    centre: Float[Array, "pairs 2 3"]
    distance: Float[Array, " pairs"]
    bent: Float[Array, " pairs"]
    slide: Float[Array, "pairs 2 6"]
    solid: Int[np.ndarray, "pairs 2"]
    place: Float[Array, "pairs 2"]


class RigidContact(Term):
    """Contact of every solid of `first` with every one of `second`, or with a plane.

    stiffness   ()   k [N/m]
    """

    first: Solids
    second: Solids | Plane
    stiffness: Float[AnyArray, ""]

    def frames(self, tree: Tree) -> list[int]:
        """The first solids, then the second ones."""
        return [*self.first.index(tree).tolist(), *self.second.index(tree).tolist()]

    def pairs(self, tree: Tree, pose: Float[Array, "frames 4 4"]) -> Pairs:
        """What may touch, at poses of all frames."""
        return self._pairs(pose[np.array(self.frames(tree), int)])

    def energy(self, tree: Tree, at: Configuration, loads: Float[Array, " loads"]) -> Float[Array, ""]:
        """Σ ½ k max(d, 0)²."""
        depth = jnp.maximum(self._pairs(at.pose).overlap, 0.0)
        return 0.5 * jnp.sum(self.stiffness * depth**2)

    def forces(
        self, tree: Tree, pose: Float[Array, "frames 4 4"]
    ) -> tuple[Float[AnyArray, "pairs 3"], Pairs]:
        """The force on the first side of each pair, in the world [N], and where it acts."""
        at = self.pairs(tree, pose)
        return self.stiffness * jnp.maximum(at.overlap, 0.0)[:, None] * at.normal, at

    def point_frames(self, tree: Tree) -> np.ndarray:
        """The frame of each pair's first solid."""
        return self.first.index(tree)[self._numbers[:, 0]]

    def partner_frames(self, tree: Tree) -> np.ndarray:
        """The frames of the second side."""
        return self.second.index(tree)

    def point_stiffness(self, tree: Tree) -> Float[AnyArray, " pairs"]:
        """Of each pair [N/m]."""
        return self.stiffness * np.ones(len(self._numbers))

    def pressing(self, tree: Tree, motion: Motion) -> Pressing:
        """What each pair's first solid presses on."""
        at = self.pairs(tree, motion.pose)
        on_first, on_second = self._sides(tree, at)
        length, radius = (jnp.asarray(x)[at.solid[:, 0]] for x in (self.first.length, self.first.radius))
        thickness = radius[:, 0] + at.place[:, 0] / length * (radius[:, 1] - radius[:, 0])
        sides = ((on_first, self.first), (on_second, self.second))
        own, other = (
            at_points(jnp.einsum("ps,siq->piq", on, motion.jacobian[side.index(tree)]), at.centre[:, 0])
            for on, side in sides
        )
        closing = -jnp.einsum("pi,pia->pa", at.normal, own - other)
        touching = jnp.where(at.overlap > 0, self.stiffness, 0.0)
        return Pressing(
            jnp.asarray(at.solid[:, 1] * 1.0),
            at.centre[:, 0] - (thickness - 0.5 * at.overlap)[:, None] * at.normal,
            at.normal,
            self.stiffness * jnp.maximum(at.overlap, 0.0),
            touching[:, None] * closing,
            touching,
        )

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Fraction to slightly beyond the first contact of an open pair; the expansion there contains it."""
        at, twist = self.pairs(tree, motion.pose), motion.twist(step)
        on_first, on_second = self._sides(tree, at)
        relative = on_first @ twist[self.first.index(tree)] - on_second @ twist[self.second.index(tree)]
        closing = -dot(at.normal, relative[:, 3:] + jnp.cross(relative[:, :3], at.centre[:, 0]))
        just_touching_too = at.overlap <= 0  # as links often do at first
        return fraction_to_contact(at.overlap, at.distance, closing, just_touching_too)

    def bind(self, tree: Tree) -> Bound:
        """As in `SolidContact`: the energy depends on the motion of the first side against the second."""
        a, b = self.first.index(tree), self.second.index(tree)
        move_a, move_b = tree.moving(a), tree.moving(b)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            at = self.pairs(tree, motion.pose)
            on_first, on_second = self._sides(tree, at)
            push = self.stiffness * jnp.maximum(at.overlap, 0.0)
            along = square(at.normal)
            bend = jnp.where(at.overlap > 0, self.stiffness, 0.0)[:, None, None] * along
            bend -= (push * at.bent)[:, None, None] * (jnp.eye(3) - along)
            force = -push[:, None] * at.normal
            own = point_stiffness(at.centre[:, 0], force, bend)
            own += push[:, None, None] * (jnp.swapaxes(at.slide, 1, 2) @ at.slide)
            wrench = point_wrench(at.centre[:, 0], force)
            of_first = motion.jacobian[a][at.solid[:, 0]][:, :, np.array(move_a, int)]
            of_second = jnp.einsum("ps,siq->piq", on_second, motion.jacobian[b][:, :, np.array(move_b, int)])
            coupled = (own + 0.5 * lie.coad(wrench)) @ of_second
            block = -jnp.einsum("pia,pib->ab", of_first, coupled)
            hessian = spread(spread(block.T, move_a, tree.dofs).T, move_b, tree.dofs)
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(push * jnp.maximum(at.overlap, 0.0)),
                wrench=on_frames(on_first.T @ wrench, a, tree.frames)
                - on_frames(on_second.T @ wrench, b, tree.frames),
                stiffness=on_frames(jnp.einsum("ps,pij->sij", on_first, own), a, tree.frames)
                + on_frames(jnp.einsum("ps,pij->sij", on_second, own), b, tree.frames),
                hessian=hessian + hessian.T,
            )

        return expand

    @property
    def _numbers(self) -> Int[np.ndarray, "pairs 2"]:
        """The solids of each pair; both ends of a solid with a plane."""
        count = len(self.first.frames)
        if isinstance(self.second, Plane):
            return np.stack([np.repeat(np.arange(count), 2), np.zeros(2 * count, int)], axis=1)
        return np.stack([i.ravel() for i in np.indices((count, len(self.second.frames)))], axis=1)

    def _sides(self, tree: Tree, at: Pairs) -> tuple[Float[Array, "pairs some"], Float[Array, "pairs other"]]:
        """Which frame of each side a pair has: 1, else 0; the world has none."""
        first, second = (
            jnp.asarray(np.equal.outer(at.solid[:, i], np.arange(len(side.index(tree)))), float)
            for i, side in enumerate((self.first, self.second))
        )
        return first, second

    def _pairs(self, pose: Float[Array, "frames 4 4"]) -> Pairs:
        """At poses of the term's own frames."""
        count = len(self.first.frames)
        cones = _cones(self.first, pose[:count])
        if isinstance(self.second, Plane):
            return _with_plane(cones, self.second, pose[count:], self._numbers)
        return _with_solids(cones, _cones(self.second, pose[count:]), self._numbers)


def _cones(solids: Solids, pose: Float[Array, "cones 4 4"]) -> Cones:
    radius = jnp.asarray(solids.radius)
    along = jnp.asarray(solids.length)[:, None] * pose[:, :3, 0]
    return Cones(pose[:, :3, 3], along, radius[:, 0], radius[:, 1] - radius[:, 0])


def _with_plane(
    cones: Cones, plane: Plane, pose: Float[Array, "frames 4 4"], numbers: Int[np.ndarray, "pairs 2"]
) -> Pairs:
    """Both ends of each solid."""
    which, end = numbers[:, 0], np.tile([0.0, 1.0], len(cones.radius))
    ends = Cones(*(part[which] for part in cones))
    centre, radius = ends.centre(end), ends.thickness(end)
    origin, normal = plane.in_world(pose)
    height = (centre - origin) @ normal
    centres = jnp.stack([centre, centre - height[:, None] * normal], axis=1)
    place = end * jnp.sqrt(dot(ends.along, ends.along))
    return Pairs(
        radius - height,
        jnp.broadcast_to(normal, centre.shape),
        centres,
        radius,
        jnp.zeros_like(radius),
        jnp.zeros((len(which), 2, 6)),
        numbers,
        jnp.stack([place, jnp.zeros_like(place)], axis=1),
    )


def _with_solids(first: Cones, second: Cones, numbers: Int[np.ndarray, "pairs 2"]) -> Pairs:
    i, j = numbers.T
    a, b = Cones(*(part[i] for part in first)), Cones(*(part[j] for part in second))
    extra = SPREAD * (a.radius + b.radius + 0.5 * (a.taper + b.taper)) / 2
    s, t = smooth_pair(a, b, extra)
    gap, distance = between(a, b, s, t)
    long = [jnp.sqrt(dot(cones.along, cones.along)) for cones in (a, b)]
    return Pairs(
        a.thickness(s) + b.thickness(t) - distance - 0.5 * extra * ((s - 0.5) ** 2 + (t - 0.5) ** 2),
        gap / distance[:, None],
        jnp.stack([a.centre(s), b.centre(t)], axis=1),
        distance,
        1 / distance,
        slide(a, b, extra, s, t),
        numbers,
        jnp.stack([s * long[0], t * long[1]], axis=1),
    )
