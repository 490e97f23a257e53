"""Forward kinematics of the tree, and the pull-back of wrenches and stiffnesses to coordinates.

`walk` computes poses and spatial Jacobians from coordinates q, body by body and step by step; all other
modules use its `Motion`. A step multiplies the pose by exp(Ω(q)): a joint is a step or two, with
Ω = axes · q, a rod one step between each two neighbouring points, with the fourth-order Magnus twist

    Ω = h/2 (ξ₁ + ξ₂) + (√3/12) h² [ξ₁, ξ₂],      ξ₁, ξ₂ at the Gauss (Zannah) points of the interval.

With T the left Jacobian of SE(3), the spatial columns of a step are S_j = Ad(g_{j−1}) T(Ω_j) ∂Ω_j/∂q, and the
spatial Jacobian of frame i is the sum of S_j over the steps above it. `pull_back` is the reverse: from
spatial wrenches W_i and stiffnesses K_i of the frames to gradient and Hessian by q.

Source: Mathew et al., doi 10.1109/MRA.2022.3202488; Renda et al., "Geometric variable-strain approach",
doi 10.1109/LRA.2020.2985620; second derivatives follow from differentiating S_j once more.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.link import Link
from exosight.mechanics.rod import Rod, step_samples
from exosight.mechanics.tree import Tree


class Steps(eqx.Module):
    """The steps of one joint or one rod. `local` are the variables that a step depends on: a joint's own
    coordinates, or a rod's enabled strains at its two samples; local = basis · q[first : first + size].

    first       first coordinate (static)
    basis       (steps, local, size)   constant numbers
    columns     (steps, 6, local)      spatial columns by local variable: S = columns · basis
    before      (steps, 6, moving)     the body's Jacobian where the step starts
    curvature   (steps, local, local)  symmetric; at wrench w: see `_curvature`, bound to the pose
    """

    first: int = eqx.field(static=True)
    basis: np.ndarray
    columns: Float[Array, "steps 6 local"]
    before: Float[Array, "steps 6 moving"]
    curvature: "Curvature"

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.basis.shape[-1]


class Curvature(eqx.Module):
    """Data of the second derivative of a step's exponential.

    twist      (steps, 6)         Ω
    pose       (steps, 4, 4)      of the frame that the step starts from
    dtwist     (steps, 6, local)  ∂Ω/∂local
    bracket    (steps, half, half) or None    factor of [ξ₁, ξ₂] in Ω, by enabled strain; None: a joint
    rows       the enabled strains' rows in a twist (static)
    """

    twist: Float[Array, "steps 6"]
    pose: Float[Array, "steps 4 4"]
    dtwist: Float[Array, "steps 6 local"]
    bracket: Float[Array, "steps half half"] | None
    rows: tuple[int, ...] = eqx.field(static=True)


class BodyMotion(eqx.Module):
    """One body of a `Motion`.

    name       the body's (static)
    moving     the coordinates that move it, ascending: its ancestors' and its own (static)
    pose       (frames, 4, 4)       local to world [m]
    jacobian   (frames, 6, moving)  spatial: the twist of frame i is jacobian[i] · dq/dt
    strain     (points, 6) of a rod, or None
    steps      from base to tip
    end        (4, 4)               pose of its end, where its children attach
    at_end     (6, moving)          spatial Jacobian of that
    """

    name: str = eqx.field(static=True)
    moving: tuple[int, ...] = eqx.field(static=True)
    pose: Float[Array, "frames 4 4"]
    jacobian: Float[Array, "frames 6 moving"]
    strain: Float[Array, "points 6"] | None
    steps: tuple[Steps, ...]
    end: Float[Array, "4 4"]
    at_end: Float[Array, "6 moving"]


class Motion(eqx.Module):
    """Result of `walk`, by body, and all frames together in that order."""

    dofs: int = eqx.field(static=True)
    bodies: tuple[BodyMotion, ...]

    def __getitem__(self, name: str) -> BodyMotion:
        return next(body for body in self.bodies if body.name == name)

    @property
    def pose(self) -> Float[Array, "frames 4 4"]:
        """Local to world [m]."""
        return jnp.concatenate([body.pose for body in self.bodies])

    @property
    def position(self) -> Float[Array, "frames 3"]:
        """Origins of the frames in the world [m]."""
        return self.pose[:, :3, 3]

    @property
    def strain(self) -> dict[str, Float[Array, "points 6"]]:
        """Strain of each rod at its points."""
        return {body.name: body.strain for body in self.bodies if body.strain is not None}

    @property
    def jacobian(self) -> Float[Array, "frames 6 dofs"]:
        """Spatial Jacobian of every frame by every coordinate."""
        return jnp.concatenate([spread(body.jacobian, body.moving, self.dofs) for body in self.bodies])

    def point_jacobian(self) -> Float[Array, "frames 3 dofs"]:
        """∂p/∂q of the frames' origins: J_v + J_ω × p."""
        return at_points(self.jacobian, self.position)

    def points(self, frames: np.ndarray, moving: tuple[int, ...]) -> Float[Array, "n 3 moving"]:
        """∂p/∂q of the origins of some frames, by the coordinates `moving` that move them."""
        start, pieces, places = 0, [], []
        for body in self.bodies:
            own = np.flatnonzero((start <= frames) & (frames < start + len(body.pose)))
            if own.size:
                at: np.ndarray | slice = frames[own] - start
                if np.array_equal(at, np.arange(at[0], at[0] + len(at))):
                    at = slice(at[0], at[0] + len(at))  # a slice costs nothing, a gather a copy
                columns = at_points(body.jacobian[at], body.pose[at, :3, 3])
                pieces.append(spread(columns, tuple(moving.index(i) for i in body.moving), len(moving)))
                places.append(own)
            start += len(body.pose)
        order = np.argsort(np.concatenate(places))
        whole = jnp.concatenate(pieces)
        return whole if np.array_equal(order, np.arange(len(order))) else whole[order]

    def twist(self, step: Float[Array, " dofs"]) -> Float[Array, "frames 6"]:
        """Spatial twist of every frame for a step of the coordinates."""
        return jnp.concatenate([body.jacobian @ step[np.array(body.moving, int)] for body in self.bodies])


