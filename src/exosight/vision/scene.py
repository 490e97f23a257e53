"""What the camera looks at: the finger and the exosuit worn above it, as two tubes."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from exosight.exosuit.assembly import QUADRATURE, Exosuit, Pose
from exosight.exosuit.shapes import radius
from exosight.vision.camera import Camera
from exosight.vision.renderer import Tube, render

FINGER_SHADE = 0.70
"""Mid gray: apart from the background (0.92) and from the exosuit by equal steps of about 0.3."""
EXOSUIT_SHADE = 0.35
"""Dark gray: the body whose bending carries most of the information stands out most."""


def tubes(
    centreline: Float[np.ndarray, "frames points 3"],
    rod_radii: Float[np.ndarray, "#frames points"] | Float[np.ndarray, " points"],
    finger: Float[np.ndarray, "frames nodes 3"],
    finger_radii: Float[np.ndarray, " nodes"],
) -> tuple[Tube, Tube]:
    """The finger (FINGER_SHADE) and the exosuit (EXOSUIT_SHADE), in the order in which they are drawn.

    The exosuit is drawn last: where the bodies press on each other, the picture shows its whole outline.

    centreline    (frames, points, 3)           the exosuit's axis [m]
    rod_radii     (points,) or (frames, points) the exosuit's radius along it [m]
    finger        (frames, nodes, 3)            joints and tip of the finger [m]
    finger_radii  (nodes,)                      the finger's radius there [m]
    returns       the tubes to pass to `exosight.vision.render`

    Raises InputError if shapes differ or a number is not finite.
    """
    return (
        Tube(finger, _for_each_frame(finger_radii, finger), FINGER_SHADE),
        Tube(centreline, _for_each_frame(rod_radii, centreline), EXOSUIT_SHADE),
    )


def picture(exosuit: Exosuit, pose: Pose, camera: Camera) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures of a worn exosuit.

    pose     of this exosuit, with one batch dimension: the frames
    returns  (frames, height, width)  gray 0…255
    """
    return render(
        tubes(
            np.asarray(pose.centreline),
            radius(exosuit.shape.surface, QUADRATURE.points),
            np.asarray(pose.finger),
            np.asarray(exosuit.finger.radii),
        ),
        camera,
    )


def _for_each_frame(radii: Any, centres: Any) -> Any:
    """Radii of the nodes, repeated where every frame has the same; `Tube` judges the shape."""
    return np.tile(radii, (len(centres), 1)) if radii.ndim == 1 else radii
