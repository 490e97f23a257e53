"""Energy terms.

A term defines its energy at a `Configuration`; derivatives follow by automatic differentiation *of the term*.
Terms that are evaluated often return their `Expansion` themselves: value, first and second derivatives.
In both cases frames enter by spatial wrenches and stiffnesses, which are pulled back through the tree
once for all terms together (`kinematics.pull_back`).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.kinematics import Motion, spread
from exosight.mechanics.rod import Rod
from exosight.mechanics.separable import is_separable
from exosight.mechanics.tree import Tree


class Configuration(NamedTuple):
    """Arguments of an energy.

    q        (dofs,)             coordinates (radians, metres, dimensionless strains)
    pose     (frames, 4, 4)      of the frames listed by the term, local to world [m]
    strain   (points, 6) a rod   by the rod's name [1/m; -]
    """

    q: Float[Array, " dofs"]
    pose: Float[Array, "frames 4 4"]
    strain: dict[str, Float[Array, "points 6"]]

    @property
    def position(self) -> Float[Array, "frames 3"]:
        """Origins of the frames in the world [m]."""
        return self.pose[:, :3, 3]


class Expansion(NamedTuple):
    """A term's energy and derivatives at one pose.

    energy         ()                [J]
    gradient       (dofs,)           by coordinates, without the part through `wrench`
    wrench         (frames, 6)       dΠ = Σ wrench_i · (spatial twist of frame i) [N m; N]
    stiffness      (frames, 6, 6)    symmetric part of ∂wrench_i/∂(spatial twist of frame i)
    hessian        (dofs, dofs)      by coordinates, without the part through `wrench` and `stiffness`
    load_energy    (loads,)          Λ = ∂Π/∂u [m, for a force]
    load_gradient  (loads, dofs)     ∂∇Π/∂u
    coupling       (dofs, dofs)      what ∂(gradient)/∂q has beyond `hessian`; none for a potential
    """

    energy: Float[Array, ""]
    gradient: Float[Array, " dofs"]
    wrench: Float[Array, "frames 6"]
    stiffness: Float[Array, "frames 6 6"]
    hessian: Float[Array, "dofs dofs"]
    load_energy: Float[Array, " loads"]
    load_gradient: Float[Array, "loads dofs"]
    coupling: Float[Array, "dofs dofs"] | None = None


class Resistance(NamedTuple):
    """A dissipative force at one pose and velocity v, which stands beside ∇Π in the equation of motion.

    force         (dofs,)        generalized; v · force ≥ 0 is the power that it takes [W]
    by_velocity   (dofs, dofs)   its derivative
    by_position   (dofs, dofs)   what Newton's method needs of that one
    """

    force: Float[Array, " dofs"]
    by_velocity: Float[Array, "dofs dofs"]
    by_position: Float[Array, "dofs dofs"]


Memories = tuple[Float[AnyArray, "..."], ...]
"""What the terms of a robot remember, one array for each that does (`TermWithMemory`)."""

Bound = Callable[[Float[Array, " dofs"], Motion, Float[Array, " loads"]], Expansion]


class Term(eqx.Module):
    """An energy; subclasses define `energy`, or for speed `bind`.

    A term whose derivatives do not predict a change ahead (an open gap before contact)
    also defines `max_step_fraction`; one that is scaled by loads defines `loads`.
    """

    @property
    def loads(self) -> int:
        """Number of load channels required: the channel's index + 1, or 0."""
        return 0

    @property
    def clock(self) -> int | None:
        """The load channel in which it expects the time [s]; None: it has no use for it."""
        return None

    @property
    def conservative(self) -> bool:
        """Whether it has an energy; a follower force has none, and `bind` then gives its gradient only."""
        return True

    def frames(self, tree: Tree) -> Sequence[int]:
        """The frames whose poses `energy` uses, as numbered by `tree.frame`; all by default."""
        return range(tree.frames)

    def energy(self, tree: Tree, at: Configuration, loads: Float[Array, " loads"]) -> Float[Array, ""]:
        """The energy [J]; linear in the loads."""
        raise NotImplementedError(f"{type(self).__name__} has neither energy nor bind")

    def bind(self, tree: Tree) -> Bound:
        """The function (q, motion, loads) -> Expansion on this tree; parts independent of q are precomputed.

        By default the derivatives of `energy`, to second order in the motion of its frames, by automatic
        differentiation: exact, and as fast as written by hand where it is a sum over frames, found from its
        operations (`separable`); else slower the more frames it uses.
        """
        frames = np.array(self.frames(tree), int)

        def expand(q: Array, motion: Motion, loads: Array) -> Expansion:
            jacobian, pose = motion.jacobian[frames], motion.pose[frames]

            def value(step: Array, twist: Array, loads: Array) -> Array:
                strain = {
                    body.name: motion.strain[body.name] + strain_columns(tree, body.name) @ step
                    for body in tree.bodies
                    if isinstance(body, Rod)
                }
                return self.energy(tree, Configuration(q + step, lie.exp(twist) @ pose, strain), loads)

            def moved(step: Array, loads: Array) -> Array:
                return value(step, jacobian @ step, loads)

            still, none = jnp.zeros_like(q), jnp.zeros((len(frames), 6))
            energy, (gradient, wrench) = jax.value_and_grad(value, argnums=(0, 1))(still, none, loads)
            by_load = jax.jacrev(moved, argnums=1)
            found = zero(tree, loads)._replace(
                energy=energy,
                gradient=gradient,
                wrench=on_frames(wrench, frames, tree.frames),
                load_energy=by_load(still, loads),
                load_gradient=jax.jacrev(by_load)(still, loads),
            )
            if not self._separable(tree, len(frames), len(loads)):
                return found._replace(hessian=jax.hessian(moved)(still, loads))

            def change(direction: Array) -> Array:
                """Of all wrenches, as every frame moves in this direction."""
                of_twist = jax.grad(lambda twist: value(still, twist, loads))
                return jax.jvp(of_twist, (none,), (jnp.broadcast_to(direction, none.shape),))[1]

            stiffness = jax.vmap(change, out_axes=2)(jnp.eye(6))
            return found._replace(
                hessian=jax.hessian(value)(still, none, loads),
                stiffness=on_frames(stiffness, frames, tree.frames),
            )

        return expand

    def _separable(self, tree: Tree, frames: int, loads: int) -> bool:
        """Whether the energy is a sum of functions of one frame each and one of coordinates and strains."""
        leaves, structure = jax.tree.flatten((self, tree))
        traced = [i for i, leaf in enumerate(leaves) if isinstance(leaf, Tracer)]
        rods = [body for body in tree.bodies if isinstance(body, Rod)]

        def energy(q: Array, pose: Array, loads: Array, *rest: Array) -> Array:
            strain = dict(zip((rod.name for rod in rods), rest, strict=False))
            given = dict(zip(traced, rest[len(rods) :], strict=True))
            here = [given.get(i, leaf) for i, leaf in enumerate(leaves)]
            term, tree = jax.tree.unflatten(structure, here)
            return term.energy(tree, Configuration(q, pose, strain), loads)

        own = np.broadcast_to(np.arange(frames)[:, None, None], (frames, 4, 4))
        strains = [np.full((rod.frames, 6), frames) for rod in rods]
        parameters = [np.full(np.shape(leaves[i]), -1) for i in traced]
        parts = [np.full(tree.dofs, frames), own, np.full(loads, -1), *strains, *parameters]
        floats = [np.zeros(part.shape) for part in parts[: 3 + len(rods)]]
        return is_separable(energy, [*floats, *(leaves[i] for i in traced)], parts)

    def max_step_fraction(self, tree: Tree, motion: Motion, step: Float[Array, " dofs"]) -> Float[Array, ""]:
        """The largest fraction of `step` from `motion` within which the expansion is valid."""
        return jnp.array(jnp.inf)

    def resistance(self, tree: Tree, motion: Motion, v: Float[Array, " dofs"]) -> Resistance | None:
        """What it adds to the viscosity at a velocity [1/s]; quasi-static paths do not ask for it."""
        return None


