"""Lengths of poses and forces: the elastic energy norm."""

from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.energy import stiffness
from exosight.mechanics.robot import Robot


def metric_of(robot: Robot) -> Float[Array, "dofs dofs"]:
    """The elastic stiffness; a coordinate without any (a joint without a spring) weighs as the mean.

    In it every soft mode weighs its own energy, whatever the units of its coordinate. Where there is no
    stiffness at all, as in a chain held by weights alone, it is 1 N m/rad or N/m.
    """
    elastic = stiffness(robot)
    own = jnp.diag(elastic)
    mean = jnp.mean(own)
    return elastic + jnp.diag(jnp.where(own > 0, 1e-9 * own, jnp.where(mean > 0, mean, 1.0)))


class Metric(NamedTuple):
    """The metric M of a robot.

    factor   L of M = L Lᵀ
    unit     q₀ = |q| of a strain or angle of 0.01: what counts as small where |q| is zero
    """

    factor: Float[Array, "dofs dofs"]
    unit: Float[Array, ""]

    @staticmethod
    def of(robot: Robot) -> "Metric":
        """That of a robot."""
        matrix = metric_of(robot)
        return Metric(jnp.linalg.cholesky(matrix), 0.01 * jnp.sqrt(jnp.trace(matrix) / robot.dofs))

    def times(self, q: Float[AnyArray, " dofs"]) -> Float[Array, " dofs"]:
        """M q."""
        return self.factor @ (self.factor.T @ q)

    def size(self, q: Float[AnyArray, " dofs"]) -> Float[Array, ""]:
        """|q|, with |q|² = qᵀ M q."""
        return jnp.linalg.norm(self.factor.T @ q)

    def force(self, gradient: Float[AnyArray, " dofs"]) -> Float[Array, ""]:
        """|∇Π|, with |∇Π|² = ∇Πᵀ M⁻¹ ∇Π."""
        return jnp.linalg.norm(solve_triangular(self.factor, gradient, lower=True))

    def residual(self, q: Float[AnyArray, " dofs"], gradient: Float[AnyArray, " dofs"]) -> Float[Array, ""]:
        """|∇Π| relative to the pose."""
        return self.force(gradient) / (self.size(q) + self.unit)

    def range(self, q: Float[AnyArray, " dofs"]) -> Float[Array, ""]:
        """The length that steps from q are measured by: that of the pose, or of a strain or angle of 0.2."""
        return self.size(q) + 20 * self.unit
