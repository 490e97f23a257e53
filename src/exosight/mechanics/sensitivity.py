"""Derivatives of equilibria by loads, material and shape, through the implicit function theorem.

At an equilibrium ∇Π(q; p) = 0 for whatever p the energy depends on, so while the pose is stable

    dq/dp = −(∇²Π)⁻¹ ∂∇Π/∂p.

No step of the solver is differentiated: only the gradient of the energy is, once, at the solution.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.energy import Evaluation, potential
from exosight.mechanics.metric import metric_of
from exosight.mechanics.robot import Robot

SNAP = 1e-6
"""Smallest relative stiffness (`Equilibria.min_eigenvalue`) at which an equilibrium has derivatives: below it
a change of load moves the pose a million times as far as at rest, and only round-off is left of them."""


def differentiable(
    robot: Robot, loads: Float[AnyArray, " loads"], q: Float[AnyArray, " dofs"]
) -> Float[Array, " dofs"]:
    """The equilibrium q of a robot under loads, as JAX can differentiate it by every number of either.

    The value is q as given; what is added are its derivatives, to first order, for `jax.grad`, `jax.jvp` and
    the rest, also under `jax.vmap` and `jax.jit`:

        found = follow([robot], loads[None])
        force = lambda loads: observe_something(robot, differentiable(robot, loads, found.q[0, 0]))
        jax.grad(force)(loads)

    loads     (channels,)   u of each channel [N]
    q         (dofs,)       an equilibrium that the solver found for this robot and these loads
    returns   (dofs,)

    Raises a RuntimeError (also from compiled code, when it runs) where the pose is about to snap, is
    unstable, or is no equilibrium at all: there it has no derivative.
    """
    q, here = _expanded(robot, loads, q)
    still, hessian = jax.lax.stop_gradient((here.gradient, here.jacobian))
    factor = jnp.linalg.cholesky(jax.lax.stop_gradient(metric_of(robot)))
    inverse = jax.scipy.linalg.solve_triangular(factor, jnp.eye(len(q)), lower=True)
    whitened = inverse @ hessian @ inverse.T
    least = jnp.linalg.eigvalsh(0.5 * (whitened + whitened.T))[0]
    size = jnp.linalg.norm(factor.T @ q) + 0.01 * jnp.sqrt(jnp.mean(jnp.sum(factor**2, axis=1)))
    residual = jnp.linalg.norm(inverse @ still) / size
    still = eqx.error_if(
        still,
        ~(least > SNAP),
        "an equilibrium that snaps or is unstable has no derivative: its smallest relative stiffness is not "
        "above 1e-6; step to a smaller load, or differentiate on the branch that it snaps to",
    )
    still = eqx.error_if(
        still,
        ~(residual < 1e-6),
        "the pose is no equilibrium of this robot under these loads, so it has no derivative: its residual "
        "is not below 1e-6; give the q that `follow` found for them",
    )
    return q - jnp.linalg.solve(hessian, here.gradient - still)


def differentiable_unchecked(
    robot: Robot, loads: Float[AnyArray, " loads"], q: Float[AnyArray, " dofs"]
) -> Float[Array, " dofs"]:
    """The same for an equilibrium that is known to be stable, as `Equilibria` says: nothing is checked again.

    Compiled code that checks is compiled anew in every process; this is kept by JAX's cache of compiled code.
    """
    q, here = _expanded(robot, loads, q)
    still, hessian = jax.lax.stop_gradient((here.gradient, here.jacobian))
    return q - jnp.linalg.solve(hessian, here.gradient - still)


def _expanded(
    robot: Robot, loads: Float[AnyArray, " loads"], q: Float[AnyArray, " dofs"]
) -> tuple[Float[Array, " dofs"], Evaluation]:
    q = jax.lax.stop_gradient(jnp.asarray(q))
    return q, potential(robot)(q, jnp.asarray(loads))[0]
