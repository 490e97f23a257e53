"""The renderer: tapered tubes → antialiased, shaded gray pictures.

A tube is the union of all spheres along its axis, the radius linear between nodes: the same bodies that
contact sees, and round at every joint and end. Each pixel looks up the sphere whose edge its centre is
deepest in (or nearest to). The signed distance to that edge gives the coverage, which ramps over one pixel,
and the sphere's normal gives Lambert shading under a light from above the camera. One sphere a pixel
leaves no seam between segments, and none is darkened twice.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float, UInt8

from exosight.errors import InputError
from exosight.system.camera import Camera, project
from exosight.vision.compiling import compiled

BACKGROUND = 235
"""Gray value of every pixel that no tube covers: light, so that both bodies stand out against it in
print, and a dark and a mid gray body keep three levels when contrast shrinks or noise clips at white."""

AMBIENT = 0.4
"""Share of light that reaches every surface; the rest falls off with the angle to the lamp."""
LAMP = (0.0, 0.6, 0.8)
"""Where the light comes from: right, up, towards the camera. No sideways part: a mirrored scene is a mirrored
picture."""
FARTHEST = 1e6  # metres; a coordinate beyond it is a mistake in units


@dataclass(frozen=True)
class Tube:
    """A tapered tube along a polyline, frame by frame.

    centres  (frames, nodes, 3)  nodes of the axis, at least two [m]
    radii    (frames, nodes)     radius at each node, linear in between [m]
    shade    gray of the fully lit surface, 0 (black) … 1 (white); one for all frames or (frames,)

    Raises InputError if shapes differ, a number is not finite, a radius is not positive, or
    the shade is outside 0…1.
    """

    centres: Float[np.ndarray, "frames nodes 3"]
    radii: Float[np.ndarray, "frames nodes"]
    shade: float | Float[np.ndarray, " frames"]

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
        shade = np.asarray(self.shade)
        if shade.shape not in ((), self.centres.shape[:1]) or not np.all((shade >= 0) & (shade <= 1)):
            raise InputError(
                f"tube shade: expected 0 (black) to 1 (white), one or one a frame, got {self.shade}; "
                f"choose a gray between"
            )


@dataclass(frozen=True)
class Light:
    """What the bodies of each frame are lit by.

    lamp     (frames, 3)  unit vector to the lamp: right, up, towards the camera [-]
    ambient  (frames,)    share of light that reaches every surface, 0…1

    Raises InputError if shapes differ, a lamp's direction has another length, or a share is outside 0…1.
    """

    lamp: Float[np.ndarray, "frames 3"]
    ambient: Float[np.ndarray, " frames"]

    def __post_init__(self):
        lengths = np.linalg.norm(self.lamp, axis=-1)
        if self.lamp.shape != (len(self.ambient), 3) or not np.all(np.abs(lengths - 1) < 1e-6):
            raise InputError(
                f"light: expected a unit vector to the lamp and an ambient share a frame, got "
                f"{self.lamp.shape} and {self.ambient.shape}; divide directions by their length"
            )
        if not np.all((self.ambient >= 0) & (self.ambient <= 1)):
            raise InputError("light: expected ambient shares within 0…1, got one outside")


def render(
    tubes: Sequence[Tube], camera: Camera, light: Light | None = None
) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures of one or more tubes, later tubes drawn over earlier ones.

    What lies outside the picture is clipped. Runs on one core and releases Python's lock, so that
    threads may render different frames at once.

    light    by default LAMP and AMBIENT for every frame
    returns  (frames, height, width)  gray 0…255, BACKGROUND where there is no tube
    Raises InputError without a tube, or if the tubes, or the light, differ in their number of frames.
    """
    counts = [len(tube.centres) for tube in tubes]
    if not counts or min(counts) != max(counts):
        raise InputError(
            f"tubes: expected at least one, all with the same number of frames, got frame counts {counts}; "
            f"pass one tube per body for the same frames"
        )
    images = np.full((counts[0], camera.height, camera.width), BACKGROUND, np.uint8)
    for tube in tubes:
        draw(images, tube, camera, light)
    return images


