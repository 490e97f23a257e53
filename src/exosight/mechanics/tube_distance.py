"""Where two tubes, or one tube and itself, come closest.

The first tube's places between its rod's points (`Samples`) carry spheres of its radius; the second tube is
what spheres sweep along a curve through its rod's points: cubic Hermite pieces with the directions of the
cross-sections' normals and, for the radius, the slopes of parabolas. So its surface has no edges, and the
distance

    f = min over t of |p − c(t)| − r(t)

is as smooth as the curve wherever the closest place t is unique.

A rod touches itself between places further apart along it than FAR times the sum of their radii; each place
looks towards the tip, where a rod that curls up is convex as seen from its base. Places are searched only
from pieces of the first tube, and on groups of pieces of the second, that lie in balls close to each other.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.rod import Rod
from exosight.mechanics.surfaces import NOWHERE, Samples, Tube, hermite, slopes
from exosight.mechanics.tree import Tree

FAR = 1.9
"""A fifth more than a quarter turn: closer, a rod would be bent sharper than its own radius."""

STEPS = 4
"""To the closest place, from a secant. On exosuits of `index` three leave 5e-7 of a piece where it is apart,
and 5e-15 where it touches itself; four 7e-15 everywhere."""

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

    def levers(self, order: int) -> tuple[Float[Array, "points 2 3"], Float[Array, "points 2"]]:
        """Derivative by t of the share of the curve that each node moves: by weight v + ω × lever."""
        functions = hermite(self.t, order).reshape(-1, 2, 2)
        levers = functions[..., :1] * self.nodes.position + functions[..., 1:] * self.nodes.tangent
        return levers, functions[..., 0]

    def curvature(self) -> Float[Array, " points"]:
        """f_tt there [m]."""
        curve = _Cubic.of(self.nodes)
        return _slide(self.t, self.distance[:, None] * self.normal + curve.place_at(self.t), curve)[1]


class TubePair(NamedTuple):
    """Two tubes on a tree, or twice the same."""

    tree: Tree
    first: Tube
    second: Tube

    @property
    def samples(self) -> Samples:
        """Where on the first tube contact is integrated."""
        return self.first.samples(self.tree, SAMPLES)

    @property
    def itself(self) -> bool:
        """Whether both are tubes around one rod."""
        return self.first.rod == self.second.rod

    def of_samples(self, points: Float[Array, "points 4 4"], nodes: Float[Array, "nodes 4 4"]) -> Closest:
        """At the poses of both tubes' points."""
        samples = self.samples
        place = jnp.sum(samples.levers(points), axis=1)
        apart, margin = self.apart(points, nodes)
        some = jnp.min(apart, axis=1) < margin[:, 0]
        reached = (some[:, None] & (apart < margin))[samples.piece]
        found = self._closest(place, samples.radius, *self._candidates_of_samples(), nodes, reached)
        return found._replace(overlap=jnp.where(some[samples.piece], found.overlap, -NOWHERE))

    def of_points(self, points: Float[Array, "points 4 4"], nodes: Float[Array, "nodes 4 4"]) -> Closest:
        """Of the first tube's own points, searched on the whole second tube."""
        radius = jnp.asarray(self.first.radius)
        candidates = self._candidates(np.arange(len(radius)), self._lengthwise(), radius)
        every = np.ones((len(radius), len(self._groups())), bool)
        return self._closest(points[:, :3, 3], radius, *candidates, nodes, every)

    def apart(
        self, points: Float[Array, "points 4 4"], nodes: Float[Array, "nodes 4 4"]
    ) -> tuple[Float[Array, "pieces groups"], Float[Array, "pieces 1"]]:
        """How far balls around each piece of the first tube and around the next piece of each group of the
        second one that it may touch are apart; and up to where they are searched [m]."""
        samples = self.samples

        def ball(tube: Tube) -> Float[Array, " pieces"]:
            rod = self.tree[tube.rod]
            assert isinstance(rod, Rod)
            radius = jnp.asarray(tube.radius)
            return jnp.maximum(radius[1:], radius[:-1]) + HALF * rod.length * np.diff(rod.quadrature.points)

        far, _ = self._candidates_of_samples()
        # With the nodes of its end that samples of a piece may touch.
        may = (samples.of_piece @ jnp.where(far, 1.0, 0.0))[:, 1:] > 0
        may &= self.may_touch(np.arange(len(points) - 1))[:, 1:]
        between = _middles(points[:, :3, 3])[:, None] - _middles(nodes[:, :3, 3])
        apart = jnp.sqrt(jnp.sum(between**2, axis=-1)) + jnp.where(may, -ball(self.second), NOWHERE)
        own = ball(self.first)[:, None]
        least = [jnp.min(apart[:, group], axis=1) for group in self._groups()]
        return jnp.stack(least, axis=1) - own, MARGIN * own

    def may_touch(self, piece: Int[np.ndarray, " points"]) -> Bool[np.ndarray, "points nodes"]:
        """Which nodes places on these pieces are compared with: all of another rod; of its own, those towards
        the tip."""
        nodes = np.arange(len(self.second.frames(self.tree)))
        own = self.itself
        return nodes > piece[:, None] if own else np.ones((len(piece), len(nodes)), bool)

    def _groups(self) -> list[slice]:
        """The second tube's pieces, GROUP at a time."""
        pieces = len(self.second.frames(self.tree)) - 1
        return [slice(first, min(first + GROUP, pieces)) for first in range(0, pieces, GROUP)]

    def _closest(
        self,
        point: Float[Array, "points 3"],
        thick: Float[AnyArray, " points"],
        far: Bool[AnyArray, "points nodes"],
        may: Bool[np.ndarray, "points nodes"],
        nodes: Float[Array, "nodes 4 4"],
        reached: Bool[AnyArray, "points groups"],
    ) -> Closest:
        """Of spheres with these centres and radii, among the groups of pieces that are `reached`; `far` and
        `may`: see `_candidates`."""
        rod = self.tree[self.second.rod]
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
        for group, searched in zip(self._groups(), reached.T, strict=True):
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
        start, end = row(table, piece), row(table, piece + 1)
        length = start[:, 8]
        both = jnp.stack([start, end], axis=1)
        piece_nodes = Piece(
            both[..., :3],
            both[..., 3:6] * length[:, None, None],
            both[..., 6],
            both[..., 7] * length[:, None],
        )
        curve = _Cubic.of(piece_nodes)
        t = jnp.where(free, _solve(point, piece_nodes, curve), jnp.where(best > 0, 1.0, 0.0))
        between = point - curve.place_at(t)
        distance = jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30)
        other = _horner(curve.radius, t)
        overlap = jnp.where(least < NOWHERE, thick + other - distance, -NOWHERE)
        return Closest(piece, t, free, overlap, distance, between / distance[:, None], piece_nodes)

    def _lengthwise(self) -> Float[AnyArray, " points"]:
        """Distance of the first tube's points from its beginning, unbent [m]."""
        rod = self.tree[self.first.rod]
        assert isinstance(rod, Rod)
        return rod.length * rod.quadrature.points

    def _candidates_of_samples(
        self,
    ) -> tuple[Bool[AnyArray, "samples nodes"], Bool[np.ndarray, "samples nodes"]]:
        samples = self.samples
        along = samples.lumping.T @ self._lengthwise()
        return self._candidates(samples.piece, along, samples.radius)

    def _candidates(
        self,
        piece: Int[np.ndarray, " points"],
        along: Float[AnyArray, " points"],
        radius: Float[AnyArray, " points"],
    ) -> tuple[Bool[AnyArray, "points nodes"], Bool[np.ndarray, "points nodes"]]:
        """Which of its nodes a tube of these places and radii may touch: far enough apart along one rod, of
        two rods all, and which may be so (static).

        piece   beginning at which node, or later
        along   distance from the beginning of the tube [m]
        """
        may = self.may_touch(piece)
        if not self.itself:
            return jnp.ones(may.shape, bool), may
        second = jnp.asarray(self._lengthwise())
        return second[None] - along[:, None] > FAR * (radius[:, None] + jnp.asarray(self.second.radius)), may


