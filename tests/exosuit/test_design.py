"""How the forces depend on the exosuit's design: derivatives by shape, size and material."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from exosight.exosuit.assembly import QUADRATURE, ROD, Exosuit, assemble_surface
from exosight.exosuit.finger import Finger
from exosight.exosuit.published import published, system_of
from exosight.mechanics import Robot, SolverOptions, differentiable, drive, stack
from exosight.system.observation import observe_state

X = QUADRATURE.points
LOADS = np.arange(0.0, 1.05, 0.1)[:, None]
DESIGN = np.array([0.0095, 0.0055, 0.095, 300e3, 1000.0])
"""R0 [m], R1 [m], L [m], Young's modulus [Pa], contact stiffness [N/m]."""


def robot(design: jax.Array | np.ndarray) -> Robot:
    r0, r1, length, young, stiffness = design
    surface, slope = jnp.asarray(r0 + (r1 - r0) * X), jnp.asarray((r1 - r0) * jnp.ones_like(X))
    nominal = assemble_surface(surface, slope, length, Exosuit())
    return eqx.tree_at(
        lambda of: (of[ROD].young, of.terms[1].stiffness),
        nominal,
        (jnp.asarray(young), jnp.asarray(stiffness)),
    )


def net_force(of: Robot, q: jax.Array | np.ndarray) -> jax.Array:
    return observe_state(system_of(of, Finger()), jnp.asarray(q)).readings[published().schema.index("F_net")]


def test_net_force_by_radii_length_modulus_and_contact_stiffness() -> None:
    steps = 1e-5 * np.diag(DESIGN)
    designs = [DESIGN, *(DESIGN + steps), *(DESIGN - steps)]
    robots = [robot(design) for design in designs]
    found = drive(robots, LOADS, options=SolverOptions(tolerance=1e-13))
    q = np.asarray(found.q)[:, -1]
    solved = np.asarray(jax.jit(jax.vmap(net_force))(stack(robots), q))

    @jax.jit
    def force(design: jax.Array) -> jax.Array:
        own = robot(design)
        return net_force(own, differentiable(own, jnp.asarray(LOADS[-1]), q[0]))

    gradient = np.asarray(jax.grad(force)(jnp.asarray(DESIGN)))
    for slope, high, low, step in zip(gradient, solved[1:6], solved[6:], np.diag(steps), strict=True):
        # Central differences: the curvature between kinks times 1e-10, and the solver's 1e-14 N of round-off.
        np.testing.assert_allclose(slope, (high - low) / (2 * step), rtol=2e-5, atol=1e-14 / step)
    # What one expects of it: stiffer material lets the finger feel less of a given actuation.
    assert gradient[3] < 0
