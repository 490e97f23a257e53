"""What the camera looks at: the finger and the exosuit worn above it, as two tubes."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from exosight.exosuit.assembly import QUADRATURE, Exosuit, Pose
from exosight.exosuit.shapes import radius
from exosight.system.camera import Camera
from exosight.vision.lighting import EXOSUIT_SHADE, FINGER_SHADE, Lighting
from exosight.vision.renderer import BACKGROUND, Tube, render


def tubes(
    centreline: Float[np.ndarray, "frames points 3"],
    rod_radii: Float[np.ndarray, "#frames points"] | Float[np.ndarray, " points"],
    finger: Float[np.ndarray, "frames nodes 3"],
    finger_radii: Float[np.ndarray, "#frames nodes"] | Float[np.ndarray, " nodes"],
    finger_shade: float | Float[np.ndarray, " frames"] = FINGER_SHADE,
    exosuit_shade: float | Float[np.ndarray, " frames"] = EXOSUIT_SHADE,
) -> tuple[Tube, Tube]:
    """The finger and the exosuit, in the order in which they are drawn.

    The exosuit is drawn last: where the bodies press on each other, the picture shows its whole outline.

    centreline    (frames, points, 3)           the exosuit's axis [m]
    rod_radii     (points,) or (frames, points) the exosuit's radius along it [m]
    finger        (frames, nodes, 3)            joints and tip of the finger [m]
    finger_radii  (nodes,) or (frames, nodes)   the finger's radius there [m]
    returns       the tubes to pass to `exosight.vision.render`

    Raises InputError if shapes differ or a number is not finite.
    """
    return (
        Tube(finger, _for_each_frame(finger_radii, finger), finger_shade),
        Tube(centreline, _for_each_frame(rod_radii, centreline), exosuit_shade),
    )


def picture(
    exosuit: Exosuit, pose: Pose, camera: Camera, lighting: Lighting | None = None
) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures of a worn exosuit.

    pose      of this exosuit, with one batch dimension: the frames
    lighting  shades and light of each frame; by default the nominal ones
    returns   (frames, height, width)  gray 0…255
    """
    bodies = _bodies(exosuit, pose)
    if lighting is None:
        return render(tubes(*bodies), camera)
    return render(tubes(*bodies, lighting.finger_shade, lighting.exosuit_shade), camera, lighting.light)


def cover(exosuit: Exosuit, pose: Pose, camera: Camera) -> UInt8[np.ndarray, "frames height width"]:
    """How much of each pixel finger and exosuit cover, 0…255, as `exosight.vision.augment` takes it."""
    black = render(tubes(*_bodies(exosuit, pose), 0.0, 0.0), camera)
    return np.rint((1 - np.arange(BACKGROUND + 1) / BACKGROUND) * 255).astype(np.uint8)[black]


def _bodies(exosuit: Exosuit, pose: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.asarray(pose.centreline),
        radius(exosuit.shape.surface, QUADRATURE.points),
        np.asarray(pose.finger),
        np.asarray(exosuit.finger.radii),
    )


def _for_each_frame(radii: Any, centres: Any) -> Any:
    """Radii of the nodes, repeated where every frame has the same; `Tube` judges the shape."""
    return np.tile(radii, (len(centres), 1)) if radii.ndim == 1 else radii
