"""The renderer: tapered tubes → antialiased, shaded gray pictures.

A tube is the union of all spheres along its axis, the radius linear between nodes: the same bodies that
contact sees, and round at every joint and end. Each pixel looks up the sphere whose edge its centre is
deepest in (or nearest to). The signed distance to that edge gives the coverage, which ramps over one pixel,
and the sphere's normal gives Lambert shading under a light from above the camera. One sphere a pixel
leaves no seam between segments, and none is darkened twice.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from exosight.errors import InputError
from exosight.system.camera import Camera, Visibility, project_spheres
from exosight.vision.depth_order import draw_in_depth_order
from exosight.vision.tube_loops import draw_over

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
    tubes: Sequence[Tube], camera: Camera, light: Light | None = None, visibility: Visibility = "depth"
) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures of one or more tubes.

    What lies outside the picture is clipped. Runs on one core and releases Python's lock, so that
    threads may render different frames at once.

    light       by default LAMP and AMBIENT for every frame
    visibility  which tube is seen where several are, see `exosight.system.camera.Visibility`
    returns     (frames, height, width)  gray 0…255, BACKGROUND where there is no tube
    Raises InputError without a tube, or if the tubes, or the light, differ in their number of frames.
    """
    counts = [len(tube.centres) for tube in tubes]
    if not counts or min(counts) != max(counts):
        raise InputError(
            f"tubes: expected at least one, all with the same number of frames, got frame counts {counts}; "
            f"pass one tube per body for the same frames"
        )
    images = np.full((counts[0], camera.height, camera.width), BACKGROUND, np.uint8)
    if visibility == "stacked":
        for tube in tubes:
            draw(images, tube, camera, light)
        return images
    light = _light(light, counts[0])
    seen = [_pixels(tube, camera) for tube in tubes]
    draw_in_depth_order(
        images,
        np.concatenate([nodes for nodes, _ in seen], axis=1),
        np.concatenate([radii for _, radii in seen], axis=1),
        np.cumsum([0, *(tube.centres.shape[1] for tube in tubes)]),
        np.stack([_shades(tube) for tube in tubes], axis=1),
        light.lamp,
        light.ambient,
    )
    return images


def draw(
    images: UInt8[np.ndarray, "frames height width"], tube: Tube, camera: Camera, light: Light | None = None
) -> None:
    """Draw one tube over pictures, in place.

    Raises InputError unless every picture has a pose, a light, and the camera's size.
    """
    light = _light(light, len(images))
    if len(tube.centres) != len(images) or images.shape[1:] != (camera.height, camera.width):
        raise InputError(
            f"draw: expected a pose for each of {len(images)} pictures of {camera.width}×{camera.height} "
            f"pixels, got {len(tube.centres)} poses and pictures {images.shape[1:]}"
        )
    nodes, radii = _pixels(tube, camera)
    draw_over(images, nodes[..., :2], radii, _shades(tube), light.lamp, light.ambient)


def _light(light: Light | None, frames: int) -> Light:
    """The light of every frame; InputError for one of another number of frames."""
    if light is None:
        return Light(np.tile(LAMP, (frames, 1)), np.full(frames, AMBIENT))
    if len(light.lamp) != frames:
        raise InputError(f"light: expected one for each of {frames} pictures, got {len(light.lamp)}")
    return light


def _pixels(
    tube: Tube, camera: Camera
) -> tuple[Float[np.ndarray, "frames nodes 3"], Float[np.ndarray, "frames nodes"]]:
    """Column, row and depth of its nodes, and their radii [pixels]."""
    return project_spheres(camera, tube.centres.astype(np.float64), tube.radii.astype(np.float64))


def _shades(tube: Tube) -> Float[np.ndarray, " frames"]:
    return np.broadcast_to(np.asarray(tube.shade, np.float64), len(tube.centres))