def at_points(
    jacobian: Float[Array, "frames 6 moving"], position: Float[Array, "frames 3"]
) -> Float[Array, "frames 3 moving"]:
    """∂p/∂q of points from spatial Jacobians: J_v + J_ω × p."""
    return jacobian[:, 3:] - lie.hat(position) @ jacobian[:, :3]


def spread(
    values: Float[AnyArray, "*batch moving"], moving: tuple[int, ...], dofs: int
) -> Float[Array, "*batch dofs"]:
    """Values by some ascending coordinates as values by all, zero elsewhere."""
    # Pieces side by side: a scatter is many times slower on the CPU.
    pieces, at, i = [], 0, 0
    while i < len(moving):
        stop = i + 1
        while stop < len(moving) and moving[stop] == moving[i] + stop - i:
            stop += 1
        pieces += [jnp.zeros((*values.shape[:-1], moving[i] - at)), values[..., i:stop]]
        at, i = moving[i] + stop - i, stop
    return jnp.concatenate([*pieces, jnp.zeros((*values.shape[:-1], dofs - at))], axis=-1)


def walk(tree: Tree, q: Float[Array, " dofs"]) -> Motion:
    """Poses and Jacobians of every frame at coordinates q.

    q         (dofs,)   coordinates, body by body (radians, metres, dimensionless strains)
    returns   Motion
    """
    found: dict[str, BodyMotion] = {}
    for body in tree.bodies:
        base, jacobian, above = jnp.eye(4), jnp.zeros((6, 0)), ()
        if body.parent is not None:
            parent = found[body.parent]
            base, jacobian, above = parent.end, parent.at_end, parent.moving
        own = tree.dof_slice(body.name)
        moving = (*above, *range(own.start, own.stop))
        g, at = base @ body.mount, own.start
        jacobian = jnp.concatenate([jacobian, jnp.zeros((6, body.dofs))], axis=1)
        steps: list[Steps] = []
        for axes in body.joint.groups:
            step, g, jacobian = _joint_step(axes, q, at, moving, g, jacobian)
            steps.append(step)
            at += axes.shape[1]
        if isinstance(body, Link):
            pose = g @ lie.translation(body.sites)
            jacobians = jnp.broadcast_to(jacobian, (body.frames, *jacobian.shape))
            end = g @ lie.translation(jnp.stack([body.length, jnp.zeros(()), jnp.zeros(())]))
            strain = None
        else:
            rod, pose, jacobians, strain = _rod_steps(body, q, at, g, jacobian)
            steps.append(rod)
            end, jacobian = pose[-1], jacobians[-1]
        found[body.name] = BodyMotion(body.name, moving, pose, jacobians, strain, tuple(steps), end, jacobian)
    return Motion(tree.dofs, tuple(found.values()))


