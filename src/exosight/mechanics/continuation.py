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
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics import branch, descent
from exosight.mechanics.acceptance import Point, Problem, Segment, Verdict, judge, linearise
from exosight.mechanics.branch import Anchor
from exosight.mechanics.continuation_records import Entry, entry_of, recorded
from exosight.mechanics.continuation_state import ALONG, DESCEND, ContinuationState
from exosight.mechanics.descent import Descent
from exosight.mechanics.energy import Evaluation
from exosight.mechanics.evaluator import Evaluator, Reached, Solve
from exosight.mechanics.metric import Metric
from exosight.mechanics.next_trial import Directions, next_trial
from exosight.mechanics.robot import Robot
from exosight.mechanics.term import Memories

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
    working = np.array([float(channel not in robot.clocks) for channel in range(loads.shape[1])])
    limits = evaluator.metric, working, tolerance, max_iterations

    def step(state: ContinuationState) -> ContinuationState:
        segment = Segment.of(state, loads, count)
        now = state._replace(records=None)
        least = jnp.where(state.phase == DESCEND, descent.least(state.descent), jnp.inf)
        reached, pose = evaluator.evaluate(
            jnp.asarray(state.q), jnp.asarray(segment.load(state.t)), state.memories, least
        )
        there = reached.here
        seen = evaluator.call(_assessed(robot.conservative), limits, segment, now, there, reached.gradient)
        before, descending, arrived = state.descent.here, state.phase == DESCEND, seen.verdict.arrived
        kept = _chosen(seen.accepted, _matrices(there), _matrices(before))  # of the descent
        hessian, coupling = _chosen(descending, kept, _matrices(there))  # of the point
        wanted = descending & seen.accepted & ~arrived
        flow = _flow(robot.conservative, limits[0], evaluator.solve, kept[0], seen, wanted)
        going = jnp.where(descending, flow.step, seen.correction)
        free = evaluator.step_fraction(pose, jnp.where(arrived, seen.tangent, going))
        now = now._replace(descent=now.descent._replace(here=_without_matrices(before)))
        taken = _dissipated(robot, reached.memories) - _dissipated(robot, now.anchor.memories)
        ended: Any = reached._replace(here=None)
        now, entry = evaluator.call(
            _advanced(robot.conservative), limits, segment, now, ended, seen, flow, free, taken
        )
        here = now.descent.here._replace(hessian=kept[0], coupling=kept[1])
        jacobian = hessian if coupling is None else hessian + coupling
        records = recorded(state.records, entry, jacobian)
        return now._replace(descent=now.descent._replace(here=here), records=records)

    return step


def _dissipated(robot: Robot, memories: Memories) -> AnyArray:
    return robot.with_memories(memories).dissipated()


def _matrices(here: Evaluation) -> tuple[AnyArray, AnyArray | None]:
    return here.hessian, here.coupling


def _chosen(first: AnyArray, one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(first, a, b), one, other)


def _without_matrices(here: Any) -> Any:
    """Moving its matrices in and out of programs would take as long as what is done there."""
    return here._replace(hessian=None, coupling=None)


class Flow(NamedTuple):
    """The step of a descent, 1/h of it, and stepᵀ ∇²Π step."""

    step: Float[AnyArray, " dofs"]
    shift: Float[AnyArray, ""]
    curvature: Float[AnyArray, ""]


class Seen(NamedTuple):
    """What a trial point is, and where it leads.

    moved, accepted   a descent there, and whether the trial point is a step of it
    tangent           dq/dt from here on
    correction        Newton's step, at a load or along the branch
    """

    point: Point
    verdict: Verdict
    moved: Descent
    accepted: Bool[AnyArray, ""]
    tangent: Float[AnyArray, " dofs"]
    correction: Float[AnyArray, " dofs"]


@cache
def _assessed(conservative: bool) -> Callable[..., Seen]:
    """The function that judges a trial point, for robots whose forces all have a potential or not."""

    def assess(
        limits: tuple,
        segment: Segment,
        state: ContinuationState,
        there: Evaluation,
        arriving: Float[AnyArray, " dofs"],
    ) -> Seen:
        problem = _problem(conservative, limits)
        metric = problem.metric
        residual = metric.residual(state.q, there.gradient)
        descending = state.phase == DESCEND
        moved, accepted = descent.accept(
            state.descent, metric, state.q, there, arriving, residual, conservative
        )
        q, here, residual = jax.tree.map(
            lambda a, b: jnp.where(descending, a, b),
            (moved.q, moved.here, moved.residual),
            (state.q, there, residual),
        )
        point = linearise(state, problem, segment, q, here, residual)
        verdict = judge(state, problem, segment, point)
        tangent = point.response @ jnp.where(verdict.at_load, segment.following, segment.span)
        return Seen(
            point._replace(here=_without_matrices(point.here)),
            verdict,
            moved._replace(here=_without_matrices(moved.here)),
            accepted,
            tangent,
            correction=jnp.where(state.phase == ALONG, point.bordered.q, point.newton),
        )

    return assess


@cache
def _advanced(conservative: bool) -> Callable[..., tuple[ContinuationState, Entry]]:
    """The function to the next trial point, for robots whose forces all have a potential or not."""

    def advance(
        limits: tuple,
        segment: Segment,
        state: ContinuationState,
        reached: Reached,
        seen: Seen,
        flow: Flow,
        free: Float[AnyArray, ""],
        taken: Float[AnyArray, ""],
    ) -> tuple[ContinuationState, Entry]:
        problem = _problem(conservative, limits)
        point, verdict, moved = seen.point, seen.verdict, seen.moved
        by_t = segment.span @ point.here.load_gradient
        moved_on = verdict.arrived | (reached.ended & seen.accepted)
        memories = tuple(
            jnp.where(moved_on, new, old) for new, old in zip(reached.memories, state.memories, strict=True)
        )
        state = state._replace(memories=memories)
        state, entry = _settle(state, problem, segment, point, verdict, moved, seen.tangent, taken)
        ways = Directions(seen.correction, *flow, seen.accepted, free, by_t)
        return next_trial(state, problem, point, verdict, ways), entry

    return advance


def _problem(conservative: bool, limits: tuple) -> Problem:
    metric, working, tolerance, max_iterations = limits
    lower = metric._replace(factor=jnp.tril(metric.factor))  # what a program need not multiply
    return Problem(lower, working, conservative, tolerance, max_iterations)


def _flow(
    conservative: bool,
    metric: Metric,
    solve: Solve,
    hessian: Float[AnyArray, "dofs dofs"],
    seen: Seen,
    wanted: Bool[AnyArray, ""],
) -> Flow:
    """How a descent goes on from here; `wanted`: whether one does."""
    moved, point = seen.moved, seen.point
    if conservative:
        saddle = point.converged & ~point.stable
        step, shift = descent.direction(
            moved, metric, solve, hessian, point.newton, point.stable, saddle, wanted
        )
    else:
        shortened = jnp.minimum(1.0, moved.radius / jnp.maximum(metric.size(point.newton), 1e-300))
        step, shift = point.newton * shortened, jnp.asarray(moved.shift)
    return Flow(step, shift, step @ hessian @ step)


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
