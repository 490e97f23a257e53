"""The renderer: tapered tubes → antialiased, shaded gray pictures.

A tube is the union of all spheres along its axis, the radius linear between nodes: the same bodies that
contact sees, and round at every joint and end. Each pixel looks up the sphere whose edge its centre is
deepest in (or nearest to). The signed distance to that edge gives the coverage, which ramps over one pixel,
and the sphere's normal gives Lambert shading under a light from above the camera. One sphere a pixel
leaves no seam between segments, and none is darkened twice.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float, UInt8
from numba import njit

from exosight.errors import InputError
from exosight.vision.camera import Camera, project

BACKGROUND = 235
"""Gray value of every pixel that no tube covers: light, so that both bodies stand out against it in
print, and a dark and a mid gray body keep three levels when contrast shrinks or noise clips at white."""

AMBIENT = 0.4  # share of light that reaches every surface; the rest falls off with the angle to the lamp
LIGHT_UP, LIGHT_TOWARDS_CAMERA = 0.6, 0.8  # no sideways part: a mirrored scene is a mirrored picture
FARTHEST = 1e6  # metres; a coordinate beyond it is a mistake in units


@dataclass(frozen=True)
class Tube:
    """A tapered tube along a polyline, frame by frame.

    centres  (frames, nodes, 3)  nodes of the axis, at least two [m]
    radii    (frames, nodes)     radius at each node, linear in between [m]
    shade    gray of the fully lit surface, 0 (black) … 1 (white)

    Raises InputError if shapes differ, a number is not finite, a radius is not positive, or
    the shade is outside 0…1.
    """

    centres: Float[np.ndarray, "frames nodes 3"]
    radii: Float[np.ndarray, "frames nodes"]
    shade: float

    def __post_init__(self):
        if self.centres.ndim != 3 or self.centres.shape[1] < 2 or self.centres.shape[2] != 3:
            raise InputError(
                f"tube centres: expected (frames, nodes, 3) in metres with at least two nodes, "
                f"got {self.centres.shape}; add a frame axis for a single pose"
            )
        if self.radii.shape != self.centres.shape[:2]:
            raise InputError(
                f"tube radii: expected one per node, {self.centres.shape[:2]}, got {self.radii.shape}; "
                f"repeat the radii for every frame"
            )
        if not np.all(np.abs(self.centres) <= FARTHEST):
            raise InputError(
                f"tube centres: expected finite metres within ±{FARTHEST:g}, got a value that is not; "
                f"drop frames that did not converge"
            )
        if not np.all((self.radii > 0) & (self.radii <= FARTHEST)):
            raise InputError(
                f"tube radii: expected positive metres up to {FARTHEST:g}, got a value that is not; "
                f"check the body's shape"
            )
        if not 0 <= self.shade <= 1:
            raise InputError(
                f"tube shade: expected 0 (black) to 1 (white), got {self.shade}; choose a gray between"
            )


def render(tubes: Sequence[Tube], camera: Camera) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures of one or more tubes, later tubes drawn over earlier ones.

    What lies outside the picture is clipped. Runs on one core and releases Python's lock, so that
    threads may render different frames at once.

    returns  (frames, height, width)  gray 0…255, BACKGROUND where there is no tube
    Raises InputError without a tube, or if the tubes differ in their number of frames.
    """
    counts = [len(tube.centres) for tube in tubes]
    if not counts or min(counts) != max(counts):
        raise InputError(
            f"tubes: expected at least one, all with the same number of frames, got frame counts {counts}; "
            f"pass one tube per body for the same frames"
        )
    images = np.full((counts[0], camera.height, camera.width), BACKGROUND, np.uint8)
    for tube in tubes:
        pixels = project(camera, tube.centres.astype(np.float64))
        radii = tube.radii.astype(np.float64) / camera.metres_per_pixel
        _draw(images, pixels, radii, float(tube.shade))
    return images


def _compiled(function: Callable) -> Callable:
    """Compile to machine code, kept on disk where some folder can be written, else in memory only.

    Without fast-math, so that pictures do not depend on the processor that compiled them.
    """
    try:
        return njit(cache=True, nogil=True)(function)
    except RuntimeError:  # neither the package's folder nor the user's cache folder can be written
        return njit(nogil=True)(function)


