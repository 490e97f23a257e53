"""Outlines of the bodies in a picture, found to a small part of a pixel.

Every pixel gets a label, background or body. Along the normal of each label's edge the picture is sampled,
and the edge is found where it conserves light (`edges`). Two bodies that touch share one edge; it belongs to
both. Where a profile crosses more than two things (another body close by, the border of the picture, what a
mask leaves open) there is no point.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import contourpy
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage

from exosight.errors import DataError
from exosight.rig.identification.edges import NEAR, REACH, Limb, balance, sampled, thickness

BACKGROUND = -1
"""In the place of a body's number: no body."""
UNKNOWN = 255
"""In masks: what a pixel shows is not known, such as the mount, a hand or a cable before the device."""

SMALLEST = 30
"""Points that an outline needs; a body 2 pixels thick and 15 long has as many."""
_DARKER = 8
"""Least gray values from the brightest body to half covered pixels, and from those to the background."""
_FEWEST = 4
"""Pixels of a gray that only one body has, from which it is told."""
_END, _SHARED_END = 2, 3
"""Points left out at either end of a stretch, and of one that two bodies share, beyond which they part
slowly."""
_STEP = 0.25  # between samples [pixels]


@dataclass(frozen=True)
class Outline:
    """Points on the edges of the bodies in one picture, in order along each edge.

    points    (points, 2)   column and row [pixels], pixel centres at integer + 0.5
    inside    (points,)     number of the body whose edge it is
    outside   (points,)     number of the body on the other side, or BACKGROUND
    run       (points,)     number of the unbroken stretch of edge that the point is on
    """

    points: Float[np.ndarray, "points 2"]
    inside: Int[np.ndarray, " points"]
    outside: Int[np.ndarray, " points"]
    run: Int[np.ndarray, " points"]


def outline_of_picture(
    picture: UInt8[np.ndarray, "height width"], shades: Sequence[float], name: str = "picture"
) -> Outline:
    """The outlines in a gray picture of bodies of these shades on a bright, even background.

    shades   gray of each body's brightest place, 0 black … 1 white; see `TubeSurface.shade`

    Raises DataError, beginning with `name`, for a picture without these bodies.
    """
    gray = picture.astype(float)
    background = int(np.argmax(np.bincount(picture.ravel())))
    labels = _labels(picture, background, shades, name)
    return _outline(labels, gray, len(shades), name)


def outline_of_mask(mask: UInt8[np.ndarray, "height width"], bodies: int, name: str = "mask") -> Outline:
    """The outlines in a mask: 0 background, 1 the first body, 2 the second …, UNKNOWN what is hidden.

    Raises DataError, beginning with `name`, for other values, or a body that is not there.
    """
    wrong = mask[(mask > bodies) & (mask != UNKNOWN)]
    if wrong.size:
        raise DataError(
            f"{name}: expected 0 for background, 1 to {bodies} for the bodies and {UNKNOWN} for what is not "
            f"known, got {wrong[0]}"
        )
    labels = np.where(mask == UNKNOWN, UNKNOWN, mask.astype(int) - 1)
    return _outline(labels, None, bodies, name)


def _labels(
    picture: UInt8[np.ndarray, "height width"], background: int, shades: Sequence[float], name: str
) -> Int[np.ndarray, "height width"]:
    """What each pixel shows: flooded from pixels whose gray only one body has, up to edges."""
    ranges = [(0.4 * 255 * shade, 255 * shade) for shade in shades]
    if background < max(high for _, high in ranges) + 2 * _DARKER:
        raise DataError(
            f"{name}: expected an even background brighter than the device, got gray {background} most "
            "often; give masks instead of such pictures"
        )
    covered = picture < (background + max(high for _, high in ranges)) / 2
    whole = np.asarray(ndimage.binary_erosion(covered, np.ones((3, 3), bool), border_value=1), bool)
    markers = np.zeros(picture.shape, np.int32)
    for body, (low, high) in enumerate(ranges):
        own = whole & (picture >= low - 2) & (picture <= high + 2)
        for other, (bottom, top) in enumerate(ranges):
            if other != body:
                own &= (picture < bottom - 4) | (picture > top + 4)
        own = _thick(own)
        if own.sum() < _FEWEST:
            raise DataError(
                f"{name}: no pixel has the gray of body {body + 1} alone; it is not in the picture, or its "
                "shade is too near to another one's: give masks instead"
            )
        markers[own] = body + 1
    markers[~whole] = len(shades) + 1
    edges = np.where(whole, ndimage.morphological_gradient(picture, size=(3, 3)), 255).astype(np.uint8)
    flooded = np.asarray(ndimage.watershed_ift(edges, markers)).astype(int) - 1
    nearest = np.asarray(
        ndimage.distance_transform_edt(~whole, return_distances=False, return_indices=True), dtype=int
    )
    # Half covered pixels have about the mean of both grays; they show the body that is nearest.
    device = whole | (picture < (background + picture[nearest[0], nearest[1]].astype(float)) / 2)
    labels = np.where(device, flooded[nearest[0], nearest[1]], BACKGROUND)
    for body in range(len(shades)):
        labels[_specks(labels == body)] = UNKNOWN
    return labels


