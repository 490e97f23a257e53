"""The potential energy of a robot: elasticity, joint limits, and the sum of its terms.

Loads u enter linearly, Π = Π₀ + Σ_c u_c Λ_c(q).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight.mechanics.kinematics import Motion, pull_back, walk
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import Bound, Expansion, Term, zero
from exosight.mechanics.tree import Tree


class Evaluation(NamedTuple):
    """The whole potential at one pose: energy [J], gradient, Hessian, and how loads change the first two.

    Forces without a potential have no share in the energy, and make the Hessian unsymmetric; those of terms
    with a memory are potential forces but for `coupling`.
    """

    energy: Float[Array, ""]
    gradient: Float[Array, " dofs"]
    hessian: Float[Array, "dofs dofs"]
    load_energy: Float[Array, " loads"]
    load_gradient: Float[Array, "loads dofs"]
    coupling: Float[Array, "dofs dofs"] | None = None

    @property
    def jacobian(self) -> Float[Array, "dofs dofs"]:
        """∂(gradient)/∂q."""
        return self.hessian if self.coupling is None else self.hessian + self.coupling


def potential(
    robot: Robot,
) -> Callable[[Float[Array, " dofs"], Float[Array, " loads"]], tuple[Evaluation, Motion]]:
    """The function (q, loads) -> Π with its gradient and Hessian, and the motion at q.

    Everything that depends on the design alone is precomputed here.
    """
    elastic = stiffness(robot)
    terms = [term.bind(robot) for term in (_JointLimits(), *robot.terms)]

    def evaluate(q: Float[Array, " dofs"], loads: Float[Array, " loads"]) -> tuple[Evaluation, Motion]:
        motion = walk(robot, q)
        parts = [term(q, motion, loads) for term in terms]
        couplings = [part.coupling for part in parts if part.coupling is not None]
        parts = [part._replace(coupling=None) for part in parts]
        whole = jax.tree.map(lambda *parts: sum(parts[1:], start=parts[0]), *parts)
        gradient, hessian = pull_back(robot, motion, whole.wrench, whole.stiffness)
        force = elastic @ q
        total = Evaluation(
            energy=0.5 * q @ force + whole.energy,
            gradient=force + whole.gradient + gradient,
            hessian=elastic + whole.hessian + hessian,
            load_energy=whole.load_energy,
            load_gradient=whole.load_gradient,
            coupling=sum(couplings[1:], start=couplings[0]) if couplings else None,
        )
        return total, motion

    return evaluate


def stiffness(tree: Tree) -> Float[Array, "dofs dofs"]:
    """K, so that the energy of all rods and joint springs is ½ qᵀ K q."""
    return _blocks(tree, lambda body: body.joint.stiffness, lambda rod: rod.stiffness())


def damping(tree: Tree) -> Float[Array, "dofs dofs"]:
    """D, so that the viscous force of all rods and joint dampers is D dq/dt."""
    return _blocks(tree, lambda body: body.joint.damping, lambda rod: rod.damping())


def _blocks(tree: Tree, of_joint: Callable, of_rod: Callable) -> Float[Array, "dofs dofs"]:
    whole = jnp.zeros((tree.dofs, tree.dofs))
    for body in tree.bodies:
        start = tree.dof_slice(body.name).start
        joint = start + jnp.arange(body.joint.dofs)
        whole = whole.at[joint, joint].add(of_joint(body))
        if isinstance(body, Rod):
            inside = slice(start + body.joint.dofs, start + body.dofs)
            whole = whole.at[inside, inside].add(of_rod(body))
    return whole


class _JointLimits(Term):
    """½ k (excess)² beyond each joint's range: soft joint limits."""

    def bind(self, tree: Tree) -> Bound:
        def of_coordinates(name: str, elsewhere: float) -> Array:
            """A joint's numbers by coordinate, with a value for rods' strains."""
            parts = []
            for body in tree.bodies:
                joint = getattr(body.joint, name)
                parts += [joint, jnp.full(body.dofs - body.joint.dofs, elsewhere)]
            return jnp.concatenate(parts)

        low, high = of_coordinates("lower", -np.inf), of_coordinates("upper", np.inf)
        spring = of_coordinates("limit_stiffness", 0.0)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            excess = jnp.maximum(q - high, 0.0) + jnp.minimum(q - low, 0.0)
            return zero(tree, loads)._replace(
                energy=0.5 * jnp.sum(spring * excess**2),
                gradient=spring * excess,
                hessian=jnp.diag(jnp.where(excess != 0, spring, 0.0)),
            )

        return expand
