"""External loads: weight, forces and moments at points, distributed loads on rods, motor torques."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.kinematics import Motion, spread
from exosight.mechanics.rod import Rod
from exosight.mechanics.term import (
    Bound,
    Expansion,
    Term,
    on_frames,
    one_channel,
    point_stiffness,
    point_wrench,
    zero,
)
from exosight.mechanics.tree import Tree


class Gravity(Term):
    """Weight: −Σ m_i γ · p_i over the masses of rods and links.

    acceleration   (3,)   γ [m/s²]
    """

    acceleration: Float[Array, "3"]

    def bind(self, tree: Tree) -> Bound:
        """The weight of every frame's mass is bound once."""
        mass = jnp.concatenate([b.mass() if callable(b.mass) else b.mass for b in tree.bodies])
        pull = -mass[:, None] * self.acceleration

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            position = motion.position
            return zero(tree, loads)._replace(
                energy=jnp.sum(pull * position),
                wrench=point_wrench(position, pull),
                stiffness=point_stiffness(position, pull),
            )

        return expand


class DeadForce(Term):
    """A force of constant direction on one frame: −u direction · p.

    body, frame   the frame: index within the body, −1 its last (static)
    channel       index of the load that scales it (static)
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

    def bind(self, tree: Tree) -> Bound:
        """The frame's index is bound once."""
        return _wrenches(tree, self.body, [self.frame], self.channel, self.direction[None])


class PointWrench(Term):
    """A moment and a force on one frame, dead or follower.

    A dead wrench keeps its direction in the world and acts at the frame's moving origin; a follower is
    constant in the frame's own axes. A dead force has the energy −u force · p. A moment, or a follower,
    has none (its work is path-dependent), so its robot is not `conservative`: an equilibrium is then
    a root of the force balance, and positive eigenvalues of the Hessian exclude divergence, but not flutter.

    body, frame   the frame: index within the body, −1 its last (static)
    channel       index of the load that scales it (static)
    follower      whether it turns with the frame (static)
    turning       whether it has a moment (static, follows from `wrench`)
    wrench        (6,)   [moment; force]; what acts is u · wrench [N m; N]

    Raises InputError for a wrench that is not six finite numbers.
    """

    body: str = eqx.field(static=True)
    frame: int = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    follower: bool = eqx.field(static=True)
    turning: bool = eqx.field(static=True)
    wrench: Float[Array, "6"]

    def __init__(
        self, body: str, frame: int, channel: int, wrench: Float[AnyArray, "6"], *, follower: bool = False
    ) -> None:
        numbers = np.asarray(wrench, dtype=float)
        if numbers.shape != (6,) or not np.all(np.isfinite(numbers)):
            raise InputError(
                f"PointWrench on {body!r}: expected 6 finite numbers, moment [N m] and force [N], "
                f"got {wrench}"
            )
        self.body, self.frame, self.channel, self.follower = body, frame, channel, follower
        self.turning = bool(numbers[:3].any())
        self.wrench = jnp.asarray(numbers)

    @property
    def loads(self) -> int:
        """Its channel and those before it."""
        return self.channel + 1

    @property
    def conservative(self) -> bool:
        """Only a dead force has an energy."""
        return not (self.follower or self.turning)

    def bind(self, tree: Tree) -> Bound:
        """The frame's index is bound once."""
        moment = self.wrench[None, :3] if self.turning else None
        force = self.wrench[None, 3:]
        return _wrenches(tree, self.body, [self.frame], self.channel, force, moment, self.follower)


class DistributedForce(Term):
    """A force per unstretched length of a rod: dead (wind, buoyancy) or following its sections (pressure).

    A dead one has the energy −u ∫ force · p ds; a follower has none, see `PointWrench`.

    rod        name of the rod (static)
    channel    which load scales it (static)
    force      (points, 3)   at the rod's points; what acts is u · force [N/m]
    follower   whether it is constant in the sections' axes, not in the world's (static)
    """

    rod: str = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    force: Float[Array, "points 3"]
    follower: bool = eqx.field(static=True, default=False)

    @property
    def loads(self) -> int:
        """Its channel and those before it."""
        return self.channel + 1

    @property
    def conservative(self) -> bool:
        """Only a dead force has an energy."""
        return not self.follower

    def bind(self, tree: Tree) -> Bound:
        """Its resultants at the rod's points are bound once; InputError if they are not those of `force`."""
        rod = tree[self.rod]
        if not isinstance(rod, Rod):
            raise InputError(f"DistributedForce: {self.rod!r} is a link; a load per length needs a rod")
        if self.force.shape != (rod.frames, 3):
            raise InputError(
                f"DistributedForce on {self.rod!r}: expected a force [N/m] at each of its points, "
                f"{(rod.frames, 3)}, got {self.force.shape}"
            )
        force = rod.weights()[:, None] * self.force
        return _wrenches(tree, self.rod, range(rod.frames), self.channel, force, follower=self.follower)


