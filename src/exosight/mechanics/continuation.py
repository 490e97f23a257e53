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
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics import descent
from exosight.mechanics.acceptance import Point, Problem, Segment, Verdict, judge, linearise
from exosight.mechanics.branch import Anchor
from exosight.mechanics.continuation_state import ALONG, DESCEND, SNAPS, ContinuationState, Records
from exosight.mechanics.descent import Descent
from exosight.mechanics.energy import Evaluation
from exosight.mechanics.evaluator import Evaluator, Solve
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
    limits = Metric.of(robot), tolerance, max_iterations

    def step(state: ContinuationState) -> ContinuationState:
        segment = Segment.of(state, loads, count)
        now = state._replace(records=None)
        there, remembered, pose = evaluator.evaluate(
            jnp.asarray(state.q), jnp.asarray(segment.load(state.t)), state.memories
        )
        seen = evaluator.call(_assessed(robot.conservative), limits, segment, now, there)
        before = state.descent.here
        kept = jax.tree.map(lambda a, b: jnp.where(seen.accepted, a, b), _matrices(there), _matrices(before))
        hessian, coupling = jax.tree.map(
            lambda a, b: jnp.where(state.phase == DESCEND, a, b), kept, _matrices(there)
        )
        problem = Problem(limits[0], robot.conservative, *limits[1:])
        flow, shift = _flow(problem, evaluator.solve, kept[0], seen)
        free = evaluator.step_fraction(pose, jnp.where(seen.flowing, flow, seen.onwards))
        now = now._replace(descent=now.descent._replace(here=_slim(before)))
        now, entry = evaluator.call(
            _advanced(robot.conservative),
            limits,
            segment,
            now,
            remembered,
            seen,
            Flow(flow, shift, flow @ kept[0] @ flow),
            free,
        )
        here = now.descent.here._replace(hessian=kept[0], coupling=kept[1])
        entry.of_load["hessian"] = hessian if coupling is None else hessian + coupling
        return now._replace(descent=now.descent._replace(here=here), records=_recorded(state.records, entry))

    return step


def _matrices(here: Evaluation) -> tuple[AnyArray, AnyArray | None]:
    return here.hessian, here.coupling


