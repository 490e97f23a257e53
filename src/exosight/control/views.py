"""What a camera sees of a system whose surfaces are known."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, UInt8

from exosight.system.camera import Camera
from exosight.system.system import System
from exosight.vision.renderer import Tube, render


def picture(
    systems: System, axes: Mapping[str, Float[np.ndarray, "frames nodes 3"]], camera: Camera | None = None
) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures, 0…255, of one system in many poses, or of stacked systems in one pose each.

    axes    of their tubes, by their names [m], as `exosight.system.observation.observe` tells them
    camera  by default the systems' first one
    """
    tubes = [
        Tube(axes[tube.name], np.array(np.broadcast_to(tube.radius, axes[tube.name].shape[:2])), tube.shade)
        for tube in systems.tubes
    ]
    return render(tubes, camera or systems.camera())
