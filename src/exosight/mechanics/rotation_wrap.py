"""Wrapping of rotation vectors, for joints with unlimited rotation.

exp(Ω) is singular where the rotation vector reaches a full turn. Long before, beyond 200°, the same pose is
written with the smaller turn the other way, ω − 2π ω/|ω|.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from exosight import lie
from exosight.mechanics.joint import Free, Planar, Spherical
from exosight.mechanics.loads import JointTorque
from exosight.mechanics.robot import Robot

_TURN = np.deg2rad(200)


def wrap_rotations(
    robot: Robot, q: Float[Array, " dofs"], v: Float[Array, " dofs"]
) -> tuple[Float[Array, " dofs"], Float[Array, " dofs"], Bool[Array, ""]]:
    """Coordinates and rates with the rotation of free, ball and planar joints wrapped; whether any was.

    A joint with springs, dampers, a range or a motor keeps its coordinates, as its forces depend on them.
    """
    changed = jnp.array(False)
    driven = {term.body for term in robot.terms if isinstance(term, JointTorque)}
    for body in robot.bodies:
        joint = body.joint
        if not isinstance(joint, Free | Planar | Spherical) or body.name in driven:
            continue
        (axes,) = joint.groups  # columns of unit length, square to each other
        start = robot.dof_slice(body.name).start
        own = slice(start, start + joint.dofs)
        twist = axes @ q[own]
        angle = jnp.linalg.norm(twist[:3])
        held = jnp.any(jnp.concatenate([joint.stiffness, joint.damping, joint.limit_stiffness]) > 0)
        over = (angle > _TURN) & ~held
        turn = twist[:3] * (1 - 2 * np.pi / jnp.where(over, angle, 2 * np.pi))
        # exp(ω, v) moves the origin by T(ω) v, T the tangent of the rotation alone.
        back = lie.tangent_inverse(jnp.concatenate([turn, jnp.zeros(3)]))[:3, :3]
        other = jnp.concatenate([turn, back @ lie.exp(twist)[:3, 3]])
        rate = lie.tangent_inverse(other) @ (lie.tangent(twist) @ (axes @ v[own]))
        q = q.at[own].set(jnp.where(over, axes.T @ other, q[own]))
        v = v.at[own].set(jnp.where(over, axes.T @ rate, v[own]))
        changed = changed | over
    return q, v, changed
