"""Bodies that turn on and on: poses and velocities stay what they are, whatever coordinates say."""

import jax.numpy as jnp
import numpy as np
import pytest
from compiled import walk

from exosight import lie
from exosight.mechanics import (
    Free,
    Gravity,
    JointTorque,
    Link,
    MotionOptions,
    Planar,
    Robot,
    Spherical,
    evolve,
)
from exosight.mechanics.equation_of_motion import spatial_inertia
from exosight.mechanics.joint import Joint
from exosight.mechanics.rotation_wrap import wrap_rotations

G = 9.81
INERTIA = np.diag([0.01, 0.02, 0.025])


def body(joint: Joint, *terms: JointTorque) -> Robot:
    """A rigid body of 2 kg about its centre."""
    link = Link("body", 0.0, np.zeros((1, 3)), mass=np.array([2.0]), inertia=INERTIA[None], joint=joint)
    return Robot((link,), (Gravity(jnp.array([0.0, 0.0, -G])), *terms))


def momentum(robot: Robot, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Angular about the world's origin, then linear."""
    motion = walk(robot, jnp.asarray(q))
    inertia = spatial_inertia(robot)(motion.pose)
    return np.asarray(jnp.einsum("fij,fjq,q->i", inertia, motion.jacobian, v))


@pytest.mark.parametrize("joint", [Free(), Spherical(), Planar((0.0, 0.6, 0.8))])
def test_the_other_coordinates_are_the_same_pose_and_velocity(joint: Joint) -> None:
    robot = body(joint)
    draw = np.random.default_rng(0)
    for angle in (1.0, 3.0, 3.6, 4.5, 6.0):
        q, v = draw.normal(size=joint.dofs), draw.normal(size=joint.dofs)
        turning = slice(0, 1 if isinstance(joint, Planar) else 3)
        q[turning] *= angle / np.linalg.norm(q[turning])
        other, rate, changed = wrap_rotations(robot, jnp.asarray(q), jnp.asarray(v))
        assert bool(changed) == (angle > np.deg2rad(200))
        here, there = walk(robot, jnp.asarray(q)), walk(robot, other)
        # Round-off, of a tangent that is nearly singular at 6 rad.
        np.testing.assert_allclose(there.pose, here.pose, atol=1e-12)
        np.testing.assert_allclose(there.jacobian @ rate, here.jacobian @ v, atol=1e-12)
        left = 2 * np.pi - angle if changed else angle
        assert np.linalg.norm(other[turning]) == pytest.approx(left)


def test_coordinates_that_something_depends_on_are_kept() -> None:
    q = jnp.array([0.0, 4.0, 0.0])
    torque = JointTorque("body", 0, 1)
    for robot in (
        body(Spherical(stiffness=1.0)),
        body(Spherical(damping=1.0)),
        body(Spherical(limits=(-5.0, 5.0), limit_stiffness=1.0)),
        body(Spherical(), torque),
    ):
        assert not wrap_rotations(robot, q, q)[2]


@pytest.mark.parametrize("spin", [[0.0, 12.0, 0.0], [2.0, 9.0, -4.0]])
def test_a_body_may_turn_on_and_on(spin: list[float]) -> None:
    """Two turns, about an axis of inertia and tumbling, while it flies: momentum, energy and path stay."""
    robot, start = body(Free()), np.array([*spin, 0.5, 0.2, 1.0])
    options = MotionOptions(tolerance=1e-9)
    found = evolve([robot], np.linspace(0.0, 1.0, 5), velocity=start[None], options=options)
    assert found.converged.all()
    assert np.linalg.norm(found.q[0, :, :3], axis=1).max() < np.deg2rad(220)
    for k, time in enumerate(found.time):
        # About the body's centre, which is its origin: weight has no moment there.
        position = np.asarray(lie.exp(jnp.asarray(found.q[0, k]))[:3, 3])
        np.testing.assert_allclose(position, start[3:] * time + [0, 0, -0.5 * G * time**2], atol=1e-6)
        moment, force = np.split(momentum(robot, found.q[0, k], found.velocity[0, k]), 2)
        # 200 steps of up to 1e-9 m on a body of 0.1 m.
        np.testing.assert_allclose(moment - np.cross(position, force), INERTIA @ spin, atol=1e-6)
    total = found.kinetic + found.potential
    # 200 steps of 5 ms, in each up to 1e-9 m / 5 ms at a momentum of 3 N s: 1e-4 J, if all were to add up.
    np.testing.assert_allclose(total, total[0, 0], atol=1e-5)
