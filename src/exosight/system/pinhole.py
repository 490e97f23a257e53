"""A pinhole camera with a lens, and how spheres look in it.

It looks at a target from a distance, nominally along +y with world z upwards, as the orthographic one does;
pixels are counted as there. At pan = tilt = roll = 0, with the distance D and the focal length f = D/s, the
picture tends to that of `Camera` with s metres a pixel as D grows.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.system.camera import LARGEST_SIDE, Metres

NEAREST = 1e-3
"""Least depth of what is drawn [m]: what is nearer, or behind the camera, is drawn as if it were there."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Pinhole:
    """Perspective camera that looks at a target."""

    target: tuple[Metres, Metres, Metres] = (0.05, 0.0, -0.005)
    """World point shown at the middle of the image [m]."""
    distance: Annotated[float, Field(ge=0.01, le=1000)] = 0.5
    """From the camera's centre of projection to the target [m]."""
    pan: Annotated[float, Field(ge=-1.5, le=1.5)] = 0.0
    """By which the camera goes to the right around the target, about the world's z [rad]."""
    tilt: Annotated[float, Field(ge=-1.5, le=1.5)] = 0.0
    """By which it then rises above the target [rad]."""
    roll: Annotated[float, Field(ge=-np.pi, le=np.pi)] = 0.0
    """By which the image is turned clockwise about its middle [rad]."""
    focal_length: Annotated[float, Field(ge=1.0, le=1e6)] = 455.0
    """Focal length [pixels]; width/(2 tan(½ angle of view))."""
    distortion: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    """Radial distortion at the image's corners, as a share of their distance; negative is a barrel."""
    width: Annotated[int, Field(ge=1, le=LARGEST_SIDE)] = 128
    """Image width [pixels]."""
    height: Annotated[int, Field(ge=1, le=LARGEST_SIDE)] = 128
    """Image height [pixels]."""

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Rows: image right, image down and the view's direction, in the world."""
        sin, cos = np.sin, np.cos
        view = np.array(
            [-sin(self.pan) * cos(self.tilt), cos(self.pan) * cos(self.tilt), -sin(self.tilt)]
        )
        right = np.array([cos(self.pan), sin(self.pan), 0.0])
        down = np.cross(view, right)
        return np.stack(
            [
                cos(self.roll) * right - sin(self.roll) * down,
                sin(self.roll) * right + cos(self.roll) * down,
                view,
            ]
        )

    @property
    def radial(self) -> float:
        """Coefficient k₁ of the lens: x' = x (1 + k₁ |x|²) for x = (right, down)/depth."""
        corner = np.hypot(self.width, self.height) / 2 / self.focal_length
        return self.distortion / corner**2


def project_spheres(
    camera: Pinhole, centres: Float[np.ndarray, "*batch 3"], radii: Float[np.ndarray, "*batch"]
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch"]]:
    """Where spheres are seen, and how large.

    With x = R (c − c₀) in the camera's frame, u = (x₁, x₂)/x₃ and k₁ of the lens,

        (column, row) = (width, height)/2 + f (1 + k₁|u|²) u,   radius = f (1 + 2 k₁|u|²) r/√(x₃² − r²),

    the outline of a sphere on the axis; elsewhere it is an ellipse longer by 1/cos of the angle from the
    axis, which is neglected. Depth is f ln(x₃/distance) [pixels]: it grows from the camera at the rate at
    which columns and rows grow, so that distances between neighbours have one scale in all directions.

    centres  (*batch, 3)  world [m]
    radii    (*batch,)    [m]; zero for points
    returns  (*batch, 3)  column, row and depth [pixels], and (*batch,) radii [pixels]
    """
    rotation = camera.rotation
    at = (centres - np.array(camera.target)) @ rotation.T
    depth = np.maximum(at[..., 2] + camera.distance, NEAREST)
    flat = at[..., :2] / depth[..., None]
    square = camera.radial * np.sum(flat**2, axis=-1)
    middle = np.array([camera.width, camera.height]) / 2
    seen = middle + camera.focal_length * (1 + square)[..., None] * flat
    away = camera.focal_length * np.log(depth / camera.distance)
    distance = np.sqrt(np.maximum(depth**2 - radii**2, NEAREST**2))
    size = camera.focal_length * (1 + 2 * square) * radii / distance
    return np.concatenate([seen, away[..., None]], axis=-1), size