def _slim(here: Any) -> Any:
    """Without its matrices, which are not worth moving in and out of programs."""
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
    onwards           the tangent if arrived, else Newton's step, at a load or along the branch
    flowing, wanted   the step of a descent is taken in its place; it is to be found
    """

    point: Point
    verdict: Verdict
    moved: Descent
    accepted: Bool[AnyArray, ""]
    tangent: Float[AnyArray, " dofs"]
    onwards: Float[AnyArray, " dofs"]
    flowing: Bool[AnyArray, ""]
    wanted: Bool[AnyArray, ""]


@cache
def _assessed(conservative: bool) -> Callable[..., Seen]:
    """The function that judges a trial point, for robots whose forces all have a potential or not."""

    def assess(limits: tuple, segment: Segment, state: ContinuationState, there: Evaluation) -> Seen:
        problem = _problem(conservative, limits)
        metric = problem.metric
        residual = metric.force(there.gradient) / (metric.size(state.q) + metric.unit)
        descending = state.phase == DESCEND
        moved, accepted = descent.accept(state.descent, metric, state.q, there, residual, conservative)
        q, here, residual = jax.tree.map(
            lambda a, b: jnp.where(descending, a, b),
            (moved.q, moved.here, moved.residual),
            (state.q, there, residual),
        )
        point = linearise(state, problem, segment, q, here, residual)
        verdict = judge(state, problem, segment, point)
        tangent = point.response @ jnp.where(verdict.at_load, segment.following, segment.span)
        correction = jnp.where(state.phase == ALONG, point.bordered.q, point.newton)
        return Seen(
            point._replace(here=_slim(point.here)),
            verdict,
            moved._replace(here=_slim(moved.here)),
            accepted,
            tangent,
            onwards=jnp.where(verdict.arrived, tangent, correction),
            flowing=descending & ~verdict.arrived,
            wanted=descending & accepted & ~verdict.arrived,
        )

    return assess


class Entry(NamedTuple):
    """What is to be recorded: at load `load` if `done`, and a snap on the way to it if `jumped`."""

    load: Int[AnyArray, ""]
    snap: Int[AnyArray, ""]
    done: Bool[AnyArray, ""]
    jumped: Bool[AnyArray, ""]
    of_load: dict[str, Any]
    of_snap: dict[str, Any]


@cache
def _advanced(conservative: bool) -> Callable[..., tuple[ContinuationState, Entry]]:
    """The function to the next trial point, for robots whose forces all have a potential or not."""

    def advance(
        limits: tuple,
        segment: Segment,
        state: ContinuationState,
        remembered: Memories,
        seen: Seen,
        flow: Flow,
        free: Float[AnyArray, ""],
    ) -> tuple[ContinuationState, Entry]:
        problem = _problem(conservative, limits)
        point, verdict, moved = seen.point, seen.verdict, seen.moved
        correction = jnp.where(state.phase == ALONG, point.bordered.q, point.newton)
        by_t = segment.span @ point.here.load_gradient
        going = (state.phase == DESCEND) & seen.accepted & ~state.descent.fresh & ~descent.near_rest(moved)
        moved_on = verdict.arrived | going
        memories = tuple(
            jnp.where(moved_on, new, old) for new, old in zip(remembered, state.memories, strict=True)
        )
        state = state._replace(memories=memories)
        state, entry = _settle(state, problem, segment, point, verdict, moved, seen.tangent)
        # What is remembered changes the forces of a descent, so they are found again at the same pose.
        again = going if remembered else jnp.array(False)
        ways = Directions(correction, *flow, seen.accepted, free, by_t, again)
        return next_trial(state, problem, point, verdict, ways), entry

    return advance


def _problem(conservative: bool, limits: tuple) -> Problem:
    metric, tolerance, max_iterations = limits
    lower = metric._replace(factor=jnp.tril(metric.factor))  # what a program need not multiply
    return Problem(lower, conservative, tolerance, max_iterations)


def _flow(
    problem: Problem, solve: Solve, hessian: Float[AnyArray, "dofs dofs"], seen: Seen
) -> tuple[AnyArray, AnyArray]:
    """The step of a descent from here, and 1/h of it."""
    metric, moved, point = problem.metric, seen.moved, seen.point
    if not problem.conservative:
        shortened = jnp.minimum(1.0, moved.radius / jnp.maximum(metric.size(point.newton), 1e-300))
        return point.newton * shortened, moved.shift
    saddle = point.converged & ~point.stable
    return descent.direction(moved, metric, solve, hessian, point.newton, point.stable, saddle, seen.wanted)


def _settle(
    state: ContinuationState,
    problem: Problem,
    segment: Segment,
    point: Point,
    verdict: Verdict,
    moved: Descent,
    tangent: Float[AnyArray, " dofs"],
) -> tuple[ContinuationState, Entry]:
    """The state with what has been found, and what to record of it; `tangent`: dq/dt from here on."""
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
    entry = _entry(now, point, at_load, done, reached, jumped, segment.load(state.t))
    t = jnp.where(at_load, 0.0, state.t)
    small = arrived & descending & state.snap & ~far
    now = now._replace(
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
    )
    return now, entry


def _entry(
    state: ContinuationState,
    point: Point,
    at_load: AnyArray,
    done: AnyArray,
    reached: AnyArray,
    jumped: AnyArray,
    snap_load: AnyArray,
) -> Entry:
    """What to record where the present load is `done`, and of a snap at `snap_load` if the pose has `jumped`."""
    of_load = {
        "q": jnp.where(at_load, point.q, state.anchor.q),
        "energy": point.here.energy,
        "residual": point.residual,
        "iterations": state.steps,
        "converged": at_load,
        "snapped": state.snapped,
        "tied": state.tied,
        "load": reached,
        "memories": jax.tree.map(
            lambda new, old: jnp.where(at_load, new, old), state.memories, state.anchor.memories
        ),
    }
    of_snap = {
        "snap_step": state.load,
        "snap_load": snap_load,
        "before": state.anchor.q,
        "after": point.q,
        "released": state.start - point.here.energy,
    }
    return Entry(jnp.asarray(state.load), jnp.asarray(state.snaps), done, jumped, of_load, of_snap)


def _recorded(records: Records, entry: Entry) -> Records:
    """The records with what is to be recorded."""

    def put(at: AnyArray, wanted: AnyArray) -> Callable[[AnyArray, AnyArray], Array]:
        return lambda into, value: jnp.asarray(into).at[at].set(jnp.where(wanted, value, into[at]))

    of_load = put(jnp.minimum(entry.load, len(records.q) - 1), entry.done)
    of_snap = put(jnp.minimum(entry.snap, SNAPS - 1), entry.jumped)
    new = {
        name: jax.tree.map(of_load, getattr(records, name), value) for name, value in entry.of_load.items()
    }
    new |= {name: of_snap(getattr(records, name), value) for name, value in entry.of_snap.items()}
    return records._replace(**new)
