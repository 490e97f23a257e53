"""Joints: how a body may move against its parent.

Adding a joint means adding a class with `dofs`, `axes`, `stiffness` and the limits.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.errors import InputError


class Joint(eqx.Module):
    """A joint moves by exp(axes · q), q its own coordinates.

    axes              (6, dofs)   constant twists
    stiffness         (dofs,)     spring about q = 0 [N m/rad]
    lower, upper      (dofs,)     range [rad]; ±inf where there is none
    limit_stiffness   ()          quadratic penalty beyond the range [N m/rad]
    """

    axes: eqx.AbstractVar[Float[np.ndarray, "6 dofs"]]
    stiffness: eqx.AbstractVar[Float[Array, " dofs"]]
    lower: eqx.AbstractVar[Float[Array, " dofs"]]
    upper: eqx.AbstractVar[Float[Array, " dofs"]]
    limit_stiffness: eqx.AbstractVar[Float[Array, ""]]

    @property
    def dofs(self) -> int:
        """Number of coordinates."""
        return self.axes.shape[1]


class Fixed(Joint):
    """No motion: the body is clamped to its parent."""

    @property
    def axes(self) -> Float[np.ndarray, "6 0"]:
        """No axis."""
        return np.zeros((6, 0))

    @property
    def stiffness(self) -> Float[Array, "0"]:
        """Empty."""
        return jnp.zeros(0)

    @property
    def lower(self) -> Float[Array, "0"]:
        """Empty."""
        return jnp.zeros(0)

    @property
    def upper(self) -> Float[Array, "0"]:
        """Empty."""
        return jnp.zeros(0)

    @property
    def limit_stiffness(self) -> Float[Array, ""]:
        """Zero."""
        return jnp.zeros(())


class Revolute(Joint):
    """A hinge about `axis` through the joint's origin, with a spring and a range.

    axis              unit vector in the joint's frame; (0, 1, 0) flexes a finger in the x–z plane
    stiffness         (1,)   [N m/rad]
    lower, upper      (1,)   [rad]
    limit_stiffness   ()     [N m/rad]
    """

    axis: tuple[float, float, float] = eqx.field(static=True)
    stiffness: Float[Array, "1"]
    lower: Float[Array, "1"]
    upper: Float[Array, "1"]
    limit_stiffness: Float[Array, ""]

    def __init__(
        self,
        axis: tuple[float, float, float] = (0.0, 1.0, 0.0),
        stiffness: float = 0.0,
        limits: tuple[float, float] = (-np.inf, np.inf),
        limit_stiffness: float = 0.0,
    ) -> None:
        if not np.isclose(np.linalg.norm(axis), 1.0):
            raise InputError(f"Revolute axis: expected a unit vector, got {axis}; divide it by its length")
        if not stiffness >= 0 or not limit_stiffness >= 0:
            raise InputError(
                f"Revolute stiffness: expected at least 0 N m/rad, got {stiffness} and {limit_stiffness}"
            )
        if not limits[0] < limits[1]:
            raise InputError(f"Revolute limits: expected lower < upper in rad, got {limits}")
        self.axis = axis
        self.stiffness = jnp.array([stiffness], dtype=float)
        self.lower = jnp.array([limits[0]], dtype=float)
        self.upper = jnp.array([limits[1]], dtype=float)
        self.limit_stiffness = jnp.array(limit_stiffness, dtype=float)

    @property
    def axes(self) -> Float[np.ndarray, "6 1"]:
        """The rotation axis as a twist."""
        return np.array([*self.axis, 0.0, 0.0, 0.0])[:, None]
