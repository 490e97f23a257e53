"""Contact between two sets of spheres: f = k d n where they overlap by d, nothing where they do not.

Penalty energy Σ ½ k max(d, 0)², d = R_a + R_b − |p_a − p_b|, over all pairs; normal forces only.
Source: the paper's contact model (eq. 9 there).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.mechanics.energy import Bound, Expansion, Term, point_wrench, zero
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.robot import Robot


class Spheres(eqx.Module):
    """Spheres centred on frames.

    frames   (body, frame within it) of each (static)
    radius   (spheres,)   [m]
    """

    frames: tuple[tuple[str, int], ...] = eqx.field(static=True)
    radius: Float[Array, " spheres"]

    def index(self, robot: Robot) -> tuple[int, ...]:
        """Each sphere's place among all frames of the robot; InputError if a body has no such frame."""
        return tuple(robot.frame(body, frame) for body, frame in self.frames)


class SphereContact(Term):
    """Every sphere of `first` against every sphere of `second`.

    stiffness   ()   k [N/m]
    """

    first: Spheres
    second: Spheres
    stiffness: Float[Array, ""]

    def pairs(
        self, robot: Robot, position: Float[Array, "frames 3"]
    ) -> tuple[Float[Array, "first second"], Float[Array, "first second 3"], Float[Array, "first second"]]:
        """Overlap [m] (negative: gap), unit normal from second to first, and distance of centres [m]."""
        a, b = jnp.array(self.first.index(robot)), jnp.array(self.second.index(robot))
        between = position[a][:, None] - position[b][None]
        # Coincident centres have no normal; the tiny offset makes it zero there instead of NaN.
        distance = jnp.sqrt(jnp.sum(between**2, axis=-1) + 1e-30)
        overlap = self.first.radius[:, None] + self.second.radius[None] - distance
        return overlap, between / distance[..., None], distance

    def forces(self, robot: Robot, position: Float[Array, "frames 3"]) -> Float[Array, "second 3"]:
        """The summed force [N] that `first` exerts on each sphere of `second`, in the world."""
        overlap, normal, _ = self.pairs(robot, position)
        return -jnp.sum(self.stiffness * jnp.maximum(overlap, 0.0)[..., None] * normal, axis=0)

    def reach(self, robot: Robot, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """Up to where the first open pair touches, and a little into it: from there on it is seen."""
        overlap, normal, distance = self.pairs(robot, motion.position)
        moved = motion.point_jacobian() @ step
        a, b = jnp.array(self.first.index(robot)), jnp.array(self.second.index(robot))
        closing = -jnp.sum(normal * (moved[a][:, None] - moved[b][None]), axis=-1)
        ahead = (overlap < 0) & (closing > 0)
        # 0.3 % of the distance, some 30 µm on a finger: enough to be felt, too little to be thrown back.
        fraction = (0.003 * distance - overlap) / jnp.where(ahead, closing, 1.0)
        return jnp.min(jnp.where(ahead, fraction, jnp.inf))

    def bind(self, robot: Robot) -> Bound:
        """Frame indices are bound once."""
        a, b = jnp.array(self.first.index(robot)), jnp.array(self.second.index(robot))

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            overlap, n, distance = self.pairs(robot, motion.position)
            depth = jnp.maximum(overlap, 0.0)
            push = -self.stiffness * depth[..., None] * n  # ∂E/∂p_first
            gradient = jnp.zeros((robot.frames, 3)).at[a].add(push.sum(1)).at[b].add(-push.sum(0))
            # ∂²E/∂p²: k n nᵀ − (k d / r)(I − n nᵀ) where the pair touches
            stiff = jnp.where(overlap > 0, self.stiffness, 0.0)
            bend = self.stiffness * depth / distance
            nn = n[..., :, None] * n[..., None, :]
            pair = (stiff + bend)[..., None, None] * nn - bend[..., None, None] * jnp.eye(3)
            dp = motion.point_jacobian()
            da, db = dp[a], dp[b]
            own_a = jnp.einsum("aij,ajq->aiq", pair.sum(1), da)
            own_b = jnp.einsum("bij,bjq->biq", pair.sum(0), db)
            cross = jnp.einsum("abij,bjq->aiq", pair, db)
            turned = jnp.cross(dp, gradient[:, :, None], axis=1)
            left = jnp.concatenate([da, db, motion.jacobian[:, :3]]).reshape(-1, robot.dofs)
            right = jnp.concatenate([own_a - 2 * cross, own_b, turned]).reshape(-1, robot.dofs)
            half = left.T @ right
            return zero(robot, loads)._replace(
                energy=0.5 * self.stiffness * jnp.sum(depth**2),
                wrench=point_wrench(motion.position, gradient),
                hessian=0.5 * (half + half.T),
            )

        return expand
