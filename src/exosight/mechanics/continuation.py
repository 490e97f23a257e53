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

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics import branch, descent
from exosight.mechanics.acceptance import Point, Problem, Segment, Verdict, judge, linearise
from exosight.mechanics.branch import Anchor
from exosight.mechanics.continuation_records import Entry, entry_of
from exosight.mechanics.continuation_state import ALONG, DESCEND, ContinuationState
from exosight.mechanics.descent import Asked, Damped, Descent, Flow
from exosight.mechanics.evaluator import Energy, Reached, reach, step_fraction
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.metric import Metric
from exosight.mechanics.next_trial import Directions, next_trial
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories

SNAPPED = 1e-4
"""Smallest change of pose that is reported as a snap, relative to `Metric.range`."""


class Looked(NamedTuple):
    """What a trial point is, and all that the way on from there depends on.

    state, segment    of the robot that looks
    problem           what stays the same
    reached, motion   what the step to the point leads to
    point, verdict    what it is
    moved, accepted   a descent there, and whether the trial point is a step of it
    newton            Newton's step from there
    whole, saddle     whether that is the descent's next one, and whether it is at a saddle
    tangent           dq/dt from here on
    correction        Newton's step, at a load or along the branch
    """

    state: ContinuationState
    segment: Segment
    problem: Problem
    reached: Reached
    motion: Motion
    point: Point
    verdict: Verdict
    moved: Descent
    accepted: Bool[AnyArray, ""]
    newton: Flow
    whole: Bool[AnyArray, ""]
    saddle: Bool[AnyArray, ""]
    tangent: Float[AnyArray, " dofs"]
    correction: Float[AnyArray, " dofs"]


def look(
    robot: Robot,
    metric: Metric,
    energy: Energy,
    state: ContinuationState,
    segment: Segment,
    tolerance: Float[AnyArray, ""],
    max_iterations: Int[AnyArray, ""],
) -> tuple[Asked, Looked]:
    """The first half of a step: evaluate and judge the trial point; with what `descent.damped` is to find."""
    working = np.array([float(channel not in robot.clocks) for channel in range(len(segment.span))])
    problem = Problem(metric, working, robot.conservative, tolerance, max_iterations)
    descending = state.phase == DESCEND
    least = jnp.where(descending, descent.least(state.descent), jnp.inf)
    trial, loads = jnp.asarray(state.q), jnp.asarray(segment.load(state.t))
    reached, motion = reach(robot, metric, energy, trial, loads, state.memories, least)
    residual = metric.residual(state.q, reached.here.gradient)
    moved, accepted = descent.accept(
        state.descent, metric, state.q, reached.here, reached.gradient, residual, robot.conservative
    )
    q, here, residual = jax.tree.map(
        lambda a, b: jnp.where(descending, a, b),
        (moved.q, moved.here, moved.residual),
        (state.q, reached.here, residual),
    )
    point = linearise(state, problem, segment, q, here, residual)
    verdict = judge(state, problem, segment, point)
    wanted = descending & accepted & ~verdict.arrived
    saddle = point.converged & ~point.stable
    if robot.conservative:
        asked, whole = descent.ask(moved, metric, point.newton, point.stable, saddle, wanted)
        step = Flow(point.newton, jnp.array(0.0), point.newton @ moved.here.hessian @ point.newton)
    else:  # there is no flow: of Newton's step as much as the trust radius allows
        asked, whole = Asked(point.newton, moved.shift, moved.radius, jnp.array(False)), jnp.array(True)
        part = jnp.minimum(1.0, moved.radius / jnp.maximum(metric.size(point.newton), 1e-300))
        step = part * point.newton
        step, saddle = Flow(step, moved.shift, step @ moved.here.hessian @ step), jnp.array(False)
    return asked, Looked(
        state,
        segment,
        problem,
        reached,
        motion,
        point,
        verdict,
        moved,
        accepted,
        step,
        whole,
        saddle,
        tangent=point.response @ jnp.where(verdict.at_load, segment.following, segment.span),
        correction=jnp.where(state.phase == ALONG, point.bordered.q, point.newton),
    )


def go_on(robot: Robot, seen: Looked, found: Damped) -> tuple[ContinuationState, Entry]:
    """The second half: the next trial point, and what is to be recorded."""
    state, point, verdict, moved = seen.state, seen.point, seen.verdict, seen.moved
    flow = descent.direction(moved, seen.newton, point.stable, seen.saddle, seen.whole, found)
    going = jnp.where(state.phase == DESCEND, flow.step, seen.correction)
    free = step_fraction(robot, seen.motion, jnp.where(verdict.arrived, seen.tangent, going))
    taken = _dissipated(robot, seen.reached.memories) - _dissipated(robot, state.anchor.memories)
    by_t = seen.segment.span @ point.here.load_gradient
    moved_on = verdict.arrived | (seen.reached.ended & seen.accepted)
    memories = tuple(
        jnp.where(moved_on, new, old) for new, old in zip(seen.reached.memories, state.memories, strict=True)
    )
    now, entry = _settle(
        state._replace(memories=memories),
        seen.problem,
        seen.segment,
        point,
        verdict,
        moved,
        seen.tangent,
        taken,
    )
    ways = Directions(seen.correction, *flow, seen.accepted, free, by_t)
    return next_trial(now, seen.problem, point, verdict, ways), entry


