"""The camera: a picture of the x–z plane at a fixed scale, or in perspective from a finite distance.

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
Offset = Annotated[float, Field(ge=-LARGEST_SIDE, le=LARGEST_SIDE)]
Visibility = Literal["depth", "stacked"]
"""Which of several tubes a pixel shows: `depth`, the surface that is nearest to the camera; `stacked`, the
tube that the system names last. `stacked` shows how deep tubes in contact overlap, which no camera sees; of
the presets, `published` alone is seen so."""


NEAREST = 1e-3
"""Least depth of what a pinhole camera shows [m]: what is nearer is shown as if it were there."""


def _unsaid(value: float | tuple[float, float] | None) -> bool:
    """Whether an entry of a pinhole is left out of files: those of orthographic cameras stay as they were."""
    return not value or value == (0.0, 0.0)


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Camera:
    """Orthographic camera that looks along +y onto the x–z plane; with a distance, a pinhole with a lens.

    The pinhole looks at the world point (x_centre, 0, z_centre), from where `pan` and `tilt` take it, and has
    the focal length distance/metres_per_pixel [pixels]; the point is shown at the principal point. As the
    distance grows, its picture becomes that of the orthographic camera. Raises a validation error for a
    direction, a principal point or a lens without a distance.
    """

    centre: tuple[Metres, Metres] = (0.05, -0.005)
    """World point (x, z) shown at the middle of the image, of a pinhole at its principal point [m]."""
    metres_per_pixel: Annotated[float, Field(ge=1e-9, le=1e3)] = 0.0011
    """Side of one square pixel in the world, of a pinhole at its centre [m]."""
    width: Annotated[int, Field(ge=1, le=LARGEST_SIDE)] = 128
    """Image width [pixels]."""
    height: Annotated[int, Field(ge=1, le=LARGEST_SIDE)] = 128
    """Image height [pixels]."""
    roll: Annotated[float, Field(ge=-np.pi, le=np.pi)] = 0.0
    """By which the image is turned clockwise about its middle, as of a camera turned the other way [rad]."""
    distance: Annotated[float | None, Field(ge=0.01, le=1000, exclude_if=_unsaid)] = None
    """From the pinhole to the centre [m]; None: orthographic."""
    pan: Annotated[float, Field(ge=-1.5, le=1.5, exclude_if=_unsaid)] = 0.0
    """By which the pinhole goes to the right around the centre, about the world's z [rad]."""
    tilt: Annotated[float, Field(ge=-1.5, le=1.5, exclude_if=_unsaid)] = 0.0
    """By which it then rises above the centre [rad]."""
    distortion: Annotated[float, Field(ge=-0.2, le=0.2, exclude_if=_unsaid)] = 0.0
    """Radial distortion half an image's diagonal from the principal point, as a share of this distance;
    negative is a barrel."""
    principal: Annotated[tuple[Offset, Offset], Field(exclude_if=_unsaid)] = (0.0, 0.0)
    """Principal point, where the optical axis meets the image: right of its middle, and below it [pixels]."""

    def __post_init__(self) -> None:
        if self.distance is None and (self.pan or self.tilt or self.distortion or any(self.principal)):
            raise ValueError(
                "pan, tilt, distortion and principal: expected a pinhole camera with a distance, got none"
            )

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """World to camera: rows point to the image's right, to its lower end, and along the view."""
        sin, cos = np.sin, np.cos
        view = np.array([-sin(self.pan) * cos(self.tilt), cos(self.pan) * cos(self.tilt), -sin(self.tilt)])
        right = np.array([cos(self.pan), sin(self.pan), 0.0])
        down = np.cross(view, right)
        turned = cos(self.roll) * right - sin(self.roll) * down
        return np.stack([turned, sin(self.roll) * right + cos(self.roll) * down, view])

    @property
    def lens(self) -> float:
        """Coefficient k₁ of the radial distortion x (1 + k₁|x|²), x = (right, down)/depth."""
        corner = np.hypot(self.width, self.height) / 2 * self.metres_per_pixel / (self.distance or np.inf)
        return self.distortion / corner**2 if self.distortion else 0.0


def project(camera: Camera, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
    """Pixel coordinates of world points.

    Orthographic: (column, row) = (width, height)/2 + R(roll) (x − x_centre, z_centre − z)/s with
    s = metres per pixel; a pinhole's are those of `project_spheres`.

    points   (*batch, 3)  world [m]; y, the depth, does not matter to an orthographic camera
    returns  (*batch, 2)  column and row [pixels]; pixel centres lie at integer + 0.5
    """
    if camera.distance is not None:
        return project_spheres(camera, points, np.zeros(points.shape[:-1]))[0][..., :2]
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
    coarser = max(camera.width / width, camera.height / height)
    right, down = camera.principal
    return dataclasses.replace(
        camera,
        metres_per_pixel=coarser * camera.metres_per_pixel,
        width=width,
        height=height,
        principal=(right / coarser, down / coarser),
    )


def project_spheres(
    camera: Camera, centres: Float[np.ndarray, "*batch 3"], radii: Float[np.ndarray, "*batch"]
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch"]]:
    """Where spheres are seen, and how large.

    Orthographic: as `project`, depth y/s and radius r/s. Of a pinhole with the focal length f, its distance D
    and the lens k₁, with x in the camera's frame (right, down, along the view) and u = (x₁, x₂)/x₃,

        (column, row) = (width, height)/2 + f (1 + k₁|u|²) u,   radius = f (1 + 2 k₁|u|²) r/√(x₃² − r²):

    the outline of a sphere on the axis; elsewhere it is an ellipse longer by 1/cos of the angle from the
    axis, which is neglected. Depth is f ln(x₃/D): it grows from the camera at the rate at which columns and
    rows grow, so that distances between neighbours have one scale in all directions. The lens is Brown's,
    Decentering distortion of lenses, Photogrammetric Engineering 32, 1966, with its first term alone.

    centres  (*batch, 3)  world [m]
    radii    (*batch,)    [m]
    returns  (*batch, 3)  column, row and depth [pixels], and (*batch,) radii [pixels]
    """
    if camera.distance is None:
        depth = centres[..., 1:2] / camera.metres_per_pixel
        return np.concatenate([project(camera, centres), depth], axis=-1), np.asarray(
            radii / camera.metres_per_pixel
        )
    focal_length = camera.distance / camera.metres_per_pixel
    target = np.array([camera.centre[0], 0.0, camera.centre[1]])
    at = (centres - target) @ camera.rotation.T
    far = np.maximum(at[..., 2] + camera.distance, NEAREST)
    flat = at[..., :2] / far[..., None]
    bent = camera.lens * np.sum(flat**2, axis=-1)
    middle = np.array([camera.width, camera.height]) / 2 + camera.principal
    seen = middle + focal_length * (1 + bent)[..., None] * flat
    depth = focal_length * np.log(far / camera.distance)
    size = focal_length * (1 + 2 * bent) * radii / np.sqrt(np.maximum(far**2 - radii**2, NEAREST**2))
    return np.concatenate([seen, depth[..., None]], axis=-1), np.asarray(size)
