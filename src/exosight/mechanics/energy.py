"""The potential energy of a robot: elasticity, joint limits, and a sum of terms.

A term looks at a `Motion` and returns its `Expansion`: value, first derivatives and second derivatives. It
speaks about frames in spatial wrenches, which are pulled back through the Jacobian once for all terms:

    ∇Π  = Σ gradient + Jᵀ W            ∇²Π = Σ hessian + geometric stiffness of W,   W = Σ wrench

so that adding an effect means adding one class with a `bind`. Loads u enter linearly,
Π = Π₀ + Σ_c u_c Λ_c(q).
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.mechanics.kinematics import Motion, geometric_stiffness, walk
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod


class Expansion(NamedTuple):
    """A term's energy and derivatives at one pose.

    energy         ()               [J]
    gradient       (dofs,)          by coordinates, without what acts through `wrench`
    wrench         (frames, 6)      dΠ = Σ wrench_i · (spatial twist of frame i) [N m; N]
    hessian        (dofs, dofs)     second derivative at constant spatial wrench
    load_energy    (loads,)         Λ = ∂Π/∂u [m, for a force]
    load_gradient  (loads, dofs)    ∂∇Π/∂u
    """

    energy: Float[Array, ""]
    gradient: Float[Array, " dofs"]
    wrench: Float[Array, "frames 6"]
    hessian: Float[Array, "dofs dofs"]
    load_energy: Float[Array, " loads"]
    load_gradient: Float[Array, "loads dofs"]


Bound = Callable[[Float[Array, " dofs"], Motion, Float[Array, " loads"]], Expansion]


class Term(eqx.Module):
    """An energy. `bind` computes what does not change with the pose and returns the rest.

    A term whose derivatives say nothing of what is just ahead (a gap says nothing of the contact behind it)
    also has a `reach`; one that is scaled by loads says how many it needs.
    """

    @property
    def loads(self) -> int:
        """How many load channels there must be for this term: its channel's number + 1, or none."""
        return 0

    def bind(self, robot: Robot) -> Bound:
        """The function (q, motion, loads) -> Expansion of this term on `robot`."""
        raise NotImplementedError(f"{type(self).__name__} has no bind")

    def reach(self, robot: Robot, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """The largest fraction of `step` from `motion` that the expansion there can be trusted for."""
        return jnp.array(jnp.inf)


class Evaluation(NamedTuple):
    """The whole potential at one pose: energy [J], gradient, Hessian, and how loads change the first two."""

    energy: Float[Array, ""]
    gradient: Float[Array, " dofs"]
    hessian: Float[Array, "dofs dofs"]
    load_energy: Float[Array, " loads"]
    load_gradient: Float[Array, "loads dofs"]


def potential(
    robot: Robot,
) -> Callable[[Float[Array, " dofs"], Float[Array, " loads"]], tuple[Evaluation, Motion]]:
    """The function (q, loads) -> Π with its gradient and Hessian, and the motion they were taken at.

    Everything that depends on the design alone is computed here, once.
    """
    elastic = stiffness(robot)
    limits = _JointLimits().bind(robot)
    terms = [limits, *(term.bind(robot) for term in robot.terms)]

    def evaluate(q: Float[Array, " dofs"], loads: Float[Array, " loads"]) -> tuple[Evaluation, Motion]:
        motion = walk(robot, q)
        parts = [term(q, motion, loads) for term in terms]
        whole = jax.tree.map(lambda *parts: sum(parts[1:], start=parts[0]), *parts)
        force = elastic @ q
        total = Evaluation(
            energy=0.5 * q @ force + whole.energy,
            gradient=force + whole.gradient + jnp.einsum("fkq,fk->q", motion.jacobian, whole.wrench),
            hessian=elastic + whole.hessian + geometric_stiffness(robot, motion, whole.wrench),
            load_energy=whole.load_energy,
            load_gradient=whole.load_gradient,
        )
        return total, motion

    return evaluate


def stiffness(robot: Robot) -> Float[Array, "dofs dofs"]:
    """K, so that the energy of all rods and joint springs is ½ qᵀ K q."""
    k = jnp.zeros((robot.dofs, robot.dofs))
    for body in robot.bodies:
        start = robot.dof_slice(body.name).start
        joint = start + jnp.arange(body.joint.dofs)
        k = k.at[joint, joint].add(body.joint.stiffness)
        if isinstance(body, Rod):
            inside = slice(start + body.joint.dofs, start + body.dofs)
            k = k.at[inside, inside].add(body.stiffness())
    return k


def zero(robot: Robot, loads: Float[Array, " loads"]) -> Expansion:
    """The expansion of no energy, for terms to replace what they have."""
    n = robot.dofs
    return Expansion(
        energy=jnp.zeros(()),
        gradient=jnp.zeros(n),
        wrench=jnp.zeros((robot.frames, 6)),
        hessian=jnp.zeros((n, n)),
        load_energy=jnp.zeros_like(loads),
        load_gradient=jnp.zeros((loads.shape[0], n)),
    )


def point_wrench(
    position: Float[Array, "*batch 3"], force: Float[Array, "*batch 3"]
) -> Float[Array, "*batch 6"]:
    """The spatial wrench (p × f, f) of a force at a point."""
    return jnp.concatenate([jnp.cross(position, force), force], axis=-1)


def point_stiffness(motion: Motion, gradient: Float[Array, "frames 3"]) -> Float[Array, "dofs dofs"]:
    """What Σ_i ∂p_iᵀ f_i adds to the Hessian as the points move under constant f = ∂E/∂p: ∂p × f, on J_ω."""
    turned = jnp.cross(motion.point_jacobian(), gradient[:, :, None], axis=1)
    half = jnp.einsum("fka,fkb->ab", motion.jacobian[:, :3], turned)
    return 0.5 * (half + half.T)


class _JointLimits(Term):
    """½ k (excess)² beyond each joint's range: SPEC's soft stop."""

    def bind(self, robot: Robot) -> Bound:
        index, lower, upper, k = [], [], [], []
        for body in robot.bodies:
            start = robot.dof_slice(body.name).start
            index += range(start, start + body.joint.dofs)
            lower.append(body.joint.lower)
            upper.append(body.joint.upper)
            k.append(body.joint.limit_stiffness)
        joint = jnp.array(index, dtype=int)
        low, high, spring = jnp.concatenate(lower), jnp.concatenate(upper), jnp.concatenate(k)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            excess = jnp.maximum(q[joint] - high, 0.0) + jnp.minimum(q[joint] - low, 0.0)
            none = zero(robot, loads)
            return none._replace(
                energy=0.5 * jnp.sum(spring * excess**2),
                gradient=none.gradient.at[joint].add(spring * excess),
                hessian=none.hessian.at[joint, joint].add(jnp.where(excess != 0, spring, 0.0)),
            )

        return expand


class Gravity(Term):
    """Weight: −Σ m_i γ · p_i over the masses of rods and links.

    acceleration   (3,)   γ [m/s²]
    """

    acceleration: Float[Array, "3"]

    def bind(self, robot: Robot) -> Bound:
        """The weight of every frame's mass is bound once."""
        mass = jnp.concatenate([b.mass() if callable(b.mass) else b.mass for b in robot.bodies])
        pull = -mass[:, None] * self.acceleration

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            return zero(robot, loads)._replace(
                energy=jnp.sum(pull * motion.position),
                wrench=point_wrench(motion.position, pull),
                hessian=point_stiffness(motion, pull),
            )

        return expand


class DeadForce(Term):
    """A force of constant direction on one frame: −u direction · p.

    body, frame   the frame: index within the body (static)
    channel       which load scales it (static)
    direction     (3,)   in the world; the force is u · direction [N]
    """

    body: str = eqx.field(static=True)
    frame: int = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    direction: Float[Array, "3"]

    @property
    def loads(self) -> int:
        """Its channel and those before it."""
        return self.channel + 1

    def bind(self, robot: Robot) -> Bound:
        """The frame's index is bound once."""
        i = robot.frame(self.body, self.frame)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            none = zero(robot, loads)
            pull = jnp.zeros((robot.frames, 3)).at[i].set(-loads[self.channel] * self.direction)
            unit = -motion.point_jacobian()[i].T @ self.direction
            return none._replace(
                energy=jnp.sum(pull[i] * motion.position[i]),
                wrench=point_wrench(motion.position, pull),
                hessian=point_stiffness(motion, pull),
                load_energy=none.load_energy.at[self.channel].set(-self.direction @ motion.position[i]),
                load_gradient=none.load_gradient.at[self.channel].set(unit),
            )

        return expand
