"""What a camera sees of a system."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, UInt8

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.system.system import System
from exosight.vision.lighting import Lighting
from exosight.vision.renderer import BACKGROUND, Tube, render

Axes = Mapping[str, Float[AnyArray, "frames nodes 3"]]
"""The axis of every tube in each frame, by its name, as `exosight.system.observation` gives it [m]."""


def tubes(
    system: System, axes: Axes, shades: Sequence[float | Float[np.ndarray, " frames"]] | None = None
) -> tuple[Tube, ...]:
    """The tubes of a system, to pass to `exosight.vision.render`.

    system   one for all frames, or stacked: one a frame
    shades   gray of each tube, one for all frames or one a frame; by default the system's own

    Raises InputError if there is no axis of a tube, shapes differ or a number is not finite.
    """
    missing = [tube.name for tube in system.tubes if tube.name not in axes]
    if missing:
        raise InputError(f"axes: expected one of each tube, got none of {missing[0]}; observe this system")
    shades = [tube.shade for tube in system.tubes] if shades is None else shades
    found = []
    for tube, shade in zip(system.tubes, shades, strict=True):
        axis, radius = np.asarray(axes[tube.name], float), np.asarray(tube.radius, float)
        found.append(Tube(axis, np.tile(radius, (len(axis), 1)) if radius.ndim == 1 else radius, shade))
    return tuple(found)


def picture(
    system: System, axes: Axes, lighting: Lighting | None = None
) -> UInt8[np.ndarray, "frames height width"]:
    """Gray pictures of a system, as its first camera sees it.

    lighting  shades and light of each frame; by default the nominal ones
    returns   (frames, height, width)  gray 0…255
    """
    shades, light = (None, None) if lighting is None else (list(lighting.shades.T), lighting.light)
    return render(tubes(system, axes, shades), system.camera, light, system.visibility)


def cover(system: System, axes: Axes) -> UInt8[np.ndarray, "frames height width"]:
    """How much of each pixel the tubes cover, 0…255, as `exosight.vision.augment` takes it."""
    black = render(tubes(system, axes, [0.0] * len(system.tubes)), system.camera, None, system.visibility)
    return np.rint((1 - np.arange(BACKGROUND + 1) / BACKGROUND) * 255).astype(np.uint8)[black]
