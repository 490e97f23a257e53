"""The one walk down the kinematic tree, and the way back up it.

`walk` goes from coordinates q to poses and spatial Jacobians, body by body and step by step; everything
that needs a pose reads its `Motion`. A step multiplies the pose by exp(Ω(q)): a joint is one step, with
Ω = axes · q, a rod one step between each two neighbouring points, with the fourth-order Magnus twist

    Ω = h/2 (ξ₁ + ξ₂) + (√3/12) h² [ξ₁, ξ₂],      ξ₁, ξ₂ at the Gauss (Zannah) points of the interval.

With T the left Jacobian of SE(3), the spatial columns of a step are S_j = Ad(g_{j−1}) T(Ω_j) ∂Ω_j/∂q, and the
spatial Jacobian of frame i is the sum of S_j over the steps above it. `geometric_stiffness` is the way back:
how Jᵀ W changes with q while the spatial wrenches W stay as they are.

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
from exosight.mechanics.link import Link
from exosight.mechanics.robot import Body, Robot
from exosight.mechanics.rod import STRAIGHT, Rod

ZANNAH = np.array([0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6])
"""Where a step samples the strain, as fractions of its interval."""


class Steps(eqx.Module):
    """The steps of one joint or one rod. `local` are the variables that a step depends on: a joint's own
    coordinates, or a rod's enabled strains at its two Zannah points; local = basis · q[start : start + size].

    start       first coordinate (static)
    basis       (steps, local, size)   constant numbers
    columns     (steps, 6, local)      spatial columns by local variable: S = columns · basis
    before      (steps, 6, dofs)       spatial Jacobian of the frame that a step starts from
    adjoint     (steps, 6, 6)          Ad of that frame
    twist       (steps, 6)             Ω
    tangent     (steps, 6, 6)          T(Ω)
    dtwist      (steps, 6, local)      ∂Ω/∂local
    bracket     (steps, half, half) or None    what multiplies [ξ₁, ξ₂] in Ω, by enabled strain
    rows        the enabled strains' rows in a twist (static)
    """

    start: int = eqx.field(static=True)
    rows: tuple[int, ...] = eqx.field(static=True)
    basis: np.ndarray
    columns: Float[Array, "steps 6 local"]
    before: Float[Array, "steps 6 dofs"]
    adjoint: Float[Array, "steps 6 6"]
    twist: Float[Array, "steps 6"]
    tangent: Float[Array, "steps 6 6"]
    dtwist: Float[Array, "steps 6 local"]
    bracket: Float[Array, "steps half half"] | None


class Motion(eqx.Module):
    """What the walk found: every frame's pose and Jacobian, body by body.

    pose       (frames, 4, 4)       local to world [m]
    jacobian   (frames, 6, dofs)    spatial: the twist of frame i is jacobian[i] · dq/dt
    strain     one (points, 6) array a rod, in the order of the bodies
    steps      the steps of each body, for the way back
    end        (bodies, 4, 4)       pose of each body's end, where its children attach
    """

    pose: Float[Array, "frames 4 4"]
    jacobian: Float[Array, "frames 6 dofs"]
    strain: dict[str, Float[Array, "points 6"]]
    steps: tuple[tuple[Steps, ...], ...]
    end: Float[Array, "bodies 4 4"]

    @property
    def position(self) -> Float[Array, "frames 3"]:
        """Origins of the frames in the world [m]."""
        return self.pose[:, :3, 3]

    def point_jacobian(self) -> Float[Array, "frames 3 dofs"]:
        """∂p/∂q of the frames' origins: J_v + J_ω × p."""
        angular, linear = self.jacobian[:, :3], self.jacobian[:, 3:]
        return linear + jnp.cross(angular, self.position[:, :, None], axis=1)