def pull_back(
    tree: Tree,
    motion: Motion,
    wrench: Float[Array, "frames 6"],
    stiffness: Float[Array, "frames 6 6"],
) -> tuple[Float[Array, " dofs"], Float[Array, "dofs dofs"]]:
    """Gradient and Hessian by q of an energy whose change is Σ W_i · t_i + ½ Σ t_iᵀ K_i t_i, t_i = J_i δq.

    With w_j and K_j summed over the frames beyond step j, and C(w) y = ad_yᵀ w, the gradient is Σ S_jᵀ w_j
    and the Hessian twice the symmetric part of

        Σ_j S_jᵀ (K_j + ½ C(w_j)) (J_{j−1} + ½ S_j)  +  half the second derivative of exp(Ω_j(q)) on w_j,

    a composite-body recursion: Σ_i J_iᵀ K_i J_i and the change of J_iᵀ W_i at constant W_i in one sweep.

    wrench      (frames, 6)      W [moment N m; force N], in the world about its origin
    stiffness   (frames, 6, 6)   K, symmetric
    returns     (dofs,) and (dofs, dofs)
    """
    gradient: dict[int, Array] = {}
    rows: dict[int, Array] = {}
    below = {body.name: (jnp.zeros(6), jnp.zeros((6, 6))) for body in tree.bodies}
    for body in reversed(tree.bodies):
        at, own = motion[body.name], tree.frame_slice(body.name)
        w, k = wrench[own], stiffness[own]
        below_w, below_k = below[body.name]
        all_w, all_k = below_w + w.sum(0), below_k + k.sum(0)
        if body.parent is not None:
            parent_w, parent_k = below[body.parent]
            below[body.parent] = parent_w + all_w, parent_k + all_k
        for step in reversed(at.steps):
            is_rod = step.curvature.bracket is not None
            # Distal to a joint is everything; distal to rod step j are the points from j + 1 on.
            beyond_w = _sums_from_the_end(w[1:], below_w) if is_rod else all_w[None]
            beyond_k = _sums_from_the_end(k[1:], below_k) if is_rod else all_k[None]
            across = jnp.swapaxes(step.columns, 1, 2)
            through = across @ (beyond_k + 0.5 * lie.coad(beyond_w))  # (steps, local, 6)
            local = across @ beyond_w[:, :, None]
            start = at.moving.index(step.first)
            own = slice(start, start + step.size)
            inside = through @ step.before[:, :, own]  # (steps, local, size)
            inside += 0.5 * (through @ step.columns + _curvature(step.curvature, beyond_w)) @ step.basis
            flat = jnp.asarray(step.basis.reshape(-1, step.size))
            gradient[step.first] = flat.T @ local.reshape(-1)
            # What lies before all steps moves them alike, so that one product does for all.
            block = flat.T @ through.reshape(-1, 6) @ step.before[0]
            block = block.at[:, own].set(flat.T @ inside.reshape(-1, step.size))
            rows[step.first] = spread(block, at.moving, tree.dofs)
    if not rows:
        return jnp.zeros(0), jnp.zeros((0, 0))
    half = jnp.concatenate([rows[first] for first in sorted(rows)])
    return jnp.concatenate([gradient[first] for first in sorted(gradient)]), half + half.T


def _sums_from_the_end(x: Float[Array, "n ..."], last: Float[Array, "..."]) -> Float[Array, "n ..."]:
    # jnp.cumsum is a window reduction of quadratic cost on the CPU: 3 times slower here.
    return jax.lax.associative_scan(jnp.add, x, reverse=True) + last


def _joint_step(
    axes: np.ndarray, q: Array, first: int, moving: tuple[int, ...], g: Array, jacobian: Array
) -> tuple[Steps, Array, Array]:
    """One exponential of a joint; returns also pose and Jacobian behind it."""
    size = axes.shape[1]
    twist = jnp.asarray(axes) @ q[first : first + size]
    columns = lie.adjoint_on(g, lie.tangent_on(twist, jnp.asarray(axes)))
    start = moving.index(first)
    after = jacobian.at[:, start : start + size].add(columns)
    step = Steps(
        first=first,
        basis=np.eye(size)[None],
        columns=columns[None],
        before=jacobian[None],
        curvature=Curvature(twist[None], g[None], jnp.asarray(axes)[None], None, ()),
    )
    return step, g @ lie.exp(twist), after


