"""The camera: an orthographic picture of the x–z plane at a fixed scale.

It looks along +y, so without a roll world x runs to the right and world z runs up. Pixel coordinates are
(column, row) with the origin at the upper left corner of the picture: pixel (j, i) covers columns j…j+1 and
rows i…i+1, and its centre lies at (j + 0.5, i + 0.5).
"""

import dataclasses
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.errors import InputError

Metres = Annotated[float, Field(ge=-1000, le=1000)]
LARGEST_SIDE = 8192  # pixels
Visibility = Literal["depth", "stacked"]
"""Which of several tubes a pixel shows: `depth`, the surface that is nearest to the camera; `stacked`, the
tube that the system names last. `stacked` shows how deep tubes in contact overlap, which no camera sees; of
the presets, `published` alone is seen so."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Camera:
    """Orthographic camera that looks along +y onto the x–z plane."""

    centre: tuple[Metres, Metres] = (0.05, -0.005)
    """World point (x, z) shown at the middle of the image [m]."""
    metres_per_pixel: Annotated[float, Field(ge=1e-9, le=1e3)] = 0.0011
    """Side of one square pixel in the world [m]."""
    width: Annotated[int, Field(ge=1, le=LARGEST_SIDE)] = 128
    """Image width [pixels]."""
    height: Annotated[int, Field(ge=1, le=LARGEST_SIDE)] = 128
    """Image height [pixels]."""
    roll: Annotated[float, Field(ge=-np.pi, le=np.pi)] = 0.0
    """By which the image is turned clockwise about its middle, as of a camera turned the other way [rad]."""


def project(camera: Camera, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
    """Pixel coordinates of world points.

    (column, row) = (width, height)/2 + R(roll) (x − x_centre, z_centre − z)/s,  s = metres per pixel.

    points   (*batch, 3)  world [m]; y, the depth, does not matter
    returns  (*batch, 2)  column and row [pixels]; pixel centres lie at integer + 0.5
    """
    x, z = camera.centre
    right = (points[..., 0] - x) / camera.metres_per_pixel
    up = (points[..., 2] - z) / camera.metres_per_pixel
    sine, cosine = np.sin(camera.roll), np.cos(camera.roll)
    return np.stack(
        [
            camera.width / 2 + (cosine * right + sine * up),
            camera.height / 2 - (cosine * up - sine * right),
        ],
        axis=-1,
    )


def resized(camera: Camera, width: int, height: int) -> Camera:
    """The same view in another image size.

    The centre stays, and the scale is the finest at which everything that was visible still is. With
    the same aspect ratio the field of view is the same; with another, it grows along one side.

    width, height  new image size [pixels]
    Raises InputError if a side is not within 1…8192 pixels.
    """
    for name, side in (("width", width), ("height", height)):
        if not 1 <= side <= LARGEST_SIDE:
            raise InputError(
                f"{name}: expected 1 to {LARGEST_SIDE} pixels, got {side}; choose another image size"
            )
    scale = max(camera.width / width, camera.height / height) * camera.metres_per_pixel
    return dataclasses.replace(camera, metres_per_pixel=scale, width=width, height=height)
