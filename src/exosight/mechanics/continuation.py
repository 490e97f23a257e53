"""One robot under loads that change infinitely slowly: the step that is repeated until its loads are done.

The quasi-static path is the limit of overdamped motion. Loads move on straight segments, from one requested
load to the next, and the robot

- stays on its branch of stable equilibria, in steps as long as the change of pose is what the tangents at
  both ends lead to (`branch`);
- where that ends, at a fold or a corner, follows the flow to another stable equilibrium at the load of the
  end (`descent`): a snap;
- and goes on from there.

Each call evaluates the energy at one trial point, judges it (`acceptance`), records what it is and chooses
the next one (`next_trial`), so that robots side by side never wait for one another.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics import descent
from exosight.mechanics.acceptance import Point, Problem, Segment, Verdict, judge, linearise
from exosight.mechanics.branch import Anchor
from exosight.mechanics.continuation_state import ALONG, DESCEND, SNAPS, ContinuationState, Records
from exosight.mechanics.descent import Descent
from exosight.mechanics.evaluator import Evaluator
from exosight.mechanics.metric import Metric
from exosight.mechanics.next_trial import Directions, next_trial
from exosight.mechanics.robot import Robot

SNAPPED = 1e-4
"""Smallest change of pose that is reported as a snap, relative to `Metric.range`."""


def stepper(
    robot: Robot,
    evaluator: Evaluator,
    loads: Float[AnyArray, "loads channels"],
    count: Int[AnyArray, ""],
    tolerance: Float[AnyArray, ""],
    max_iterations: Int[AnyArray, ""],
) -> Callable[[ContinuationState], ContinuationState]:
    """The function that takes a robot one evaluation further; only the first `count` loads are meant."""
    metric = Metric.of(robot)
    problem = Problem(metric, evaluator.solve, robot.conservative, tolerance, max_iterations)

    def step(state: ContinuationState) -> ContinuationState:
        segment = Segment.of(state, loads, count)
        q = jnp.asarray(state.q)
        there, remembered, pose = evaluator.evaluate(q, jnp.asarray(segment.load(state.t)), state.memories)
        residual = metric.force(there.gradient) / (metric.size(q) + metric.unit)
        descending = state.phase == DESCEND
        moved, accepted = descent.accept(state.descent, metric, q, there, residual, robot.conservative)
        q, here, residual = jax.tree.map(
            lambda a, b: jnp.where(descending, a, b),
            (moved.q, moved.here, moved.residual),
            (q, there, residual),
        )
        point = linearise(state, problem, segment, q, here, residual)
        verdict = judge(state, problem, segment, point)
        flow, shift = _flow(problem, moved, point, descending & accepted & ~verdict.arrived)
        tangent = point.response @ jnp.where(verdict.at_load, segment.following, segment.span)
        correction = jnp.where(state.phase == ALONG, point.bordered.q, point.newton)
        taken = jnp.where(verdict.arrived, tangent, jnp.where(descending, flow, correction))
        free = evaluator.step_fraction(pose, taken)
        by_t = segment.span @ here.load_gradient
        going = descending & accepted & ~state.descent.fresh & ~descent.near_rest(moved)
        moved_on = verdict.arrived | going
        memories = tuple(
            jnp.where(moved_on, new, old) for new, old in zip(remembered, state.memories, strict=True)
        )
        state = state._replace(memories=memories)
        state = _settle(state, problem, segment, point, verdict, moved, tangent)
        # What is remembered changes the forces of a descent, so they are found again at the same pose.
        again = going if remembered else jnp.array(False)
        ways = Directions(correction, flow, shift, accepted, free, by_t, again)
        return next_trial(state, problem, point, verdict, ways)

    return step


def _flow(
    problem: Problem, moved: Descent, point: Point, wanted: Bool[AnyArray, ""]
) -> tuple[AnyArray, AnyArray]:
    """The step of a descent from here, and 1/h of it."""
    metric = problem.metric
    if not problem.conservative:
        shortened = jnp.minimum(1.0, moved.radius / jnp.maximum(metric.size(point.newton), 1e-300))
        return point.newton * shortened, moved.shift
    saddle = point.converged & ~point.stable
    return descent.direction(moved, metric, problem.solve, point.newton, point.stable, saddle, wanted)


def _settle(
    state: ContinuationState,
    problem: Problem,
    segment: Segment,
    point: Point,
    verdict: Verdict,
    moved: Descent,
    tangent: Float[AnyArray, " dofs"],
) -> ContinuationState:
    """The state with what has been found recorded; `tangent`: dq/dt from here on."""
    arrived, at_load, lost = verdict.arrived, verdict.at_load, verdict.lost
    metric = problem.metric
    descending = state.phase == DESCEND
    start = jnp.where(descending & (state.tries == 0), point.here.energy, state.start)
    far = metric.size(point.q - state.anchor.q) > SNAPPED * metric.range(point.q)
    # Robots that have all their loads behind them go on beside the others, but nothing of it counts.
    meant = state.load < segment.total
    jumped = arrived & descending & state.snap & far & meant
    steps = state.steps + 1
    done = (at_load | lost) & meant
    now = state._replace(
        steps=steps,
        start=start,
        snapped=state.snapped | jumped,
        tied=state.tied | (descending & point.converged & ~point.stable),
    )
    reached = jnp.where(at_load, segment.target, segment.load(state.anchor.t))
    records = _with_load(now, point, at_load, done, reached)
    records = _with_snap(now._replace(records=records), point, jumped, segment.load(state.t))
    t = jnp.where(at_load, 0.0, state.t)
    small = arrived & descending & state.snap & ~far
    return now._replace(
        load=jnp.minimum(state.load + done, segment.total),
        steps=jnp.where(done, 0, steps),
        snaps=state.snaps + jumped,
        tries=state.tries + 1,
        origin=jnp.where(done, reached, state.origin),
        anchor=Anchor(
            q=jnp.where(arrived, point.q, state.anchor.q),
            t=jnp.where(at_load | lost, 0.0, jnp.where(arrived, t, state.anchor.t)),
            tangent=jnp.where(arrived, tangent, state.anchor.tangent),
            reach=state.anchor.reach,
            memories=jax.tree.map(
                lambda new, old: jnp.where(arrived, new, old), state.memories, state.anchor.memories
            ),
        ),
        descent=moved,
        nudge=jnp.where(small, 8 * state.nudge, jnp.where(arrived, 1.0, state.nudge)),
        snapped=now.snapped & ~done,
        tied=now.tied & ~done,
        records=records,
    )


def _with_load(
    state: ContinuationState, point: Point, at_load: AnyArray, done: AnyArray, reached: AnyArray
) -> Records:
    """The records, with what was found at the present load if that is `done`."""
    records = state.records
    at = jnp.minimum(state.load, len(records.q) - 1)

    def put(into: AnyArray, value: AnyArray) -> Array:
        return jnp.asarray(into).at[at].set(jnp.where(done, value, into[at]))

    return records._replace(
        q=put(records.q, jnp.where(at_load, point.q, state.anchor.q)),
        hessian=put(records.hessian, point.here.jacobian),
        energy=put(records.energy, point.here.energy),
        residual=put(records.residual, point.residual),
        iterations=put(records.iterations, state.steps),
        converged=put(records.converged, at_load),
        snapped=put(records.snapped, state.snapped),
        tied=put(records.tied, state.tied),
        load=put(records.load, reached),
        memories=jax.tree.map(
            lambda into, new, old: put(into, jnp.where(at_load, new, old)),
            records.memories,
            state.memories,
            state.anchor.memories,
        ),
    )


def _with_snap(state: ContinuationState, point: Point, jumped: AnyArray, load: AnyArray) -> Records:
    """The records, with a snap at `load` if the pose has `jumped`."""
    records = state.records
    at = jnp.minimum(state.snaps, SNAPS - 1)

    def put(into: AnyArray, value: AnyArray) -> Array:
        return jnp.asarray(into).at[at].set(jnp.where(jumped, value, into[at]))

    return records._replace(
        snap_step=put(records.snap_step, state.load),
        snap_load=put(records.snap_load, load),
        before=put(records.before, state.anchor.q),
        after=put(records.after, point.q),
        released=put(records.released, state.start - point.here.energy),
    )