def draw(
    images: UInt8[np.ndarray, "frames height width"], tube: Tube, camera: Camera, light: Light | None = None
) -> None:
    """Draw one tube over pictures, in place.

    Raises InputError unless every picture has a pose, a light, and the camera's size.
    """
    frames = len(images)
    if light is None:
        light = Light(np.tile(LAMP, (frames, 1)), np.full(frames, AMBIENT))
    if not len(tube.centres) == len(light.lamp) == frames or images.shape[1:] != (
        camera.height,
        camera.width,
    ):
        raise InputError(
            f"draw: expected a pose and a light for each of {frames} pictures of "
            f"{camera.width}×{camera.height} pixels, got {len(tube.centres)} poses, {len(light.lamp)} lights "
            f"and pictures {images.shape[1:]}"
        )
    pixels = project(camera, tube.centres.astype(np.float64))
    radii = tube.radii.astype(np.float64) / camera.metres_per_pixel
    shade = np.broadcast_to(np.asarray(tube.shade, np.float64), (frames,))
    _draw(images, pixels, radii, shade, light.lamp, light.ambient)


@compiled
@no_type_check
def _draw(images, pixels, radii, shade, lamp, ambient):
    """Draw one tube on every frame, in place."""
    frames, height, width = images.shape
    # Of the sphere nearest to each pixel: distance to its edge (negative inside), and its segment.
    distance = np.empty((height, width))
    segment = np.empty((height, width))
    lines = np.empty((radii.shape[1] - 1, 8))
    for frame in range(frames):
        c, r = pixels[frame], radii[frame]
        right, up, towards = lamp[frame]
        bright, dim = 255.0 * shade[frame], ambient[frame]
        top, bottom, left, end = _box(c, r, height, width)
        distance[top:bottom, left:end] = 1.0
        for k in range(len(lines)):
            _line(lines[k], c[k : k + 2], r[k : k + 2])
            _segment(distance, segment, k, lines[k], c[k : k + 2], r[k : k + 2])
        for i in range(top, bottom):
            for j in range(left, end):
                if distance[i, j] >= 0.5:
                    continue
                x0, y0, r0, ex, ey, taper, lean, length = lines[int(segment[i, j])]
                beside, below, radius = _sphere(j + 0.5 - x0, i + 0.5 - y0, r0, ex, ey, taper, lean, length)
                # A tube thinner than a pixel covers no more than its own width of it.
                cover = min(0.5 - distance[i, j], 2.0 * radius, 1.0)
                away = distance[i, j] + radius
                out = np.sqrt(max(radius**2 - away**2, 0.0))
                lit = (towards * out - up * below + right * beside) / max(away, radius)
                light = dim + (1.0 - dim) * max(lit, 0.0)
                under = float(images[frame, i, j])
                images[frame, i, j] = int(under + cover * (bright * light - under) + 0.5)


@compiled
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


@compiled
@no_type_check
def _line(line, c, r):
    """What `_sphere` needs of a segment: start and its radius, direction, taper, lean and length."""
    length = np.hypot(c[1, 0] - c[0, 0], c[1, 1] - c[0, 1])
    start = 0
    if abs(r[1] - r[0]) < (1.0 - 1e-9) * length:
        ex, ey = (c[1, 0] - c[0, 0]) / length, (c[1, 1] - c[0, 1]) / length
        taper = (r[1] - r[0]) / length
        lean = taper / np.sqrt(1.0 - taper * taper)
    else:  # one end lies within the other, and hides it
        ex = ey = taper = lean = length = 0.0
        start = 0 if r[0] > r[1] else 1
    line[:] = c[start, 0], c[start, 1], r[start], ex, ey, taper, lean, length


@compiled
@no_type_check
def _sphere(x, y, r0, ex, ey, taper, lean, length):
    """Of all spheres of a segment the one nearest to a pixel: from its centre to the pixel, and its radius.

    The pixel lies x, y from the start, whose radius is r0; the axis runs along ex, ey. The sphere's
    centre lies u along the axis: the foot of the line from the pixel that is normal to the common tangent,
    clamped to the segment.
    """
    u = min(max(x * ex + y * ey + lean * abs(y * ex - x * ey), 0.0), length)
    return x - u * ex, y - u * ey, r0 + taper * u


@compiled
@no_type_check
def _segment(distance, segment, number, line, c, r):
    """Take over the pixels that are nearer to this segment than to those before it."""
    height, width = distance.shape
    top, bottom, left, right = _box(c, r, height, width)
    x0, y0, r0, ex, ey, taper, lean, length = line
    for i in range(top, bottom):
        near, owner = distance[i, left:right], segment[i, left:right]
        for j in range(right - left):
            x, y, radius = _sphere(left + j + 0.5 - x0, i + 0.5 - y0, r0, ex, ey, taper, lean, length)
            d = np.sqrt(x * x + y * y) - radius
            take = d < near[j]
            near[j] = d if take else near[j]
            owner[j] = number if take else owner[j]