@_compiled
@no_type_check
def _draw(images, pixels, radii, shade):
    """Draw one tube on every frame, in place."""
    frames, height, width = images.shape
    # Of the sphere nearest to each pixel: distance to its edge (negative inside), how far the pixel lies
    # below its centre, and its radius [pixels].
    distance = np.empty((height, width))
    below = np.empty((height, width))
    radius = np.empty((height, width))
    for frame in range(frames):
        c, r = pixels[frame], radii[frame]
        top, bottom, left, right = _box(c, r, height, width)
        distance[top:bottom, left:right] = 1.0
        for node in range(len(r) - 1):
            _segment(distance, below, radius, c[node : node + 2], r[node : node + 2])
        for i in range(top, bottom):
            for j in range(left, right):
                # A tube thinner than a pixel covers no more than its own width of it.
                cover = min(0.5 - distance[i, j], 2.0 * radius[i, j], 1.0)
                if cover > 0.0:
                    away = distance[i, j] + radius[i, j]
                    towards = np.sqrt(max(radius[i, j] ** 2 - away**2, 0.0))
                    lit = (LIGHT_TOWARDS_CAMERA * towards - LIGHT_UP * below[i, j]) / max(away, radius[i, j])
                    light = AMBIENT + (1.0 - AMBIENT) * max(lit, 0.0)
                    under = float(images[frame, i, j])
                    images[frame, i, j] = int(under + cover * (255.0 * shade * light - under) + 0.5)


@_compiled
@no_type_check
def _box(c, r, height, width):
    """Rows top…bottom and columns left…right that discs c, r can touch, empty if outside the picture."""
    top = left = np.inf
    bottom = right = -np.inf
    for k in range(len(r)):
        left, right = min(left, c[k, 0] - r[k]), max(right, c[k, 0] + r[k])
        top, bottom = min(top, c[k, 1] - r[k]), max(bottom, c[k, 1] + r[k])
    # One pixel more, as coverage reaches half a pixel beyond the edge. Clamped before it becomes an integer.
    top, bottom = min(max(top - 1.0, 0.0), height), min(max(bottom + 1.0, 0.0), height)
    left, right = min(max(left - 1.0, 0.0), width), min(max(right + 1.0, 0.0), width)
    return int(top), int(bottom), int(left), int(right)


@_compiled
@no_type_check
def _segment(distance, below, radius, c, r):
    """Take over the pixels that are nearer to this segment than to those before it.

    Of all spheres between the two ends, the one nearest to a pixel has its centre u along the axis:
    the foot of the line from the pixel that is normal to the common tangent, clamped to the segment.
    """
    height, width = distance.shape
    top, bottom, left, right = _box(c, r, height, width)
    start = 0
    length = np.hypot(c[1, 0] - c[0, 0], c[1, 1] - c[0, 1])
    if abs(r[1] - r[0]) < (1.0 - 1e-9) * length:
        ex, ey = (c[1, 0] - c[0, 0]) / length, (c[1, 1] - c[0, 1]) / length
        taper = (r[1] - r[0]) / length
        lean = taper / np.sqrt(1.0 - taper * taper)
    else:  # one end lies within the other, and hides it
        ex = ey = taper = lean = length = 0.0
        start = 0 if r[0] > r[1] else 1
    for i in range(top, bottom):
        y = i + 0.5 - c[start, 1]
        near, down, size = distance[i, left:right], below[i, left:right], radius[i, left:right]
        for j in range(right - left):
            x = left + j + 0.5 - c[start, 0]
            u = min(max(x * ex + y * ey + lean * abs(y * ex - x * ey), 0.0), length)
            rad = r[start] + taper * u
            dx, dy = x - u * ex, y - u * ey
            d = np.sqrt(dx * dx + dy * dy) - rad
            take = d < near[j]
            near[j] = d if take else near[j]
            down[j] = dy if take else down[j]
            size[j] = rad if take else size[j]
