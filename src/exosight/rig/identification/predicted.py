"""The outline that a picture of a rig would have."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from exosight.rig.identification.outlines import Outline, outline_of_picture
from exosight.system.camera import Camera
from exosight.system.observation import body_axes
from exosight.system.system import System
from exosight.vision.scene import picture


def predicted_outline(system: System, q: Float[np.ndarray, " dofs"], camera: Camera) -> Outline:
    """That of the system at coordinates q, as a camera sees it.

    Raises DataError if it is not in the picture.
    """
    axes = {name: np.asarray(axis) for name, axis in body_axes(system, q[None]).items()}
    seen = replace(system, cameras=(("camera", camera),))
    shades = [tube.shade for tube in system.tubes]
    return outline_of_picture(picture(seen, axes)[0], shades, f"picture of {system.name}")