def walk(robot: Robot, q: Float[Array, " dofs"]) -> Motion:
    """Poses and Jacobians of every frame at coordinates q.

    q         (dofs,)   coordinates, body by body (radians, dimensionless strains)
    returns   Motion
    """
    poses, jacobians, steps, strain = [], [], [], {}
    ends: dict[str | None, tuple[Array, Array]] = {None: (jnp.eye(4), jnp.zeros((6, robot.dofs)))}
    for body in robot.bodies:
        g, jacobian = ends[body.parent]
        g = g @ body.mount
        start = robot.dof_slice(body.name).start
        own: list[Steps] = []
        if body.joint.dofs:
            joint = _joint_steps(body, q, start, g, jacobian)
            own.append(joint)
            g = g @ lie.exp(joint.twist[0])
            jacobian = _add(jacobian[None], start, joint.columns)[0]
        if isinstance(body, Link):
            poses.append(g @ lie.translation(body.sites))
            jacobians.append(jnp.broadcast_to(jacobian, (body.frames, 6, robot.dofs)))
            end = g @ lie.translation(jnp.stack([body.length, jnp.zeros(()), jnp.zeros(())]))
        else:
            rod = _rod_steps(body, q, start + body.joint.dofs, g, jacobian)
            own.append(rod[0])
            poses.append(rod[1])
            jacobians.append(rod[2])
            strain[body.name] = rod[3]
            end, jacobian = rod[1][-1], rod[2][-1]
        ends[body.name] = end, jacobian
        steps.append(tuple(own))
    return Motion(
        pose=jnp.concatenate(poses),
        jacobian=jnp.concatenate(jacobians),
        strain=strain,
        steps=tuple(steps),
        end=jnp.stack([ends[body.name][0] for body in robot.bodies]),
    )


def geometric_stiffness(
    robot: Robot, motion: Motion, wrench: Float[Array, "frames 6"]
) -> Float[Array, "dofs dofs"]:
    """∂/∂q of Σ_i J_iᵀ W_i for spatial wrenches W_i that do not change; symmetric.

    With w_j the sum of the wrenches below step j and C(w) y = ad_yᵀ w, step j adds
    S_jᵀ C(w_j) J_{j−1}, and the second derivative of exp(Ω_j(q)) itself, contracted with w_j; the latter is
    cut off at order θ⁶ of the rotation θ within a step.

    wrench    (frames, 6)    [moment N m; force N], in the world about its origin
    returns   (dofs, dofs)
    """
    total = jnp.zeros((robot.dofs, robot.dofs))
    below: dict[str | None, Array] = {body.name: jnp.zeros(6) for body in robot.bodies} | {None: jnp.zeros(6)}
    for body, steps in reversed(list(zip(robot.bodies, motion.steps, strict=True))):
        own = wrench[robot.frame_slice(body.name)]
        whole = own.sum(axis=0) + below[body.name]
        below[body.parent] = below[body.parent] + whole
        for step in steps:
            # Below a joint is everything; below rod step j are the points from j + 1 on.
            is_rod = step.bracket is not None
            w = _running_sum(own[:0:-1])[::-1] + below[body.name] if is_rod else whole[None]
            total = total + _step_stiffness(step, w, robot.dofs)
    return 0.5 * (total + total.T)


def _step_stiffness(step: Steps, w: Float[Array, "steps 6"], dofs: int) -> Float[Array, "dofs dofs"]:
    transported = jnp.swapaxes(step.columns, 1, 2) @ (lie.coad(w) @ step.before)
    inside = jnp.einsum("srb,srq->bq", step.basis, transported)
    moved = jnp.einsum("sji,sj->si", step.adjoint, w)  # the wrench, seen from the frame the step starts from
    curvature = _exponential_curvature(step.twist, moved, step.dtwist)
    local = jnp.swapaxes(step.dtwist, 1, 2) @ curvature
    if step.bracket is not None:
        half = step.bracket.shape[-1]
        seen = jnp.einsum("sji,sj->si", step.tangent, moved)
        commutator = lie.coad(seen)[:, step.rows][:, :, step.rows] * step.bracket
        # Counted once and symmetrised by the caller, so twice its value stands in one of the two blocks.
        local = local.at[:, half:, :half].add(2 * commutator)
    size = step.basis.shape[-1]
    own = jnp.einsum("sra,srb->ab", step.basis, local @ step.basis)
    columns = slice(step.start, step.start + size)
    return jnp.zeros((dofs, dofs)).at[columns].add(inside).at[columns, columns].add(own)