def _thick(own: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """Without what is less than 5 pixels thick, or 3, where that leaves anything.

    Across the blurred edge of a dark body grays pass through those of a brighter one, as thin lines.
    """
    for size in (5, 3):
        opened = np.asarray(ndimage.binary_opening(own, np.ones((size, size), bool)), bool)
        if opened.sum() >= _FEWEST:
            return opened
    return own


def _specks(own: Bool[np.ndarray, "height width"]) -> Bool[np.ndarray, "height width"]:
    """What of a body's pixels is not connected with the most of them: mixed grays in narrow gaps."""
    parts = np.zeros(own.shape, np.int32)
    ndimage.label(own, output=parts)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return own & (sizes[parts] < 0.1 * sizes.max())


def _outline(
    labels: Int[np.ndarray, "height width"],
    gray: Float[np.ndarray, "height width"] | None,
    bodies: int,
    name: str,
) -> Outline:
    """The points of all bodies; an edge that two share only from the one with the lower number."""
    found: list[tuple[np.ndarray, int, np.ndarray]] = []
    for body in range(bodies):
        own = ndimage.gaussian_filter((labels == body).astype(float), 0.7)
        count = 0
        for line in contourpy.contour_generator(z=own).lines(0.5):
            for points, outside in _stretches(np.asarray(line), own, labels, gray, body):
                count += len(points)
                keep = (outside == BACKGROUND) | (outside > body)
                found += [
                    (points[part], body, outside[part]) for part in _runs(np.where(keep, outside, -2), -2)
                ]
        if count < SMALLEST:
            raise DataError(
                f"{name}: expected an outline of body {body + 1}, got {count} points of one; the picture "
                "does not show the device, or is too coarse"
            )
    sizes = [len(points) for points, _, _ in found]
    return Outline(
        points=np.concatenate([points for points, _, _ in found]) + 0.5,
        inside=np.repeat([body for _, body, _ in found], sizes),
        outside=np.concatenate([outside for _, _, outside in found]),
        run=np.repeat(np.arange(len(found)), sizes),
    )


def _runs(values: Int[np.ndarray, " points"], none: int) -> Iterator[slice]:
    """Stretches of equal values, but of `none`."""
    ends = np.flatnonzero(np.diff(values)) + 1
    for start, stop in zip([0, *ends], [*ends, len(values)], strict=True):
        if values[start] != none and stop > start:
            yield slice(start, stop)


def _stretches(
    line: Float[np.ndarray, "nodes 2"],
    own: Float[np.ndarray, "height width"],
    labels: Int[np.ndarray, "height width"],
    gray: Float[np.ndarray, "height width"] | None,
    body: int,
) -> Iterator[tuple[Float[np.ndarray, "points 2"], Int[np.ndarray, " points"]]]:
    """Points on the edge near a closed line, a pixel apart, with what is beyond; where there is any."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    if along[-1] < 8:  # a speck
        return
    at = np.arange(0.5, along[-1], 1.0)
    points = np.stack([np.interp(at, along, line[:, i]) for i in range(2)], axis=1)
    rows, columns = np.gradient(own)
    slope = np.stack([sampled(columns, points), sampled(rows, points)], axis=1)
    normal = -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
    t = np.arange(-REACH, REACH + _STEP / 2, _STEP)
    places = points[:, None] + t[:, None] * normal[:, None]
    height, width = labels.shape
    inside = np.all((places >= 0) & (places <= [width - 1, height - 1]), axis=(1, 2))
    beyond = ndimage.map_coordinates(labels, np.moveaxis(places[..., ::-1], -1, 0), order=0, mode="nearest")
    outer, inner = beyond[:, t > 0.8], beyond[:, (t < -0.8) & (t >= -NEAR)]
    clear = inside & np.all(outer == outer[:, :1], axis=1) & np.all(inner == body, axis=1)
    clear &= (outer[:, 0] != UNKNOWN) & (outer[:, 0] != body)
    if gray is None:
        profile = sampled(own, places.reshape(-1, 2)).reshape(places.shape[:2])
        shift = np.trapezoid(profile, t, axis=1) - REACH
    else:
        profile = sampled(gray, places.reshape(-1, 2)).reshape(places.shape[:2])
        free, behind = outer[:, 0] == BACKGROUND, np.full(len(points), 2.0)
        for other in np.unique(outer[clear & ~free, 0]):
            at = outer[:, 0] == other
            behind[at] = thickness(labels == other, points[at], normal[at])
        own_limb = Limb(normal, thickness(labels == body, points, -normal))
        shift, valid = balance(profile, t, own_limb, Limb(-normal, behind, free))
        clear &= valid
    clear &= np.abs(shift) < 1.5
    outside = np.where(clear, outer[:, 0], -2)
    edge = points + shift[:, None] * normal
    for part in _runs(outside, -2):
        end = _END if outside[part.start] == BACKGROUND else _SHARED_END
        if part.stop - part.start > 2 * end:  # where three things meet, an edge is not straight
            part = slice(part.start + end, part.stop - end)
            yield edge[part], outside[part]
