"""The equation of motion of a robot with a bit of everything, against Lagrange and the laws of balance."""

import jax
import jax.numpy as jnp
import numpy as np

from exosight import lie
from exosight.mechanics import (
    DeadForce,
    Elliptic,
    Free,
    Gauss,
    Gravity,
    Legendre,
    Link,
    MotionOptions,
    NodalQuadratic,
    Robot,
    Rod,
    Trajectories,
    Universal,
    evolve,
    potential,
    walk,
)
from exosight.mechanics.energy import damping
from exosight.mechanics.equation_of_motion import spatial_inertia


def thrown(gravity: float) -> Robot:
    """A soft, viscous, curved rod that flies; at its tip a link on a damped universal joint, and a force."""
    points = Gauss(1, 4)
    curved = np.array([0.5, 2.0, -1.0, 1.0, 0.0, 0.0])
    rod = Rod(
        "rod",
        0.3,
        Elliptic(np.linspace(0.012, 0.008, points.size), np.linspace(0.01, 0.006, points.size)),
        young=1e6,
        poisson=0.4,
        density=1000.0,
        viscosity=1e4,
        strains={
            "torsion_x": Legendre(1),
            "bend_y": NodalQuadratic(1),
            "bend_z": Legendre(2),
            "shear_y": Legendre(0),
        },
        quadrature=points,
        joint=Free(),
        natural=lambda x: np.tile(curved, (len(x), 1)),
    )
    link = Link(
        "link",
        0.1,
        np.array([[0.05, 0.01, 0.0], [0.1, 0.0, 0.0]]),
        parent="rod",
        joint=Universal(damping=1e-3, stiffness=0.02),
        mount=lie.exp(jnp.array([0.1, -0.2, 0.3, 0.01, 0.0, 0.02])),
        mass=np.array([0.05, 0.01]),
        inertia=np.array([np.diag([1e-5, 4e-5, 5e-5]), np.zeros((3, 3))]),
    )
    force = DeadForce("link", -1, 0, jnp.array([0.3, -0.2, 0.5]))
    return Robot((rod, link), (Gravity(jnp.array([0.0, 0.0, -gravity])), force))


def start(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Bent, turning and flying."""
    draw = np.random.default_rng(3)
    q, v = 0.2 * draw.normal(size=robot.dofs), np.zeros(robot.dofs)
    v[:6], v[-2:] = [3.0, 8.0, 2.0, 0.5, 0.2, -0.3], [5.0, -3.0]
    return q, v


def balance(found: Trajectories) -> np.ndarray:
    return (found.kinetic + found.potential + found.dissipated - found.supplied)[0]


def test_motion_obeys_lagranges_equations_and_the_balance_of_energy() -> None:
    """What ∂T/∂q − D v − ∂Π/∂q adds up to over time is what the momenta ∂T/∂v = M v gain.

    T = ½ vᵀ M(q) v and Π are differentiated automatically; over time, Gauss's rule.
    """
    robot = thrown(9.81)
    inertia, viscous = spatial_inertia(robot), damping(robot)

    def kinetic(q: jax.Array, v: jax.Array) -> jax.Array:
        at = walk(robot, q)
        twist = at.jacobian @ v
        return 0.5 * jnp.einsum("fi,fij,fj->", twist, inertia(at.pose), twist)

    def force(q: jax.Array, v: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        by_place, momentum = jax.grad(kinetic, argnums=(0, 1))(q, v)
        return by_place - viscous @ v - potential(robot)(q, u)[0].gradient, momentum

    places, weights = np.polynomial.legendre.leggauss(16)
    # After 0.1 s the shear that the start leaves unbalanced has crept away, and all is smooth.
    time = np.concatenate([[0.0, 0.1], 0.15 + 0.05 * places, [0.2]])
    loads = 5.0 * time[:, None]
    q, v = start(robot)
    found = evolve([robot], time, loads, q=q[None], velocity=v[None], options=MotionOptions(1e-9))
    assert found.converged.all()
    compiled = jax.jit(jax.vmap(force), compiler_options={"xla_backend_optimization_level": "0"})
    forces, momenta = map(np.asarray, compiled(found.q[0], found.velocity[0], loads))
    gained = 0.05 * weights @ forces[2:-1]
    # Gains of 0.1 N s; 40 steps of up to 1e-9 m in 2 ms each, of 0.1 kg.
    np.testing.assert_allclose(momenta[-1] - momenta[1], gained, atol=1e-7)
    assert min(found.supplied[0, -1], found.dissipated[0, -1]) > 1e-2
    # Of 0.6 J; what is lost is lost in the first steps, of 1e-9 m in 0.1 ms each.
    np.testing.assert_allclose(balance(found), balance(found)[0], atol=3e-6)


def test_what_flies_without_weight_keeps_its_momentum() -> None:
    """Turning on beyond 200°: only heat takes energy, and nothing takes momentum."""
    robot = thrown(0.0)
    q, v = start(robot)
    time, loads = np.linspace(0.0, 0.5, 18), np.zeros((18, 1))
    found = evolve([robot], time, loads, q=q[None], velocity=v[None], options=MotionOptions(1e-8))
    assert found.converged.all()
    inertia = spatial_inertia(robot)

    def momentum(q: jax.Array, v: jax.Array) -> jax.Array:
        at = walk(robot, q)
        return jnp.einsum("fij,fjq,q->i", inertia(at.pose), at.jacobian, v)

    compiled = jax.jit(jax.vmap(momentum), compiler_options={"xla_backend_optimization_level": "0"})
    of = np.asarray(compiled(found.q[0], found.velocity[0]))
    # The first steps, 1e-8 m in 0.1 ms each, of 0.1 kg at 0.5 m/s.
    np.testing.assert_allclose(of, np.tile(of[0], (18, 1)), atol=1e-5)
    np.testing.assert_allclose(balance(found), balance(found)[0], atol=1e-5)
    assert np.abs(np.diff(found.q[0, :, :3], axis=0)).max() > 3.0  # the free joint's coordinates jumped