class TermWithMemory(Term):
    """A term that remembers what happened before, such as where a contact began to slip.

    Within a step of the path its energy is a function of the pose, as any other; at the end of the step
    it remembers.

    memory   what it knows from the steps before, or at first
    """

    memory: Float[AnyArray, "..."]

    def remember(self, tree: Tree, motion: Motion, loads: Float[Array, " loads"]) -> Float[Array, "..."]:
        """What it knows from now on, when a step has ended at this pose and these loads."""
        raise NotImplementedError(f"{type(self).__name__} does not say what it remembers")

    def dissipated(self) -> Float[Array, ""]:
        """What it has lost so far [J], as its memory says."""
        return jnp.zeros(())

    def discrepancy(
        self, tree: Tree, motion: Motion, v: Float[Array, " dofs"], loads: Float[Array, " loads"]
    ) -> Float[Array, ""]:
        """By how much the speed at the end of a step differs from what it assumes of the step [m/s].

        `evolve` takes steps so short that half of the way at this speed is within the tolerance.
        """
        return jnp.zeros(())


def zero(tree: Tree, loads: Float[Array, " loads"]) -> Expansion:
    """The expansion of zero energy, whose fields terms replace."""
    n, channels = tree.dofs, loads.shape[0]
    return Expansion(
        energy=jnp.zeros(()),
        gradient=jnp.zeros(n),
        wrench=jnp.zeros((tree.frames, 6)),
        stiffness=jnp.zeros((tree.frames, 6, 6)),
        hessian=jnp.zeros((n, n)),
        load_energy=jnp.zeros(channels),
        load_gradient=jnp.zeros((channels, n)),
    )


