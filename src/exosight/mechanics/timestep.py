"""One robot on its way through time: the Newton step that is repeated until a time is reached.

The equation of motion in the coordinates, with v = dq/dt and a = dv/dt,

    Σ J_iᵀ (I_i ṫ_i − ad(t_i)ᵀ I_i t_i) + D v + ∇Π(q, u) = 0,      t_i = J_i v,   ṫ_i = J_i a + (dJ_i/dt) v,

t_i being the spatial twist of frame i and I_i the spatial inertia of what it carries, is stepped by the
implicit half of the Runge–Kutta pair ARK4(3)6L[2]SA: order 4, L-stable, stiffly accurate, an embedded error
of order 3, and five stages, each a nonlinear system of the size of q. Inertia enters that system as every
energy does, as wrenches and stiffnesses of frames that are pulled back through the tree.

Why not the minimum of an incremental potential with BDF2 in the frames' poses: it is of order 2, and stays
so, because it constrains poses to the tree (index 3). Here 46 steps a second bring the tip of a 30 cm
cantilever to 2 µm; order 2 takes some thousands.

Source: C. A. Kennedy, M. H. Carpenter, Additive Runge–Kutta schemes, Applied Numerical Mathematics 44, 2003.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight import lie
from exosight.arrays import AnyArray
from exosight.mechanics.energy import damping, potential
from exosight.mechanics.kinematics import pull_back
from exosight.mechanics.robot import Robot
from exosight.mechanics.rod import Rod
from exosight.mechanics.rotation_wrap import wrap_rotations
from exosight.mechanics.tree import Tree

STAGES = 6
_DIAGONAL = 0.25
_TABLE = np.zeros((STAGES, STAGES))
_TABLE[1, :1] = 1 / 4
_TABLE[2, :2] = 8611 / 62500, -1743 / 31250
_TABLE[3, :3] = 5012029 / 34652500, -654441 / 2922500, 174375 / 388108
_TABLE[4, :4] = 15267082809 / 155376265600, -71443401 / 120774400, 730878875 / 902184768, 2285395 / 8070912
_TABLE[5, :5] = 82889 / 524892, 0.0, 15625 / 83664, 69875 / 102672, -2260 / 8211
_PLACES = np.array([0.0, 1 / 2, 83 / 250, 31 / 50, 17 / 20, 1.0])
_WEIGHTS = _TABLE[5] + np.array([0, 0, 0, 0, 0, _DIAGONAL])
_ERROR = _WEIGHTS - np.array(
    [
        4586570599 / 29645900160,
        0.0,
        178811875 / 945068544,
        814220225 / 1159782912,
        -3700637 / 11593932,
        61727 / 225920,
    ]
)

_NEWTON_STEPS = 10
"""Newton steps for a stage before its time step is shortened."""


class IntegrationState(NamedTuple):
    """Where one robot is on its way: the last accepted time, the step being tried, the stage being solved.

    time, q, v         the accepted point [s; coordinates; coordinates/s]
    kinetic …          there: kinetic and potential energy; dissipated and supplied from the start on [J]
    touch              time until the first open contact closes at this velocity [s]
    wanted, step       the step that the error asks for, and that being tried [s]
    stage, tries       stage 0 finds the acceleration at the start; Newton steps spent on the stage
    a                  the stage's acceleration as far as it is known
    size, rate         the last Newton step's size [m], and by how much one is smaller than the one before
    slopes             (stages, 2, dofs) v and a of the stages so far
    forces             (stages, channels) ∂Π/∂u at them
    steps, rejected    accepted and rejected steps
    failed             the robot has given up; it stays at the accepted point
    """

    time: Float[AnyArray, ""]
    q: Float[AnyArray, " dofs"]
    v: Float[AnyArray, " dofs"]
    kinetic: Float[AnyArray, ""]
    potential: Float[AnyArray, ""]
    dissipated: Float[AnyArray, ""]
    supplied: Float[AnyArray, ""]
    touch: Float[AnyArray, ""]
    wanted: Float[AnyArray, ""]
    step: Float[AnyArray, ""]
    stage: Int[AnyArray, ""]
    tries: Int[AnyArray, ""]
    a: Float[AnyArray, " dofs"]
    size: Float[AnyArray, ""]
    rate: Float[AnyArray, ""]
    slopes: Float[AnyArray, "stages 2 dofs"]
    forces: Float[AnyArray, "stages channels"]
    steps: Int[AnyArray, ""]
    rejected: Int[AnyArray, ""]
    failed: Bool[AnyArray, ""]


class Interval(NamedTuple):
    """From one reported time to the next: times [s], and the loads at both, linear in between."""

    start: Float[AnyArray, ""]
    end: Float[AnyArray, ""]
    load: Float[AnyArray, " channels"]
    next_load: Float[AnyArray, " channels"]


def begin(time: float, q: np.ndarray, v: np.ndarray, channels: int) -> IntegrationState:
    """The state at the start; in NumPy."""
    none, zero = np.zeros(()), np.zeros((), int)
    return IntegrationState(
        time=none + time,
        q=q,
        v=v,
        kinetic=none,
        potential=none,
        dissipated=none,
        supplied=none,
        touch=none + np.inf,
        wanted=none + np.inf,
        step=none,
        stage=zero,
        tries=zero,
        a=0 * q,
        size=none,
        rate=none + 1.0,
        slopes=np.zeros((STAGES, 2, len(q))),
        forces=np.zeros((STAGES, channels)),
        steps=zero,
        rejected=zero,
        failed=zero > 0,
    )


def spatial_inertia(tree: Tree) -> Callable[[Float[Array, "frames 4 4"]], Float[Array, "frames 6 6"]]:
    """The function from poses to each frame's inertia I, so that its kinetic energy is ½ tᵀ I t.

    t is the frame's spatial twist; I = [R J Rᵀ − m p̂ p̂, m p̂; −m p̂, m 1], J the moment of inertia about its
    own origin and in its own axes.
    """
    mass = jnp.concatenate([b.mass() if isinstance(b, Rod) else b.mass for b in tree.bodies])
    inertia = jnp.concatenate([b.inertia() if isinstance(b, Rod) else b.inertia for b in tree.bodies])

    def at(pose: Float[Array, "frames 4 4"]) -> Float[Array, "frames 6 6"]:
        rotation, p, m = pose[:, :3, :3], lie.hat(pose[:, :3, 3]), mass[:, None, None]
        turn = rotation @ inertia @ jnp.swapaxes(rotation, 1, 2) - m * (p @ p)
        upper = jnp.concatenate([turn, m * p], axis=2)
        return jnp.concatenate([upper, jnp.concatenate([-m * p, m * jnp.eye(3)], axis=2)], axis=1)

    return at


def time_stepper(
    robot: Robot,
    interval: Interval,
    tolerance: Float[AnyArray, ""],
    largest: Float[AnyArray, ""],
    adaptive: Bool[AnyArray, ""],
) -> Callable[[IntegrationState], IntegrationState]:
    """The function that takes a state one Newton step further.

    tolerance   [m]   of a step: root mean square displacement of the robot's mass
    largest     [s]   step
    adaptive          whether the error chooses the step; if not, all are the largest
    """
    evaluate = potential(robot)
    inertia_at = spatial_inertia(robot)
    viscous = damping(robot)
    mass = sum(jnp.sum(b.mass() if isinstance(b, Rod) else b.mass) for b in robot.bodies)
    span = interval.end - interval.start
    load_rate = (interval.next_load - interval.load) / span

    def advance(state: IntegrationState) -> IntegrationState:
        first, last = state.stage == 0, state.stage == STAGES - 1
        base = jnp.stack([jnp.asarray(state.q), jnp.asarray(state.v)]) + state.step * jnp.einsum(
            "s,sij->ij", _at(_TABLE, state.stage), state.slopes
        )
        implicit = jnp.where(first, 0.0, _DIAGONAL * state.step)
        v = base[1] + implicit * jnp.asarray(state.a)
        q = base[0] + implicit * v
        load = (
            interval.load + (state.time + _at(_PLACES, state.stage) * state.step - interval.start) * load_rate
        )

        # Differentiated along v for dJ/dt; what is not needed of it is never computed.
        (here, motion), (_, moving) = jax.jvp(lambda q: evaluate(q, jnp.asarray(load)), (q,), (v,))
        jacobian, inertia = motion.jacobian, inertia_at(motion.pose)
        twist = jacobian @ v
        momentum = _times(inertia, twist)
        acceleration = jacobian @ jnp.asarray(state.a) + moving.jacobian @ v
        wrench = _times(inertia, acceleration) - _times(lie.coad(momentum), twist)
        # Stage 0 is solved for a alone: the limit of a stage of no length.
        length = jnp.where(first, 1e-14, implicit)
        pulled, tangent = pull_back(robot, motion, wrench, inertia / length**2)
        residual = pulled + viscous @ v + here.gradient
        # How the wrenches change with v, and with the turning of inertia; what is of order |t|² is left out.
        turned = jnp.swapaxes(lie.ad(twist), 1, 2) @ inertia
        whirl = (
            2 * inertia @ moving.jacobian
            - (turned + jnp.swapaxes(turned, 1, 2) + lie.coad(momentum)) @ jacobian
        ) / length
        whirl = whirl - lie.coad(_times(inertia, acceleration)) @ jacobian
        matrix = tangent + here.hessian + viscous / length + jnp.einsum("fkp,fkq->pq", jacobian, whirl)
        change = -jnp.linalg.solve(matrix, residual)
        weight = jnp.diag(matrix) * length**2  # at stage 0 the mass that each coordinate moves
        massless = first & jnp.any(weight <= 1e-14 * jnp.max(weight))

        def distance(q: Array) -> Array:
            """Root mean square displacement of the robot's mass [m]."""
            moved = jacobian @ q
            return jnp.sqrt(jnp.sum(moved * _times(inertia, moved)) / mass)

        # Converged once the distance still to go, by the rate so far, is small beside the tolerance.
        size = distance(change)
        rate = jnp.where(state.tries > 0, size / jnp.maximum(state.size, 1e-300), state.rate)
        left = size * rate / jnp.maximum(1 - rate, 0.1)
        solved = first | (left < 1e-2 * tolerance)
        tries = state.tries + 1
        lost = massless | ~jnp.isfinite(size) | (~solved & ((rate > 2) | (tries >= _NEWTON_STEPS)))
        solved = solved & ~lost
        a = state.a + change / length**2
        v = v + jnp.where(first, 0.0, change / length)
        q = q + jnp.where(first, 0.0, change)
        here_now = jnp.arange(STAGES) == state.stage
        slopes = jnp.where((here_now & solved)[:, None, None], jnp.stack([v, a]), state.slopes)
        forces = jnp.where((here_now & solved)[:, None], here.load_energy, state.forces)

        # The end of a step, and of stage 0, from which the first step begins.
        error = jnp.tensordot(_ERROR, slopes, 1) * state.step
        error = jnp.maximum(distance(error[0]), state.step * distance(error[1])) / tolerance
        good = (error <= 1) | ~adaptive
        arrived = solved & last & good
        refused = lost | (solved & last & ~good)
        factor = jnp.where(lost, 0.25, jnp.clip(0.9 * error**-0.25, 0.2, 5.0))
        near = jnp.sqrt(tolerance / jnp.maximum(distance(a), 1e-300))
        chosen = jnp.where(arrived | refused, state.step * factor, state.wanted)
        chosen = jnp.where(first & jnp.isinf(state.wanted), near, chosen)
        given_step = jnp.where(refused, 0.25 * state.step, jnp.where(arrived | first, largest, state.wanted))
        wanted = jnp.minimum(jnp.where(adaptive, chosen, given_step), largest)
        time = jnp.where(arrived, state.time + state.step, state.time)
        time = jnp.where(interval.end - time < 1e-9 * span, interval.end, time)
        known = arrived | (first & solved)
        time_to_touch = [term.max_step_fraction(robot, motion, v) for term in robot.terms]
        touch = jnp.where(known, jnp.min(jnp.stack([jnp.array(jnp.inf), *time_to_touch])), state.touch)
        moved = jacobian @ v
        spent = jnp.sum(_WEIGHTS * jnp.einsum("sp,pq,sq->s", slopes[:, 0], viscous, slopes[:, 0]))
        given = _WEIGHTS @ (forces @ load_rate)
        starts = known | refused
        other_q, other_v, rewritten = wrap_rotations(robot, q, v)
        rewritten = rewritten & arrived  # then the acceleration is found anew, by stage 0
        stage = jnp.where(rewritten, 0, jnp.where(starts, 1, state.stage + solved))
        return IntegrationState(
            time=time,
            q=jnp.where(arrived, other_q, state.q),
            v=jnp.where(arrived, other_v, state.v),
            kinetic=jnp.where(known, 0.5 * jnp.sum(moved * _times(inertia, moved)), state.kinetic),
            potential=jnp.where(
                known, here.energy + jnp.where(first, 0.0, here.gradient @ change), state.potential
            ),
            dissipated=state.dissipated + jnp.where(arrived, state.step * spent, 0.0),
            supplied=state.supplied + jnp.where(arrived, state.step * given, 0.0),
            touch=touch,
            wanted=wanted,
            step=jnp.where(starts, next_step(time, wanted, touch, interval), state.step),
            stage=stage,
            tries=jnp.where(solved | refused, 0, tries),
            a=jnp.where(refused, slopes[0, 1], a),
            size=size,
            rate=jnp.where(refused, 1.0, jnp.where(solved, jnp.clip(rate, 1e-3, 1.0) ** 0.8, rate)),
            slopes=slopes.at[0].set(jnp.where(arrived, slopes[-1], slopes[0])),
            forces=forces.at[0].set(jnp.where(arrived, forces[-1], forces[0])),
            steps=state.steps + arrived,
            rejected=state.rejected + refused,
            failed=state.failed | (refused & (first | (wanted < 1e-9 * span))),
        )

    return advance


def next_step(
    time: Float[AnyArray, ""], wanted: Float[AnyArray, ""], touch: Float[AnyArray, ""], interval: Interval
) -> Float[Array, ""]:
    """The step [s] to try: equal parts of what is left, none longer than wanted or past a closing contact."""
    left = interval.end - time
    parts = jnp.ceil(left / jnp.maximum(wanted, 1e-300) - 1e-9)
    return jnp.minimum(left / jnp.maximum(parts, 1.0), touch)


def _times(matrix: Float[Array, "frames 6 6"], vector: Float[Array, "frames 6"]) -> Float[Array, "frames 6"]:
    return jnp.einsum("fij,fj->fi", matrix, vector)


def _at(table: np.ndarray, index: Int[AnyArray, ""]) -> Array:
    return jnp.asarray(table)[index]
