"""A rigid link of a kinematic tree."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from exosight.arrays import AnyArray, floats
from exosight.errors import InputError
from exosight.mechanics.joint import Fixed, Joint


class Link(eqx.Module):
    """A rigid body behind a joint, along its local x axis.

    name, parent   its own name, and that of the body at whose end its joint sits (None: the ground)
    joint          motion relative to the parent
    mount          (4, 4)          pose of the joint in the parent's end frame
    length         ()              [m]; the end frame, where children attach, is at (length, 0, 0)
    sites          (frames, 3)     points whose poses are computed, in the link's frame [m]
    mass           (frames,)       point mass at each site [kg]
    inertia        (frames, 3, 3)  moment of inertia of that mass about its site, in the link's axes [kg m²]
    """

    name: str = eqx.field(static=True)
    parent: str | None = eqx.field(static=True)
    joint: Joint
    mount: Float[AnyArray, "4 4"]
    length: Float[AnyArray, ""]
    sites: Float[AnyArray, "frames 3"]
    mass: Float[AnyArray, " frames"]
    inertia: Float[AnyArray, "frames 3 3"]

    def __init__(
        self,
        name: str,
        length: float,
        sites: Float[AnyArray, "frames 3"],
        *,
        parent: str | None = None,
        joint: Joint | None = None,
        mount: Float[AnyArray, "4 4"] | None = None,
        mass: Float[AnyArray, " frames"] | None = None,
        inertia: Float[AnyArray, "frames 3 3"] | None = None,
    ) -> None:
        if not 0 <= length < float("inf"):
            raise InputError(f"link {name!r}, length: expected a finite length of at least 0 m, got {length}")
        count = len(sites)
        masses = np.zeros(count) if mass is None else np.asarray(mass, dtype=float)
        inertias = np.zeros((count, 3, 3)) if inertia is None else np.asarray(inertia, dtype=float)
        for what, value, shape, unit in (
            ("mass", masses, (count,), "kg"),
            ("inertia", inertias, (count, 3, 3), "kg m²"),
        ):
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise InputError(
                    f"link {name!r}, {what}: expected finite numbers [{unit}] of shape {shape}, one a site, "
                    f"got shape {value.shape}"
                )
        if np.any(masses < 0) or np.any(np.linalg.eigvalsh(inertias) < 0):
            raise InputError(f"link {name!r}: expected masses and moments of inertia of at least 0")
        self.name, self.parent = name, parent
        self.joint = Fixed() if joint is None else joint
        self.mount = np.eye(4) if mount is None else floats(mount)
        self.length = floats(length)
        self.sites = floats(sites)
        self.mass = floats(masses)
        self.inertia = floats(inertias)

    @property
    def frames(self) -> int:
        """Number of poses it contributes."""
        return self.sites.shape[-2]

    @property
    def dofs(self) -> int:
        """Number of coordinates: those of its joint."""
        return self.joint.dofs
