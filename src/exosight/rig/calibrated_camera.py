"""What a calibration found, as a camera of a system and as entries of its file."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float
from pydantic import ValidationError

from exosight.errors import InputError
from exosight.rig.charuco import Calibration
from exosight.system.camera import Camera
from exosight.system.file import Values
from exosight.validation import first_fault
from exosight.vision.pictures import Crop, same_aspect

BOARD_IN_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""The board's axes, right, down and into it, as columns of world axes: it stands in the x–z plane and is seen
from the side of negative y, its upper edge along x."""


def with_lens(camera: Camera, found: Calibration, crop: Crop | None = None) -> Camera:
    """The camera with the lens of a calibration; direction, and size and place of what it shows, stay.

    crop   the part of the calibration's pictures that the camera shows; by default all of them

    Raises InputError for another aspect ratio than that of the camera, a crop that leaves the pictures, or a
    lens that no camera may have.
    """
    (columns, rows), (width, height) = found.size, (camera.width, camera.height)
    if crop is None:
        if not same_aspect((rows, columns), width, height):
            raise InputError(
                f"pictures: expected the aspect ratio of the system file's camera, {width}×{height} pixels, "
                f"got {columns}×{rows}; say with --crop which part of them it shows, or change its size"
            )
        crop = (0, 0, columns)
    left, top, side = crop
    high = side * height / width
    if not (left >= 0 and top >= 0 and side >= 1 and left + side <= columns and top + round(high) <= rows):
        raise InputError(
            f"crop: expected a part of {side}×{round(high)} pixels within {columns}×{rows}, got {left} {top} "
            f"{side}"
        )
    finer = width / side
    focal_length = finer * found.focal_length[0]
    right, down = finer * (found.principal[0] - [left + side / 2, top + high / 2])
    # What was in the middle of the image stays there; the centre is what the principal point shows.
    ahead = np.array([right - camera.principal[0], camera.principal[1] - down]) * camera.metres_per_pixel
    sine, cosine = np.sin(camera.roll), np.cos(camera.roll)
    x, z = camera.centre
    corner = np.hypot(width, height) / 2 / focal_length
    return _checked(
        camera,
        centre=(x + cosine * ahead[0] - sine * ahead[1], z + sine * ahead[0] + cosine * ahead[1]),
        distance=focal_length * camera.metres_per_pixel,
        distortion=found.radial[0] * corner**2,
        principal=(float(right), float(down)),
    )


def placed(
    camera: Camera,
    rotation: Float[np.ndarray, "3 3"],
    translation: Float[np.ndarray, "3"],
    corner: tuple[float, float, float],
) -> Camera:
    """The pinhole camera where it was when it showed a board that stands along the x–z plane.

    rotation, translation   board to camera, see `Calibration`
    corner                  the board's upper left corner in the world [m]

    Raises InputError if it does not look at the x–z plane from the side of negative y.
    """
    assert camera.distance is not None
    turn = rotation @ BOARD_IN_WORLD.T
    at, view = np.asarray(corner) - turn.T @ translation, turn[2]
    away = -at[1] / view[1] if view[1] > 0 else -1.0
    if away <= 0:
        raise InputError(
            "board: expected the camera before the x–z plane, the board upright and facing it, got it "
            "behind; choose another picture, or turn the board by half a turn"
        )
    pan, tilt = np.arctan2(-view[0], view[1]), -np.arcsin(view[2])
    level = dataclasses.replace(camera, pan=float(pan), tilt=float(tilt), roll=0.0).rotation
    target = at + away * view
    return _checked(
        camera,
        centre=(float(target[0]), float(target[2])),
        metres_per_pixel=camera.metres_per_pixel * away / camera.distance,
        distance=float(away),
        pan=float(pan),
        tilt=float(tilt),
        roll=float(np.arctan2(turn[1] @ level[0], turn[0] @ level[0])),
    )


def with_camera(values: Values, name: str, camera: Camera) -> Values:
    """The entries of a system file with another camera of a name."""
    entries: dict[str, Any] = {
        "centre": [_metres(middle) for middle in camera.centre],
        "pixel": _metres(camera.metres_per_pixel),
        "width": camera.width,
        "height": camera.height,
        "roll": f"{camera.roll!r} rad",
    }
    if camera.distance is not None:
        entries |= {
            "distance": _metres(camera.distance),
            "pan": f"{camera.pan!r} rad",
            "tilt": f"{camera.tilt!r} rad",
            "distortion": camera.distortion,
            "principal": list(camera.principal),
        }
    return {**values, "cameras": {**values["cameras"], name: entries}}


def _metres(length: float) -> str:
    return f"{length!r} m"


def _checked(camera: Camera, **entries: Any) -> Camera:
    """The camera with other entries; InputError for what no camera may have."""
    try:
        return dataclasses.replace(camera, **entries)
    except ValidationError as error:
        raise InputError(f"the calibrated camera: {first_fault(error)}") from None
