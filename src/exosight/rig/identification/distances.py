"""How far points of a picture lie from the outlines of a system in it, as JAX can differentiate it.

A tube is the union of all spheres along its axis. The signed distance of a point from its outline is that
from the nearest of these, |p − c| − r. Where two tubes press on each other, a picture in depth order shows
them divided at the plane of equal power of their nearest spheres (`exosight.vision.depth_order`), which a
point is

    (|p − c₁|² − r₁² − |p − c₂|² + r₂²) / 2 |c₁ − c₂|

away from.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.system.camera import Camera

TINY = 1e-12
"""Keeps roots differentiable [pixels²]."""


class Spheres(NamedTuple):
    """Of one tube, the spheres nearest to points: distance to the sphere's edge, its centre and radius."""

    distance: Float[Array, " points"]
    centre: Float[Array, "points 2"]
    radius: Float[Array, " points"]

    @property
    def power(self) -> Float[Array, " points"]:
        """|p − c|² − r²."""
        return self.distance * (self.distance + 2 * self.radius)


def view_of(camera: Camera) -> Float[np.ndarray, "10"]:
    """What `projected` needs of a camera: x and z of the centre [m], metres per pixel, roll, pan, tilt [rad],
    one over the distance [1/m], k₁ of the lens, and the principal point, from the middle [pixels]."""
    near = 0.0 if camera.distance is None else 1 / camera.distance
    return np.array(
        [
            *(*camera.centre, camera.metres_per_pixel, camera.roll, camera.pan, camera.tilt),
            *(near, camera.lens, *camera.principal),
        ]
    )


def projected(
    nodes: Float[AnyArray, "nodes 3"],
    radii: Float[AnyArray, " nodes"],
    view: Float[AnyArray, "10"],
    size: tuple[int, int],
) -> tuple[Float[Array, "nodes 2"], Float[Array, " nodes"]]:
    """Columns and rows of spheres and their radii [pixels], as `exosight.system.camera.project_spheres` does.

    An orthographic camera is a pinhole at an infinite distance.

    view   see `view_of`
    size   width and height of the image [pixels]
    """
    x, z, pixel, roll, pan, tilt, near, lens, right, down = view
    sin, cos = jnp.sin, jnp.cos
    along = jnp.stack([-sin(pan) * cos(tilt), cos(pan) * cos(tilt), -sin(tilt)])
    level = jnp.stack([cos(pan), sin(pan), jnp.zeros_like(pan)])
    below = jnp.cross(along, level)
    turn = jnp.stack([cos(roll) * level - sin(roll) * below, sin(roll) * level + cos(roll) * below, along])
    at = (jnp.asarray(nodes) - jnp.stack([x, jnp.zeros_like(x), z])) @ turn.T
    depth = 1 + near * at[:, 2]  # over the distance
    flat = at[:, :2] / depth[:, None]
    bent = lens * near**2 * jnp.sum(flat**2, axis=1)
    middle = np.array(size) / 2 + jnp.stack([right, down])
    found = middle + (1 + bent)[:, None] * flat / pixel
    radii = jnp.asarray(radii)
    return found, (1 + 2 * bent) * radii / (pixel * jnp.sqrt(depth**2 - (near * radii) ** 2))


def nearest_spheres(
    points: Float[AnyArray, "points 2"], axis: Float[AnyArray, "nodes 2"], radius: Float[AnyArray, " nodes"]
) -> Spheres:
    """The spheres of a tube that are nearest to points [pixels]; by its segment, which has no derivative."""
    axis, radius = jnp.asarray(axis), jnp.asarray(radius)
    fixed = jax.lax.stop_gradient((axis, radius))
    every = _on_segments(points[:, None], *_ends(*fixed))
    segment = jnp.argmin(every.distance, axis=1)
    return _on_segments(points, *(part[segment] for part in _ends(axis, radius)))


def distances(
    points: Float[AnyArray, "points 2"],
    inside: Int[AnyArray, " points"],
    outside: Int[AnyArray, " points"],
    tubes: Sequence[tuple[Float[AnyArray, "_ 2"], Float[AnyArray, " _"]]],
    offset: Float[AnyArray, " tubes"],
    stacked: bool,
) -> Float[Array, " points"]:
    """Signed distance of each point from the edge that it is said to be on [pixels].

    inside, outside   number of the tube on either side, the latter −1 for background, see `Outline`
    tubes             axis and radius of each [pixels]
    offset            by which each tube's outline is found outside of its true place [pixels]
    stacked           whether the tube that is named last covers the others
    """
    found = [nearest_spheres(points, *tube) for tube in tubes]
    distance = jnp.stack([spheres.distance for spheres in found])
    rows = jnp.arange(points.shape[0])
    free = distance[inside, rows] - jnp.asarray(offset)[inside]
    if stacked:  # the edge is that of the upper one, whose inside lies on the other side of it
        shared = -(distance[outside, rows] - jnp.asarray(offset)[outside])
    else:
        power = jnp.stack([spheres.power for spheres in found])
        centre = jnp.stack([spheres.centre for spheres in found])
        apart = centre[inside, rows] - centre[outside, rows]
        length = jnp.sqrt(jnp.sum(apart**2, axis=1) + TINY)
        shared = (power[inside, rows] - power[outside, rows]) / (2 * length)
    return jnp.where(outside < 0, free, shared)


Ends = tuple[Float[Array, "*segments 2"], Float[Array, "*segments 2"], Array, Array]


def _ends(axis: Float[Array, "nodes 2"], radius: Float[Array, " nodes"]) -> Ends:
    """Start, the way to the end, radius at the start and its change, of each segment."""
    return axis[:-1], jnp.diff(axis, axis=0), radius[:-1], jnp.diff(radius)


def _on_segments(
    points: Float[AnyArray, "*any 2"], start: Array, along: Array, radius: Array, growth: Array
) -> Spheres:
    """The nearest sphere of a segment; where one end lies within the other, the larger end."""
    squared = jnp.sum(along**2, axis=-1)
    conical: Bool[Array, "*any"] = growth**2 < (1 - 1e-9) * squared
    long = jnp.sqrt(jnp.where(conical, squared, 1.0))
    unit, taper = along / long[..., None], jnp.where(conical, growth / long, 0.0)
    away = points - start
    x = jnp.sum(away * unit, axis=-1)
    y = jnp.abs(away[..., 1] * unit[..., 0] - away[..., 0] * unit[..., 1])
    on_cone = jnp.clip((x + taper / jnp.sqrt(1 - taper**2) * y) / long, 0.0, 1.0)
    share = jnp.where(conical, on_cone, (growth > 0).astype(float))
    centre, thick = start + share[..., None] * along, radius + share * growth
    gap = points - centre
    return Spheres(jnp.sqrt(jnp.sum(gap**2, axis=-1) + TINY) - thick, centre, thick)
