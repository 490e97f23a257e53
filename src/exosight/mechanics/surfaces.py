"""Surfaces that press: tubes around rods, tapered solids along the axes of bodies, and planes.

A tube is what spheres sweep along a smooth curve through its rod's points: cubic Hermite pieces with the
directions of the cross-sections' normals, and for the radius the slopes of parabolas through three points.
"""

from functools import lru_cache
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.quadrature import Gauss
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import point_stiffness
from exosight.mechanics.tree import Tree

TIP = 0.5
"""Length of rod that its round end counts for, in radii: the secant of Hertz's sphere at 0.14 radii, of which
the force is 4/3 E* √r d^1.5, against the line's π/4 E* d a length."""

NOWHERE = 1e3
"""Stands for the distance [m] of what cannot touch."""

SAMPLES = 2.5
"""Places of contact on solids for each piece between a rod's points, in the mean. A round end is touched
along 1 to 2 mm, the points of the published exosuit are up to 3.7 mm apart."""

TIP_PART, TIP_DENSITY = 0.15, 2
"""Share of a tube towards its end, and how much denser places are there: what a round end touches, it touches
with little of its length, and a fingertip at two zones half a millimetre apart."""


def line_stiffness(young: float, poisson: float) -> float:
    """π/4 · E/(1 − ν²): force a length and a depth of a long cylinder pressed on a flat rigid body [N/m²].

    Source: V. L. Popov, Contact Mechanics and Friction (2010), section 5.2. It neglects that a line contact
    also depends, by a logarithm, on how thick the body is.
    """
    return np.pi / 4 * young / (1 - poisson**2)


class Samples(NamedTuple):
    """Places along a tube at which its contact is integrated, each between two points of the rod.

    A place moves by Σ share v + ω × (share p + along d) over the two points p, with velocities v and ω and
    directions d of the normals of their cross-sections.

    piece     (samples,)     number of the first of the two points (static)
    share     (samples, 2)   of the motion of the two points (static)
    along     (samples, 2)   how far it follows their directions [m]
    radius    (samples,)     of the tube there [m]
    length    (samples,)     of tube that it stands for, the round end with the last one [m]
    lumping   (points, samples)   share of what acts on it that each of the rod's points stands for (static)
    """

    piece: Int[np.ndarray, " samples"]
    share: Float[np.ndarray, "samples 2"]
    along: Float[AnyArray, "samples 2"]
    radius: Float[AnyArray, " samples"]
    length: Float[AnyArray, " samples"]
    lumping: Float[np.ndarray, "points samples"]

    @property
    def of_piece(self) -> Float[np.ndarray, "pieces samples"]:
        """1 for the samples of each piece, else 0."""
        return (np.arange(len(self.lumping) - 1)[:, None] == self.piece).astype(float)

    def levers(self, pose: Float[Array, "points 4 4"]) -> Float[Array, "samples 2 3"]:
        """share p + along d of both points, whose sum is the place itself, in the world [m]."""
        ends = pose[np.stack([self.piece, self.piece + 1], axis=1)]
        return ends[..., :3, 3] * self.share[..., None] + ends[..., :3, 0] * self.along[..., None]

    def moved(
        self, levers: Float[Array, "samples 2 3"], points: Float[Array, "points 6 some"]
    ) -> Float[Array, "samples 3 some"]:
        """How the places move, from twists of the rod's points."""
        ends = points[np.stack([self.piece, self.piece + 1], axis=1)]
        turning = lie.hat(levers) @ ends[..., :3, :]
        return jnp.sum(self.share[..., None, None] * ends[..., 3:, :] - turning, axis=1)

    def on_points(
        self, levers: Float[Array, "samples 2 3"], force: Float[AnyArray, "samples 3"]
    ) -> tuple[Float[Array, "samples 6"], Float[Array, "samples 6"]]:
        """Spatial wrenches on both points of forces at the places [N m; N]."""
        first, second = (
            jnp.concatenate([jnp.cross(levers[:, i], force), self.share[:, i, None] * force], axis=1)
            for i in range(2)
        )
        return first, second

    def stiffness(
        self, levers: Float[Array, "samples 2 3"], force: Float[Array, "samples 3"]
    ) -> tuple[Float[Array, "samples 6 6"], Float[Array, "samples 6 6"]]:
        """Second derivatives of constant forces' work by twists of the first and of the second point.

        A place is a sum of what moves with either, so nothing couples them.
        """
        factors = np.ones((len(self.share), 2, 6, 6))
        factors[..., 3:, :3] = factors[..., :3, 3:] = self.share[..., None, None]
        first, second = (point_stiffness(levers[:, i], force) * factors[:, i] for i in range(2))
        return first, second

    def spread(
        self, push: Float[AnyArray, " samples"], force: Float[AnyArray, "points 3"]
    ) -> Float[Array, "samples 3"]:
        """Forces on the rod's points, where the part of the normal forces acts that each stands for.

        push   normal forces [N]
        """
        part = self.lumping * push
        whole = jnp.sum(part, axis=1, keepdims=True)
        return jnp.where(whole > 0, part / jnp.where(whole > 0, whole, 1.0), 0.0).T @ force


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

    def samples(self, tree: Tree, each: float) -> Samples:
        """Places for contact whose patch may be shorter than the distance of the rod's points.

        each   how many for each piece between these, in the mean
        """
        rod = tree[self.rod]
        assert isinstance(rod, Rod)
        piece, functions, weight, lumping = _places(rod.quadrature, round(each * (rod.frames - 1)))
        spacing = rod.length * np.diff(rod.quadrature.points)
        radius = jnp.asarray(self.radius)
        ends = np.stack([piece, piece + 1], axis=1)
        own = jnp.stack([radius, slopes(radius, spacing)], axis=1)[ends]
        along = functions[..., 1] * spacing[piece][:, None]
        thick = jnp.sum(functions[..., 0] * own[..., 0] + along * own[..., 1], axis=1)
        last = np.zeros(len(piece))
        last[-1] = TIP
        length = rod.length * weight + last * radius[-1]
        return Samples(piece, functions[..., 0], along, thick, length, lumping)


