"""Joints: how a body may move against its parent.

A joint moves by exp(axes · q), q its own coordinates. Adding one means adding a class whose constructor
says what its axes are.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.errors import InputError


class Joint(eqx.Module):
    """A joint with constant axes, springs and a range.

    twists            one constant twist a coordinate (static)
    stiffness         (dofs,)     spring about q = 0 [N m/rad]
    lower, upper      (dofs,)     range [rad]; ±inf where there is none
    limit_stiffness   (dofs,)     quadratic penalty beyond the range [N m/rad]
    """

    twists: tuple[tuple[float, ...], ...] = eqx.field(static=True)
    stiffness: Float[Array, " dofs"]
    lower: Float[Array, " dofs"]
    upper: Float[Array, " dofs"]
    limit_stiffness: Float[Array, " dofs"]

    @property
    def dofs(self) -> int:
        """Number of coordinates."""
        return len(self.twists)

    @property
    def axes(self) -> Float[Array, "6 dofs"]:
        """The twists as columns."""
        return jnp.array(self.twists, dtype=float).reshape(self.dofs, 6).T


class Fixed(Joint):
    """No motion: the body is clamped to its parent."""

    def __init__(self) -> None:
        self.twists = ()
        self.stiffness = self.lower = self.upper = self.limit_stiffness = jnp.zeros(0)


class Revolute(Joint):
    """A hinge about `axis` through the joint's origin, with a spring and a range.

    axis              unit vector in the joint's frame; (0, 1, 0) flexes a finger in the x–z plane
    stiffness         [N m/rad]
    limits            (lower, upper) [rad]
    limit_stiffness   [N m/rad]

    Raises InputError for an axis that is no unit vector, a negative stiffness or an empty range.
    """

    def __init__(
        self,
        axis: tuple[float, float, float] = (0.0, 1.0, 0.0),
        stiffness: float = 0.0,
        limits: tuple[float, float] = (-np.inf, np.inf),
        limit_stiffness: float = 0.0,
    ) -> None:
        if not np.isclose(np.linalg.norm(axis), 1.0):
            raise InputError(f"Revolute axis: expected a unit vector, got {axis}; divide it by its length")
        if not (0 <= stiffness < np.inf and 0 <= limit_stiffness < np.inf):
            raise InputError(
                "Revolute stiffness: expected finite numbers of at least 0 N m/rad, "
                f"got {stiffness} and {limit_stiffness}"
            )
        if not limits[0] < limits[1]:
            raise InputError(f"Revolute limits: expected lower < upper in rad, got {limits}")
        self.twists = ((*axis, 0.0, 0.0, 0.0),)
        self.stiffness = jnp.array([stiffness], dtype=float)
        self.lower = jnp.array([limits[0]], dtype=float)
        self.upper = jnp.array([limits[1]], dtype=float)
        self.limit_stiffness = jnp.array([limit_stiffness], dtype=float)
