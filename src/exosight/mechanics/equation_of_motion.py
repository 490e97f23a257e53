"""The equation of motion of a robot, and its linearization.

In the coordinates q, with v = dq/dt and a = dv/dt,

    r(q, v, a) = Σ_i J_iᵀ W_i + D v + R(q, v) + ∇Π(q, u) = 0,      W_i = I_i ṫ_i − ad(t_i)ᵀ I_i t_i,
    t_i = J_i v,      ṫ_i = J_i a + J̇_i v,

t_i being the spatial twist of frame i, I_i the spatial inertia of what it carries, W_i the inertial wrench,
D the viscosity, R the terms' resistance and Π the potential energy. The inertial wrenches enter as those of
any energy do: pulled back through the tree with their stiffnesses.

Source: R. Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 2 (spatial inertia, equation of motion).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight import lie
from exosight.mechanics.energy import Evaluation, damping, potential
from exosight.mechanics.kinematics import Motion, pull_back
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import Resistance
from exosight.mechanics.tree import Tree


class Linearization(NamedTuple):
    """The equation of motion at one point (q, v, a).

    residual     (dofs,)         r [generalized force]
    matrix       (dofs, dofs)    ∂r/∂q + ∂r/∂v / η + ∂r/∂a / η² for a given time η: the change of r with q
                                 where v and a follow as δv = δq/η, δa = δv/η
    potential                    Π, its gradient, Hessian and load derivatives
    resistance                   D v + R
    motion                       poses and Jacobians of the frames
    jacobian     (frames, 6, dofs)
    inertia      (frames, 6, 6)  spatial inertia of the frames
    mass                         of all bodies [kg]
    """

    residual: Float[Array, " dofs"]
    matrix: Float[Array, "dofs dofs"]
    potential: Evaluation
    resistance: Resistance
    motion: Motion
    jacobian: Float[Array, "frames 6 dofs"]
    inertia: Float[Array, "frames 6 6"]
    mass: Float[Array, ""]

    def kinetic_energy(self, v: Float[Array, " dofs"]) -> Float[Array, ""]:
        """½ Σ t_iᵀ I_i t_i [J] at velocity v."""
        twist = self.jacobian @ v
        return 0.5 * jnp.sum(twist * _times(self.inertia, twist))

    def displacement(self, change: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Root mean square displacement of the robot's mass [m] for a change of the coordinates."""
        return jnp.sqrt(2 * self.kinetic_energy(change) / self.mass)


def equation_of_motion(robot: Robot) -> Callable[..., Linearization]:
    """The function (q, v, a, loads, eta) -> Linearization.

    q, v, a   (dofs,)      coordinates, velocity [1/s], acceleration [1/s²]
    loads     (channels,)  u [N]
    eta                    η > 0 [s] of the matrix

    The residual is exact. The matrix leaves out what is of second order in the twists, smaller than the
    inertia in it by (|t| η)².
    """
    evaluate, inertia_at, viscosity = potential(robot), spatial_inertia(robot), damping(robot)
    whole_mass = sum(jnp.sum(b.mass() if isinstance(b, Rod) else b.mass) for b in robot.bodies)

    def linearize(
        q: Float[Array, " dofs"],
        v: Float[Array, " dofs"],
        a: Float[Array, " dofs"],
        loads: Float[Array, " channels"],
        eta: Float[Array, ""],
    ) -> Linearization:
        # Differentiated along v for J̇; what is not needed of it is never computed.
        (here, motion), (_, along) = jax.jvp(lambda q: evaluate(q, loads), (q,), (v,))
        jacobian, jacobian_rate = motion.jacobian, along.jacobian
        inertia = inertia_at(motion.pose)
        twist, twist_rate = jacobian @ v, jacobian @ a + jacobian_rate @ v

        momentum, force = _times(inertia, twist), _times(inertia, twist_rate)
        wrench = force - _times(lie.coad(momentum), twist)
        inertial, tangent = pull_back(robot, motion, wrench, inertia / eta**2)
        parts = [Resistance(viscosity @ v, viscosity, jnp.zeros_like(viscosity))]
        parts += [part for term in robot.terms if (part := term.resistance(robot, motion, v)) is not None]
        resistance = jax.tree.map(lambda *parts: sum(parts[1:], start=parts[0]), *parts)
        residual = inertial + resistance.force + here.gradient

        # ∂W/∂v: by t, and by J̇ v, which is quadratic in v.
        turned = jnp.swapaxes(lie.ad(twist), 1, 2) @ inertia
        by_velocity = (
            2 * inertia @ jacobian_rate
            - (turned + jnp.swapaxes(turned, 1, 2) + lie.coad(momentum)) @ jacobian
        )
        # ∂W/∂q: the inertia turns with its frame.
        by_position = -lie.coad(force) @ jacobian
        coupling = jnp.einsum("fkp,fkq->pq", jacobian, by_velocity / eta + by_position)
        matrix = tangent + here.jacobian + resistance.by_velocity / eta + resistance.by_position + coupling
        mass = jnp.asarray(whole_mass)
        return Linearization(residual, matrix, here, resistance, motion, jacobian, inertia, mass)

    return linearize


def spatial_inertia(tree: Tree) -> Callable[[Float[Array, "frames 4 4"]], Float[Array, "frames 6 6"]]:
    """The function from poses to each frame's spatial inertia I: its kinetic energy is ½ tᵀ I t.

    I = [R J Rᵀ − m p̂ p̂, m p̂; −m p̂, m 1] for a frame at p turned by R, with mass m [kg] and the moment of
    inertia J [kg m²] about its own origin and in its own axes.
    """
    mass = jnp.concatenate([b.mass() if isinstance(b, Rod) else b.mass for b in tree.bodies])
    moment = jnp.concatenate([b.inertia() if isinstance(b, Rod) else b.inertia for b in tree.bodies])

    def at(pose: Float[Array, "frames 4 4"]) -> Float[Array, "frames 6 6"]:
        rotation, p, m = pose[:, :3, :3], lie.hat(pose[:, :3, 3]), mass[:, None, None]
        about_origin = rotation @ moment @ jnp.swapaxes(rotation, 1, 2) - m * (p @ p)
        upper = jnp.concatenate([about_origin, m * p], axis=2)
        return jnp.concatenate([upper, jnp.concatenate([-m * p, m * jnp.eye(3)], axis=2)], axis=1)

    return at


def _times(matrix: Float[Array, "frames 6 6"], vector: Float[Array, "frames 6"]) -> Float[Array, "frames 6"]:
    return jnp.einsum("fij,fj->fi", matrix, vector)
