"""How the forces depend on the exosuit's design: derivatives by shape, size and material."""

import jax
import jax.numpy as jnp
import numpy as np

from exosight.exosuit.assembly import QUADRATURE, assemble_surface, observe
from exosight.exosuit.finger import Finger
from exosight.mechanics import Robot, SolverOptions, differentiable, follow, stack

X = QUADRATURE.points
LOADS = np.arange(0.0, 1.05, 0.1)[:, None]
DESIGN = np.array([0.0095, 0.0055, 0.095, 300e3, 1000.0])
"""R0 [m], R1 [m], L [m], Young's modulus [Pa], contact stiffness [N/m]."""


def robot(design: jax.Array | np.ndarray) -> Robot:
    r0, r1, length, young, stiffness = design
    return assemble_surface(
        jnp.asarray(r0 + (r1 - r0) * X),
        jnp.asarray((r1 - r0) * jnp.ones_like(X)),
        length,
        finger=Finger(),
        young=young,
        contact_stiffness=stiffness,
        gap=0.0,
    )


def solved(design: np.ndarray) -> np.ndarray:
    found = follow([robot(design)], LOADS, options=SolverOptions(tolerance=1e-13))
    return np.asarray(found.q[0, -1])


def net_force(robots: Robot, q: jax.Array | np.ndarray) -> jax.Array:
    return jnp.asarray(observe(stack([robots]), jnp.asarray(q)[None, None]).net_force)[0, 0]


def test_net_force_by_radii_length_modulus_and_contact_stiffness() -> None:
    q = solved(DESIGN)

    def force(design: jax.Array) -> jax.Array:
        own = robot(design)
        batched = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], own)
        at = differentiable(own, jnp.asarray(LOADS[-1]), q)
        return jnp.asarray(observe(batched, at[None, None]).net_force)[0, 0]

    gradient = np.asarray(jax.grad(force)(jnp.asarray(DESIGN)))
    for i, value in enumerate(DESIGN):
        step = np.zeros_like(DESIGN)
        step[i] = 1e-5 * value
        high, low = (net_force(robot(d), solved(d)) for d in (DESIGN + step, DESIGN - step))
        # Central differences of a path with kinks where contacts open: their curvature times 1e-10.
        np.testing.assert_allclose(gradient[i], (high - low) / (2 * step[i]), rtol=2e-5)
    # What one expects of it: stiffer material lets the finger feel less of a given actuation.
    assert gradient[3] < 0