def square(x: Float[Array, "points n"]) -> Float[Array, "points n n"]:
    """x xᵀ of each."""
    return x[:, :, None] * x[:, None, :]


def where_each(
    condition: Bool[AnyArray, " points"], values: Float[AnyArray, "points ..."]
) -> Float[Array, "points ..."]:
    """Values of the points that a condition holds for, else 0.

    Scalar programs compute what only these need where the condition holds in one of their samples.
    """
    return jnp.where(condition.reshape(-1, *[1] * (values.ndim - 1)), values, 0.0)


def one_channel(values: Float[Array, "..."], channel: int, count: int) -> Float[Array, "count ..."]:
    """An array over all load channels with `values` at one of them and zero elsewhere."""
    none = jnp.zeros_like(values)
    return jnp.stack([values if i == channel else none for i in range(count)])


def on_frames(values: Float[Array, "some ..."], frames: np.ndarray, count: int) -> Float[Array, "count ..."]:
    """Values of some frames, none twice, as an array over all frames with zero elsewhere."""
    # A gather with one spare row of zeros: a scatter is many times slower on the CPU.
    place = np.full(count, len(frames))
    place[frames] = np.arange(len(frames))
    return jnp.concatenate([values, jnp.zeros((1, *values.shape[1:]))])[place]


def sum_on_frames(
    values: Float[Array, "some ..."], frames: np.ndarray, count: int
) -> Float[Array, "count ..."]:
    """Values of some frames as sums over all frames; unlike in `on_frames`, a frame may be there twice."""
    different = np.unique(frames)
    if len(different) < len(frames):
        values = jnp.einsum("df,f...->d...", (different[:, None] == frames).astype(float), values)
        frames = different
    return on_frames(values, frames, count)


def weighted_squares(
    columns: Float[Array, "points some dofs"],
    factors: Float[Array, "points some"],
    counts: Bool[Array, " points"],
) -> Float[Array, "dofs dofs"]:
    """Σ factor xᵀ x over the points that count, each pair of coordinates once."""
    count = columns.shape[2]
    i, j = np.triu_indices(count)
    # A choice of each factor, not of their product: of 25 numbers, not of 325.
    left = where_each(counts, factors[..., None] * columns).reshape(-1, count)
    right = where_each(counts, columns).reshape(-1, count)
    half = jnp.einsum("pk,pk->k", left[:, i], right[:, j])
    place = np.zeros((count, count), int)
    place[i, j] = place[j, i] = np.arange(len(i))
    return half[place]


def strain_columns(tree: Tree, name: str) -> Float[Array, "points 6 dofs"]:
    """∂(strain)/∂q at the points of a rod; constant."""
    rod = tree[name]
    assert isinstance(rod, Rod)
    functions = rod.functions(rod.quadrature.points) * rod.scale[:, None]
    full = jnp.einsum("peq,ek->pkq", functions, np.eye(6)[list(rod.rows)])
    own = tree.dof_slice(name)
    return spread(full, tuple(range(own.start + rod.joint.dofs, own.stop)), tree.dofs)


def point_wrench(
    position: Float[Array, "*batch 3"], gradient: Float[AnyArray, "*batch 3"]
) -> Float[Array, "*batch 6"]:
    """The spatial wrench (p × f, f) of f = ∂E/∂p at a point."""
    return jnp.concatenate([jnp.cross(position, gradient), gradient], axis=-1)


def point_stiffness(
    position: Float[Array, "*batch 3"],
    gradient: Float[AnyArray, "*batch 3"],
    hessian: Float[Array, "*batch 3 3"] | None = None,
) -> Float[Array, "*batch 6 6"]:
    """The spatial stiffness of an energy E(p) of a point: from f = ∂E/∂p and k = ∂²E/∂p² (none: zero).

    A twist (ω, v) moves the point by v + ω × p: k on that, and ω · ((v + ω × p) × f), symmetrised.
    """
    p, f = lie.hat(position), lie.hat(gradient)
    fp = f @ p
    turn, mixed = 0.5 * (fp + jnp.swapaxes(fp, -1, -2)), -0.5 * f
    if hessian is None:
        slide = jnp.zeros_like(turn)
    else:
        pk = p @ hessian
        turn, mixed, slide = turn - pk @ p, mixed + pk, hessian
    upper = jnp.concatenate([turn, mixed], axis=-1)
    lower = jnp.concatenate([jnp.swapaxes(mixed, -1, -2), slide], axis=-1)
    return jnp.concatenate([upper, lower], axis=-2)
