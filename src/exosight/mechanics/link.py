"""A rigid link of a kinematic tree."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.joint import Fixed, Joint


class Link(eqx.Module):
    """A rigid body behind a joint, along its local x axis.

    name, parent   its own name, and that of the body at whose end its joint sits (None: the ground)
    joint          how it moves against the parent
    mount          (4, 4)       pose of the joint in the parent's end frame
    length         ()           [m]; the end frame, where children attach, is at (length, 0, 0)
    sites          (frames, 3)  points whose poses are wanted, in the link's frame [m]
    mass           (frames,)    mass carried at each site [kg]
    """

    name: str = eqx.field(static=True)
    parent: str | None = eqx.field(static=True)
    joint: Joint
    mount: Float[Array, "4 4"]
    length: Float[Array, ""]
    sites: Float[Array, "frames 3"]
    mass: Float[Array, " frames"]

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
    ) -> None:
        if not 0 <= length < float("inf"):
            raise InputError(f"link {name!r}, length: expected a finite length of at least 0 m, got {length}")
        self.name, self.parent = name, parent
        self.joint = Fixed() if joint is None else joint
        self.mount = jnp.eye(4) if mount is None else jnp.asarray(mount, dtype=float)
        self.length = jnp.asarray(length, dtype=float)
        self.sites = jnp.asarray(sites, dtype=float)
        self.mass = jnp.zeros(len(self.sites)) if mass is None else jnp.asarray(mass, dtype=float)

    @property
    def frames(self) -> int:
        """Number of poses it contributes."""
        return self.sites.shape[-2]

    @property
    def dofs(self) -> int:
        """Number of coordinates: those of its joint."""
        return self.joint.dofs