def row(table: Float[Array, "nodes ..."], number: Int[Array, " points"]) -> Float[Array, "points ..."]:
    """The rows with these numbers, which lie inside."""
    return table.at[number].get(mode="promise_in_bounds")


def _middles(values: Float[Array, "points 3"]) -> Float[Array, "pieces 3"]:
    """Means of each point and the next one."""
    return 0.5 * (values[1:] + values[:-1])


class _Cubic(NamedTuple):
    """Curve and radius of pieces as polynomials: coefficients of 1, t, t², t³."""

    place: list[Float[Array, "points 3"]]
    radius: list[Float[Array, " points"]]

    @staticmethod
    def of(nodes: Piece) -> "_Cubic":
        """Those with the same ends and derivatives there."""

        def coefficients(ends: Array, rates: Array) -> list[Array]:
            way, first, last = ends[:, 1] - ends[:, 0], rates[:, 0], rates[:, 1]
            return [ends[:, 0], first, 3 * way - 2 * first - last, first + last - 2 * way]

        return _Cubic(coefficients(nodes.position, nodes.tangent), coefficients(nodes.radius, nodes.slope))

    def place_at(self, t: Float[Array, " points"]) -> Float[Array, "points 3"]:
        """c(t)."""
        return _horner(self.place, t[:, None])