@lru_cache(maxsize=64)
def _places(
    quadrature: Gauss, count: int
) -> tuple[
    Int[np.ndarray, " samples"],
    Float[np.ndarray, "samples 2 2"],
    Float[np.ndarray, " samples"],
    Float[np.ndarray, "points samples"],
]:
    """Middles of equal parts of [0, 1], shorter ones towards the end, and the end: the piece of each, Hermite
    functions of both its points (value, slope), weight, and shares of both by linear interpolation."""
    points = quadrature.points
    before, after = round(count * (1 - TIP_PART)), round(count * TIP_PART * TIP_DENSITY)
    edges = np.concatenate(
        [np.linspace(0, 1 - TIP_PART, before + 1), np.linspace(1 - TIP_PART, 1, after + 1)[1:]]
    )
    place = np.append(0.5 * (edges[1:] + edges[:-1]), 1.0)
    piece = np.clip(np.searchsorted(points, place) - 1, 0, len(points) - 2)
    t = (place - points[piece]) / np.diff(points)[piece]
    weight = np.append(np.diff(edges), 0.0)
    lumping = np.zeros((len(points), len(t)))
    lumping[piece, np.arange(len(t))] = 1 - t
    lumping[piece + 1, np.arange(len(t))] = t
    with jax.ensure_compile_time_eval():
        functions = np.asarray(hermite(t, 0)).reshape(-1, 2, 2)
    return piece, functions, weight, lumping


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


def slopes(values: Float[Array, " nodes"], spacing: Float[AnyArray, " pieces"]) -> Float[Array, " nodes"]:
    """Derivative at the nodes, of the parabola through each and its neighbours."""
    secant = jnp.diff(values) / spacing
    inner = (secant[:-1] * spacing[1:] + secant[1:] * spacing[:-1]) / (spacing[1:] + spacing[:-1])
    return jnp.concatenate([secant[:1], inner, secant[-1:]])


def hermite(t: Float[AnyArray, " points"], order: int) -> Float[Array, "points 4"]:
    """Derivatives by t of the cubic Hermite functions of (start, its tangent, end, its tangent)."""
    one = jnp.ones_like(t)
    columns = (
        (one - t * t * (3 - 2 * t), t * (1 - t) ** 2, t * t * (3 - 2 * t), t * t * (t - 1)),
        (6 * t * (t - 1), (1 - t) * (1 - 3 * t), 6 * t * (1 - t), t * (3 * t - 2)),
        (12 * t - 6, 6 * t - 4, 6 - 12 * t, 6 * t - 2),
    )[order]
    return jnp.stack(columns, axis=1)