def _dissipated(robot: Robot, memories: Memories) -> AnyArray:
    return robot.with_memories(memories).dissipated()


def _settle(
    state: ContinuationState,
    problem: Problem,
    segment: Segment,
    point: Point,
    verdict: Verdict,
    moved: Descent,
    tangent: Float[AnyArray, " dofs"],
    taken: Float[AnyArray, ""],
) -> tuple[ContinuationState, Entry]:
    """The state with what has been found, and what to record of it.

    tangent   dq/dt from here on
    taken     what terms with a memory have dissipated since the anchor [J]
    """
    arrived, at_load, lost = verdict.arrived, verdict.at_load, verdict.lost
    metric, before = problem.metric, state.anchor
    descending, last = state.phase == DESCEND, verdict.q - point.q
    here, load = point.here, segment.load(state.t)
    by_load = here.load_energy + here.load_gradient @ last
    unloaded = here.energy + here.gradient @ last - load @ by_load
    first = (state.load == 0) & (state.steps == 0)  # the trial point is where it all begins
    before = before._replace(
        energy=jnp.where(first, unloaded, before.energy), by_load=jnp.where(first, by_load, before.by_load)
    )
    point = point._replace(q=verdict.q)
    far = metric.size(point.q - state.anchor.q) > SNAPPED * metric.range(point.q)
    # Robots that have all their loads behind them go on beside the others, but nothing of it counts.
    meant = state.load < segment.total
    jumped = arrived & descending & state.snap & far & meant
    steps = state.steps + 1
    done = (at_load | lost) & meant
    released = before.energy + load @ before.by_load - here.energy
    spent = jnp.where(descending, released, taken)
    work = segment.span * problem.working
    response = point.response @ segment.span
    gained = branch.integral(
        jnp.where(at_load, 1.0, verdict.t) - before.t,
        (work @ before.by_load, work @ by_load),
        (work @ before.by_load_rate, work @ (here.load_gradient @ response)),
    )
    gained = jnp.where(
        descending, (load - segment.load(before.t)) @ (problem.working * before.by_load), gained
    )
    now = state._replace(
        steps=steps,
        supplied=state.supplied + jnp.where(arrived, gained, 0.0),
        dissipated=state.dissipated + jnp.where(arrived, spent, 0.0),
        snapped=state.snapped | jumped,
        tied=state.tied | (descending & point.converged & ~point.stable),
    )
    reached = jnp.where(at_load, segment.target, segment.load(state.anchor.t))
    entry = entry_of(now, point, at_load, done, reached, jumped, load, released, taken)
    if state.memories:  # the steps are part of the result, and guesses would change these
        bend = twist = jnp.zeros_like(before.bend)
    else:
        bend, twist = branch.curvature(metric, before, point.q, verdict.t, response)
    scale = jnp.where(descending, 0.0, jnp.where(at_load, segment.ratio, 1.0))
    small = arrived & descending & state.snap & ~far
    now = now._replace(
        load=jnp.minimum(state.load + done, segment.total),
        steps=jnp.where(done, 0, steps),
        snaps=state.snaps + jumped,
        tries=state.tries + 1,
        origin=jnp.where(done, reached, state.origin),
        anchor=Anchor(
            q=jnp.where(arrived, point.q, before.q),
            t=jnp.where(at_load | lost, 0.0, jnp.where(arrived, verdict.t, before.t)),
            tangent=jnp.where(arrived, tangent, before.tangent),
            bend=jnp.where(arrived, scale**2 * bend, before.bend),
            twist=jnp.where(arrived, scale**3 * twist, before.twist),
            reach=before.reach,
            memories=jax.tree.map(
                lambda new, old: jnp.where(arrived, new, old), state.memories, before.memories
            ),
            energy=jnp.where(arrived, unloaded, before.energy),
            by_load=jnp.where(arrived, by_load, before.by_load),
            by_load_rate=jnp.where(arrived, here.load_gradient @ tangent, before.by_load_rate),
        ),
        descent=moved,
        nudge=jnp.where(small, 8 * state.nudge, jnp.where(arrived, 1.0, state.nudge)),
        snapped=now.snapped & ~done,
        tied=now.tied & ~done,
        supplied=jnp.where(done, 0.0, now.supplied),
        dissipated=jnp.where(done, 0.0, now.dissipated),
    )
    return now, entry