def _horner(coefficients: list[Array], t: Array) -> Array:
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * t + coefficient
    return value


def _derivative(coefficients: list[Array]) -> list[Array]:
    return [order * coefficient for order, coefficient in enumerate(coefficients)][1:]


def _slide(
    t: Float[Array, " points"], point: Float[Array, "points 3"], curve: _Cubic
) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
    """f_t and f_tt of f = |p − c(t)| − r(t)."""
    rate, slope = _derivative(curve.place), _derivative(curve.radius)
    between, along = point - curve.place_at(t), _horner(rate, t[:, None])
    distance = jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30)
    normal = between / distance[:, None]
    on_normal = jnp.sum(normal * along, axis=1)
    second = (jnp.sum(along**2, axis=1) - on_normal**2) / distance
    second -= jnp.sum(normal * _horner(_derivative(rate), t[:, None]), axis=1)
    return -on_normal - _horner(slope, t), second - _horner(_derivative(slope), t)


def _solve(point: Float[Array, "points 3"], nodes: Piece, curve: _Cubic) -> Float[Array, " points"]:
    """The place t where f_t = 0, in pieces that hold one.

    Each step goes to the root of the parabola that has f_t and f_tt of the last place and f_t of the nearest
    one on the other side of the root: so it stays between these, where f_tt is zero or negative too.
    """
    between = point[:, None] - nodes.position
    distance = jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30)
    low, high = (-jnp.sum(between * nodes.tangent, axis=-1) / distance - nodes.slope).T
    start, end = jnp.zeros(len(point)), jnp.ones(len(point))
    t = jnp.clip(low / jnp.where(high - low > 0, low - high, -1.0), 0.0, 1.0)
    for _ in range(STEPS):
        first, second = _slide(t, point, curve)
        before = first < 0
        way, other = jnp.where(before, end, start) - t, jnp.where(before, high, low)
        start, low = jnp.where(before, t, start), jnp.where(before, first, low)
        end, high = jnp.where(before, end, t), jnp.where(before, high, first)
        bend = (other - first - second * way) / jnp.maximum(way**2, 1e-30)
        # Not zero, where the root has no derivative.
        root = jnp.sqrt(jnp.maximum(second**2 - 4 * first * bend, 1e-60))
        t = jnp.clip(t - 2 * first / jnp.maximum(second + root, 1e-30), 0.0, 1.0)
    return t
