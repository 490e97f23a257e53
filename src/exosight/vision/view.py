"""Another camera's view of a finished picture: shifted, turned, enlarged, tilted, through a real lens.

A pixel at p (column, row) of the nominal picture, seen from its middle c as d = p − c, moves to

    p' = c + t + d',   d' / (1 + k |d'|²/ρ²) = e,   e = perspective(zoom · R(roll) d)

where ρ is the distance of a corner from the middle, and perspective turns the plane of the scene by tilt_x,
then tilt_y, in front of a pinhole DISTANCE picture widths away. The lens is the division model, in closed
form both ways: Fitzgibbon, doi 10.1109/CVPR.2001.990465.
"""

from collections.abc import Mapping
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Float, Float64, UInt8

from exosight.vision.compiling import compiled

DISTANCE = 4.0
"""From the camera to the scene, in widths of the picture: 56 cm for the nominal field of view of 14 cm."""

Picture = UInt8[np.ndarray, "height width"]
Columns = Mapping[str, Float[np.ndarray, " frames"]]
"""Those of a `View`, by name."""


def homographies(columns: Columns, width: int, height: int) -> Float64[np.ndarray, "frames 3 3"]:
    """The part of a view before its lens: d → e, homogeneous [pixels]."""
    roll, zoom = columns["roll"], columns["zoom"]
    zero, one = np.zeros_like(roll), np.ones_like(roll)
    turned = _matrix(
        (zoom * np.cos(roll), -zoom * np.sin(roll), zero),
        (zoom * np.sin(roll), zoom * np.cos(roll), zero),
        (zero, zero, one),
    )
    sin_x, cos_x = np.sin(columns["tilt_x"]), np.cos(columns["tilt_x"])
    sin_y, cos_y = np.sin(columns["tilt_y"]), np.cos(columns["tilt_y"])
    # Points (x, y, 0) of the scene, turned in space; depth grows away from the camera.
    far = DISTANCE * width
    tilted = _matrix(
        (cos_y, -sin_y * sin_x, zero), (zero, cos_x, zero), (sin_y / far, cos_y * sin_x / far, one)
    )
    return tilted @ turned


def transformed_points(
    columns: Columns, points: Float[np.ndarray, "frames points 2"], width: int, height: int
) -> Float64[np.ndarray, "frames points 2"]:
    """Where points of the nominal pictures are seen.

    points         (frames, points, 2)  column and row [pixels]
    width, height  of the pictures [pixels]
    returns        (frames, points, 2)  column and row [pixels]
    """
    middle = np.array([width, height]) / 2
    d = np.concatenate([points - middle, np.ones((*points.shape[:2], 1))], axis=-1)
    e = d @ np.swapaxes(homographies(columns, width, height), 1, 2)
    e = e[..., :2] / e[..., 2:]
    # With x = k |e|²/ρ², s = |d'|/|e| is the smaller root of x s² − s + 1 = 0. Beyond x = ¼ nothing is seen.
    corner = np.sum(middle**2)
    x = columns["distortion"][:, None, None] * np.sum(e**2, axis=-1, keepdims=True) / corner
    stretch = 2 / (1 + np.sqrt(np.maximum(1 - 4 * x, 0)))
    shift = np.stack([columns["shift_x"] * width, columns["shift_y"] * height], axis=-1)
    return middle + shift[:, None] + stretch * e


def remapped(
    pictures: tuple[Picture, ...],
    homography: Float64[np.ndarray, "3 3"],
    distortion: float,
    shift: tuple[float, float],
) -> list[Picture]:
    """Pictures of one scene as another camera sees them; beyond their borders they go on as they end.

    shift  to the right and downwards [pixels]
    """
    columns = np.empty(pictures[0].shape, np.float32)
    rows = np.empty(pictures[0].shape, np.float32)
    _sources(np.linalg.inv(homography), distortion, shift[0], shift[1], columns, rows)
    return [
        np.asarray(
            cv2.remap(each, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8
        )
        for each in pictures
    ]


def _matrix(*rows: tuple[np.ndarray, ...]) -> np.ndarray:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@compiled
@no_type_check
def _sources(back, distortion, shift_x, shift_y, columns, rows):
    """Where in the nominal picture each pixel of another view comes from, as OpenCV counts pixels."""
    height, width = columns.shape
    x0, y0 = width / 2.0, height / 2.0
    corner = x0 * x0 + y0 * y0
    for i in range(height):
        for j in range(width):
            x, y = j + 0.5 - x0 - shift_x, i + 0.5 - y0 - shift_y
            # e = d'/lens; in homogeneous coordinates that is (d', lens).
            lens = 1.0 + distortion * (x * x + y * y) / corner
            depth = back[2, 0] * x + back[2, 1] * y + back[2, 2] * lens
            columns[i, j] = (back[0, 0] * x + back[0, 1] * y + back[0, 2] * lens) / depth + x0 - 0.5
            rows[i, j] = (back[1, 0] * x + back[1, 1] * y + back[1, 2] * lens) / depth + y0 - 0.5
