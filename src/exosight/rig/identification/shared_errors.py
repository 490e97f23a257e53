"""Errors of outlines that all pictures of a rig share, and what they do to the parameters.

Blur, shading and the limits of masks misplace an edge by some hundredths of a pixel, differently where a
body is thick or thin, lit or in the shade, and alike in every picture. So more pictures do not average them
out. With bⱼ the error that is 1 pixel at one place along one side of a body, falling linearly to its
neighbours, and amplitudes of independent normal distributions with deviation s, an estimate with covariance C
and weights W has the covariance

    C + s² Σⱼ aⱼ aⱼᵀ,   aⱼ = C Jᵀ W bⱼ

(consider parameters: B. D. Tapley, B. E. Schutz, G. H. Born, Statistical Orbit Determination, 2004, ch. 6).
"""

import numpy as np
from jaxtyping import Float, Int

from exosight.rig.identification.distances import projected
from exosight.rig.identification.fit import Fit, Problem
from exosight.system.observation import body_axes

PLACES = 5
"""Along each side of a body, evenly spaced; measured errors change sign over a quarter of it or more."""


def shared_errors(problem: Problem, state: Fit) -> Float[np.ndarray, "points modes"]:
    """The errors bⱼ of all outlines [pixels]: of each tube, each side, each place.

    Points of an edge that two tubes share count with the tube that the outline names first.
    """
    numbers, camera = problem.numbers(state.x), problem.nominal.camera
    axes = body_axes(numbers.system, state.q)
    size, tubes = (camera.width, camera.height), numbers.system.tubes
    rows = []
    for k, outline in enumerate(problem.measured.outlines[: len(state.q)]):
        found = np.zeros((len(outline.points), len(tubes), 2, PLACES))
        for number, tube in enumerate(tubes):
            own = np.flatnonzero(outline.inside == number)
            axis, _ = projected(np.asarray(axes[tube.name][k]), np.asarray(tube.radius), numbers.view, size)
            place, side = _along(outline.points[own], np.asarray(axis))
            knot = place * (PLACES - 1)
            before = np.minimum(knot.astype(int), PLACES - 2)
            found[own, number, side, before] = 1 - (knot - before)
            found[own, number, side, before + 1] = knot - before
        rows.append(found.reshape(len(found), -1))
    return np.concatenate(rows)


def _along(
    points: Float[np.ndarray, "points 2"], axis: Float[np.ndarray, "nodes 2"]
) -> tuple[Float[np.ndarray, " points"], Int[np.ndarray, " points"]]:
    """Where along a polyline its nearest point is, as a share of its length, and on which side: 0 or 1."""
    ways = np.diff(axis, axis=0)
    lengths = np.maximum(np.linalg.norm(ways, axis=1), 1e-12)
    away = points[:, None] - axis[:-1]
    shares = np.clip(np.sum(away * ways, axis=-1) / lengths**2, 0, 1)
    nearest = np.argmin(np.linalg.norm(away - shares[..., None] * ways, axis=-1), axis=1)
    rows = np.arange(len(points))
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    place = (starts[nearest] + shares[rows, nearest] * lengths[nearest]) / starts[-1]
    way, off = ways[nearest], away[rows, nearest]
    return place, (way[:, 0] * off[:, 1] > way[:, 1] * off[:, 0]).astype(int)