def _exponential_curvature(twist: Array, wrench: Array, columns: Array) -> Array:
    """∂(T(Ω)ᵀ w)/∂Ω · columns, from T = Σ_k ad(Ω)^k / (k + 1)!.

    With n_i = Σ_j (adᵀ)^j w / (i + j + 2)! it is Σ_i (adᵀ)^i C(n_i). Six orders leave θ⁶/8! of the wrench,
    below 1e-7 of it at 0.4 rad between neighbouring points of a rod and about 1e-3 at 2 rad: there Newton's
    method converges linearly, to the same point, since the gradient is exact.
    """
    orders = 6
    transposed = jnp.swapaxes(lie.ad(twist), 1, 2)
    powers = [wrench]
    for _ in range(orders - 1):
        powers.append(jnp.einsum("sij,sj->si", transposed, powers[-1]))
    total = jnp.zeros_like(columns)
    for i in reversed(range(orders)):
        weights = np.array([1 / math.factorial(i + j + 2) for j in range(orders - i)])
        weighted = jnp.tensordot(weights, jnp.stack(powers[: orders - i]), axes=1)
        total = transposed @ total + lie.coad(weighted) @ columns
    return total


def _joint_steps(body: Body, q: Array, start: int, g: Array, jacobian: Array) -> Steps:
    axes = body.joint.axes
    twist = axes @ q[start : start + body.joint.dofs]
    adjoint, tangent = lie.adjoint(g), lie.tangent(twist)
    return Steps(
        start=start,
        rows=(),
        basis=np.eye(body.joint.dofs)[None],
        columns=(adjoint @ tangent @ axes)[None],
        before=jacobian[None],
        adjoint=adjoint[None],
        twist=twist[None],
        tangent=tangent[None],
        dtwist=axes[None],
        bracket=None,
    )


def _rod_steps(
    rod: Rod, q: Array, start: int, g: Array, jacobian: Array
) -> tuple[Steps, Array, Array, Array]:
    x = rod.quadrature.points
    dx = np.diff(x)
    rows, scale = rod.rows, rod.scale
    basis = np.stack([rod.functions(x[:-1] + z * dx) for z in ZANNAH], axis=1)  # (steps, 2, half, size)
    own = q[start : start + basis.shape[-1]]
    selected = np.eye(6)[list(rows)]
    xi = jnp.asarray(STRAIGHT) + (scale * (basis @ own)) @ selected  # (steps, 2, 6)
    ad = lie.ad(xi)
    h = rod.length * dx
    bracket = np.sqrt(3) / 12 * h**2
    twist = h[:, None] / 2 * (xi[:, 0] + xi[:, 1]) + bracket[:, None] * jnp.einsum(
        "sij,sj->si", ad[:, 0], xi[:, 1]
    )
    mean = h[:, None, None] / 2 * np.eye(6)
    first = (mean - bracket[:, None, None] * ad[:, 1])[:, :, rows] * scale
    second = (mean + bracket[:, None, None] * ad[:, 0])[:, :, rows] * scale
    dtwist = jnp.concatenate([first, second], axis=2)

    _, after = jax.lax.scan(lambda here, step: (here @ step, here @ step), g, lie.exp(twist))
    pose = jnp.concatenate([g[None], after])
    adjoint = lie.adjoint(pose[:-1])
    tangent = lie.tangent(twist)
    columns = adjoint @ (tangent @ dtwist)
    flat = basis.reshape(len(dx), -1, basis.shape[-1])
    moved = _running_sum(columns @ flat)
    moved = jnp.concatenate([jnp.zeros((1, *moved.shape[1:])), moved])
    jacobians = _add(jnp.broadcast_to(jacobian, (len(x), *jacobian.shape)), start, moved)
    strain = jnp.asarray(STRAIGHT) + (scale * (rod.functions(x) @ own)) @ selected
    steps = Steps(
        start=start,
        rows=rows,
        basis=flat,
        columns=columns,
        before=jacobians[:-1],
        adjoint=adjoint,
        twist=twist,
        tangent=tangent,
        dtwist=dtwist,
        bracket=bracket[:, None, None] * scale[:, None] * scale,
    )
    return steps, pose, jacobians, strain


def _running_sum(x: Array) -> Array:
    # jnp.cumsum is a window reduction of quadratic cost on the CPU: 3 times slower here.
    return jax.lax.associative_scan(jnp.add, x)


def _add(jacobian: Array, start: int, columns: Array) -> Array:
    return jacobian.at[..., start : start + columns.shape[-1]].add(columns)