def _rod_steps(
    rod: Rod, q: Array, first: int, g: Array, jacobian: Array
) -> tuple[Steps, Array, Array, Array]:
    """The steps of a rod, and pose, Jacobian and strain at its points."""
    x = rod.quadrature.points
    count = len(x)
    rows, scale = rod.rows, rod.scale
    basis = rod.functions(step_samples(x).ravel())  # (2 steps, half, size)
    basis = basis.reshape(count - 1, 2 * len(rows), -1)
    own = q[first : first + basis.shape[-1]]
    selected = np.eye(6)[list(rows)]
    natural, samples = rod.natural[:count], rod.natural[count:].reshape(count - 1, 2, 6)
    xi = samples + (scale * (basis @ own).reshape(count - 1, 2, -1)) @ selected
    h = rod.length * np.diff(x)
    bracket = np.sqrt(3) / 12 * h**2
    ad = lie.ad(xi)
    twist = h[:, None] / 2 * (xi[:, 0] + xi[:, 1]) + bracket[:, None] * jnp.einsum(
        "sij,sj->si", ad[:, 0], xi[:, 1]
    )
    mean = h[:, None, None] / 2 * np.eye(6)
    dtwist = jnp.concatenate(
        [
            (mean - bracket[:, None, None] * ad[:, 1])[:, :, rows] * scale,
            (mean + bracket[:, None, None] * ad[:, 0])[:, :, rows] * scale,
        ],
        axis=2,
    )
    turned = lie.tangent_on(twist, dtwist)

    _, after = jax.lax.scan(lambda here, step: (here @ step, here @ step), g, lie.exp(twist))
    pose = jnp.concatenate([g[None], after])
    columns = lie.adjoint_on(pose[:-1], turned)
    moved = jax.lax.associative_scan(jnp.add, columns @ basis)
    moved = jnp.concatenate([jnp.zeros((1, *moved.shape[1:])), moved])
    above = jacobian[:, : jacobian.shape[1] - moved.shape[2]]
    jacobians = jnp.concatenate([jnp.broadcast_to(above, (count, *above.shape)), moved], axis=2)
    strain = jnp.asarray(natural) + (scale * (rod.functions(x) @ own)) @ selected
    steps = Steps(
        first=first,
        basis=basis,
        columns=columns,
        before=jacobians[:-1],
        curvature=Curvature(twist, pose[:-1], dtwist, bracket[:, None, None] * scale[:, None] * scale, rows),
    )
    return steps, pose, jacobians, strain


_ORDERS = 4


def _curvature(step: Curvature, w: Float[Array, "steps 6"]) -> Float[Array, "steps local local"]:
    """Symmetric part of the second derivative of exp(Ω(local)) on a constant spatial wrench w.

    From T = Σ_k ad(Ω)^k / (k + 1)!, with w in the frame where the step starts and X_k = ad^k dΩ, it is that
    of

        −Σ_s Σ_k (X_kᵀ C(w) X_{s−k}) (s over k + 1) / (s + 2)!,      s ≥ 1,  0 ≤ k < s,

    as C(adᵀ w) = adᵀ C(w) + C(w) ad. C(w) is skew, so k and s − k differ in sign alone, and k < s/2 is left.

    Up to four brackets are kept, which leaves θ⁵/7! of the wrench: below 1e-5 of it at 0.5 rad between
    neighbouring points of a rod, some percent at 3 rad. There Newton's method converges linearly, to the same
    point, since the gradient is exact. A joint turns further in its one step, and gets the exact derivative.
    """
    local = step.dtwist.shape[-1]
    if step.bracket is None and local == 1:
        return jnp.zeros((1, 1, 1))  # exp(a q) along one axis: no bracket
    seen = lie.coadjoint_on(step.pose, w)
    if step.bracket is None:
        return jnp.swapaxes(step.dtwist, 1, 2) @ jax.vmap(_exact_curvature)(step.twist, seen) @ step.dtwist
    ad = lie.ad(step.twist)
    x = [step.dtwist]
    for _ in range(_ORDERS):
        x.append(ad @ x[-1])
    turn = lie.coad(seen)
    whole = jnp.zeros((*seen.shape[:-1], local, local))
    for k in range((_ORDERS + 1) // 2):
        others = [x[s - k] * _curvature_weight(s, k) for s in range(2 * k + 1, _ORDERS + 1)]
        # C(w) is skew: minus its transpose.
        whole = whole + jnp.swapaxes(turn @ x[k], 1, 2) @ sum(others[1:], start=others[0])
    half = step.bracket.shape[-1]
    through = jnp.einsum("sji,sj->si", lie.tangent(step.twist), seen)
    commutator = lie.coad(through)[:, step.rows][:, :, step.rows] * step.bracket
    # Counted once and symmetrised by the caller, so twice its value stands in one of the two blocks.
    return whole.at[:, half:, :half].add(2 * commutator)


def _curvature_weight(s: int, k: int) -> float:
    """Of X_kᵀ C X_{s−k}, with that of k and s − k exchanged, which is minus its transpose."""
    below = math.comb(s, k - 1) if k else 0
    return (math.comb(s, k + 1) - below) / math.factorial(s + 2)


def _exact_curvature(twist: Float[Array, "6"], w: Float[Array, "6"]) -> Float[Array, "6 6"]:
    return jax.jacfwd(lambda x: lie.tangent(x).T @ w)(twist)