class JointTorque(Term):
    """What a motor does at a joint: −u q of one of its coordinates.

    body         the body behind the joint (static)
    channel      which load it is (static): a torque [N m], or a force [N] where the coordinate slides
    coordinate   which of the joint's coordinates (static)
    """

    body: str = eqx.field(static=True)
    channel: int = eqx.field(static=True)
    coordinate: int = eqx.field(static=True, default=0)

    @property
    def loads(self) -> int:
        """Its channel and those before it."""
        return self.channel + 1

    def bind(self, tree: Tree) -> Bound:
        """The coordinate's index is bound once; InputError if the joint has no such coordinate."""
        count = tree[self.body].joint.dofs
        if not 0 <= self.coordinate < count:
            raise InputError(
                f"JointTorque: the joint of {self.body!r} has {count} coordinates, "
                f"got number {self.coordinate}"
            )
        i = tree.dof_slice(self.body).start + self.coordinate
        along = np.eye(tree.dofs)[i]

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            u = loads[self.channel]
            return zero(tree, loads)._replace(
                energy=-u * q[i],
                gradient=-u * along,
                load_energy=one_channel(-q[i], self.channel, len(loads)),
                load_gradient=one_channel(-jnp.asarray(along), self.channel, len(loads)),
            )

        return expand


def _wrenches(
    tree: Tree,
    body: str,
    numbers: Sequence[int],
    channel: int,
    force: Float[AnyArray, "some 3"],
    moment: Float[Array, "some 3"] | None = None,
    follower: bool = False,
) -> Bound:
    """Wrenches u · (moment, force) on some frames of a body, in the frames' axes (follower) or the world's.

    With W the spatial wrench and C = `lie.coad`, the tangent of Jᵀ W at constant W is what `pull_back` makes
    of it, symmetric, and ½ Jᵀ C(W) J, antisymmetric. A dead moment is such a W. A follower changes by
    dW = −C(W) J dq, which leaves −½ Jᵀ C(W) J. A dead force has a symmetric tangent (`point_stiffness`).
    """
    own = np.array(numbers, int)
    at = np.array([tree.frame(body, i) for i in numbers])
    has_energy = moment is None and not follower

    def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
        moved, u = motion[body], loads[channel]
        pose, jacobian = moved.pose[own], moved.jacobian[own]
        position, turn = pose[:, :3, 3], pose[:, :3, :3]

        def in_world(vector: AnyArray) -> Array:
            return jnp.einsum("fij,fj->fi", turn, vector) if follower else jnp.asarray(vector)

        # Derivatives of an energy are the opposite of forces.
        pull = -in_world(force)
        wrench = point_wrench(position, pull)
        rest = None
        if moment is not None:
            couple = jnp.concatenate([-in_world(moment), jnp.zeros_like(pull)], axis=-1)
            wrench, rest = wrench + couple, 0.5 * lie.coad(couple)
        if follower:
            rest = -0.5 * lie.coad(wrench)
        by_load = spread(jnp.einsum("fki,fk->i", jacobian, wrench), moved.moving, tree.dofs)
        found = zero(tree, loads)._replace(
            wrench=on_frames(u * wrench, at, tree.frames),
            load_gradient=one_channel(by_load, channel, len(loads)),
        )
        if not follower:
            stiffness = point_stiffness(position, u * pull)
            found = found._replace(stiffness=on_frames(stiffness, at, tree.frames))
        if has_energy:
            work = jnp.sum(pull * position)
            found = found._replace(energy=u * work, load_energy=one_channel(work, channel, len(loads)))
        if rest is not None:
            block = jnp.einsum("fki,fkl,flj->ij", jacobian, rest, jacobian)
            whole = spread(spread(block, moved.moving, tree.dofs).T, moved.moving, tree.dofs).T
            found = found._replace(hessian=u * whole)
        return found

    return expand
