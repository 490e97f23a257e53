"""Residuals of a rig's pictures and readings, and their exact derivatives by what is unknown."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.rig.identification.distances import distances, projected
from exosight.rig.identification.outlines import Outline
from exosight.rig.identification.response import Response

CHUNK = 256
"""Points of a picture are filled up to a multiple of this, so that few sizes are compiled."""


class Picture(NamedTuple):
    """An outline, filled up with points that do not count."""

    points: Float[AnyArray, "points 2"]
    inside: AnyArray
    outside: AnyArray
    used: int


def filled(outline: Outline) -> Picture:
    """The points of an outline in a size that compiled code takes."""
    count = len(outline.points)
    fill = np.minimum(np.arange(-(-count // CHUNK) * CHUNK), count - 1)
    return Picture(outline.points[fill], outline.inside[fill], outline.outside[fill], count)


@partial(jax.jit, static_argnames=("size", "stacked"))
def _outline_rows(
    points: Float[AnyArray, "points 2"],
    sides: tuple[AnyArray, AnyArray],
    at: tuple[Sequence[AnyArray], Sequence[AnyArray], AnyArray, AnyArray],
    slopes: tuple[Sequence[AnyArray], Sequence[AnyArray], AnyArray, AnyArray],
    size: tuple[int, int],
    stacked: bool,
) -> tuple[Float[Array, " points"], Float[Array, "points unknowns"]]:
    """Distances of points from their edges [pixels], and their derivatives.

    at   axes and radii of tubes [m], view, and edge offsets [pixels]; slopes has another, last axis
    """

    def found(axes: Sequence[Array], radii: Sequence[Array], view: Array, offset: Array) -> Array:
        tubes = [projected(axis, radius, view, size) for axis, radius in zip(axes, radii, strict=True)]
        return distances(points, *sides, tubes, offset, stacked)

    value, push = jax.linearize(found, *at)
    slope = jax.vmap(push, in_axes=-1, out_axes=-1)(*slopes)
    return value, slope


def outline_rows(
    picture: Picture,
    value: Response,
    slope: Response,
    view: tuple[Float[AnyArray, "10"], Float[AnyArray, "10 parameters"]],
    offset: Float[np.ndarray, " tubes"],
    offset_deviation: float,
    size: tuple[int, int],
    stacked: bool,
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points unknowns"]]:
    """Distances of a picture's points from the model's outline [pixels], by parameters and then edge offsets.

    slope              by the first of the parameters; nothing else depends on the others but the view
    view               and its derivatives by all of them, see `Numbers`
    offset             of each tube's edge [pixels]; its unknown counts in deviations
    """
    tubes, parameters = len(offset), view[1].shape[-1]

    def widened(leaf: AnyArray) -> np.ndarray:
        leaf = np.asarray(leaf)
        none = np.zeros((*leaf.shape[:-1], parameters + tubes - leaf.shape[-1]))
        return np.concatenate([leaf, none], axis=-1)

    own = np.concatenate([np.zeros((tubes, parameters)), offset_deviation * np.eye(tubes)], axis=1)
    at = (value.axes, value.radii, view[0], offset)
    slopes = (tuple(map(widened, slope.axes)), tuple(map(widened, slope.radii)), widened(view[1]), own)
    found, derivative = _outline_rows(
        picture.points, (picture.inside, picture.outside), at, slopes, size, stacked
    )
    return np.asarray(found)[: picture.used], np.asarray(derivative)[: picture.used]
