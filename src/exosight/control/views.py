"""What a camera sees of a system whose surfaces are known."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, UInt8

from exosight.system.camera import Camera
from exosight.system.surfaces import TubeSurface
from exosight.system.system import System
from exosight.vision.renderer import Tube, render


def picture(
    system: System,
    axes: Mapping[str, Float[np.ndarray, "frames nodes 3"]],
    camera: Camera | None = None,
    radii: Mapping[str, Float[np.ndarray, "frames nodes"]] | None = None,
) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures of a system, 0…255.

    axes    of its tubes, by their names [m], as `exosight.system.observation.observe` tells them
    camera  by default the system's first one
    radii   of its tubes frame by frame [m]; by default the system's own
    """

    def tube(surface: TubeSurface) -> Tube:
        axis = axes[surface.name]
        radius = surface.radius if radii is None else radii[surface.name]
        return Tube(axis, np.array(np.broadcast_to(radius, axis.shape[:2])), surface.shade)

    return render([tube(surface) for surface in system.tubes], camera or system.camera())
