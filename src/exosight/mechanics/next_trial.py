"""The next trial point of the quasi-static path: what comes next, where that begins, or how it goes on."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.mechanics import branch
from exosight.mechanics.acceptance import LONGEST, Point, Problem, Verdict
from exosight.mechanics.branch import NEGLIGIBLE, Beyond, Bracket
from exosight.mechanics.continuation_state import ALONG, DESCEND, TO_LOAD, ContinuationState
from exosight.mechanics.descent import UPHILL, Descent

PUSH = 0.003
"""First step from the end of a branch, along the tangent there, and first trust radius of the descent;
relative to `Metric.range`."""

ROUGHLY = 1e-4
"""In the place of NEGLIGIBLE for robots with friction."""

MARGIN = 0.02
"""How far before a corner to look for the last equilibrium first, relative to the way there."""

CORNER = 30.0
"""How far a corner may be, relative to what counts, that needs no equilibrium nearer to it: from there its
place is known to a thirtieth."""

BEYOND = 8.0
"""How much longer than the step over a corner, which is short, the one after it is."""


class Directions(NamedTuple):
    """Where the point's linear algebra leads.

    correction   Newton's step, at a load or along the branch
    flow         the step of the descent, 1/h of it, and flowᵀ ∇²Π flow; `accepted`: to be taken, from a point
                 accepted
    free         how much of the direction taken from here (the tangent, if arrived) before a gap closes
    by_t         ∂∇Π/∂t
    """

    correction: Float[AnyArray, " dofs"]
    flow: Float[AnyArray, " dofs"]
    shift: Float[AnyArray, ""]
    curvature: Float[AnyArray, ""]
    accepted: Bool[AnyArray, ""]
    free: Float[AnyArray, ""]
    by_t: Float[AnyArray, " dofs"]


class Plan(NamedTuple):
    """What comes next; if none of the first three, what was begun goes on.

    to_load, along, descend   which phase begins
    goal                      t of TO_LOAD
    s, from_end               length of ALONG; it begins at `look` of the end of the branch
    past                      t of the descent
    failed, at_corner         the last trial is taken back, to before a corner
    """

    to_load: Bool[AnyArray, ""]
    along: Bool[AnyArray, ""]
    descend: Bool[AnyArray, ""]
    goal: Float[AnyArray, ""]
    s: Float[AnyArray, ""]
    look: Bracket
    from_end: Bool[AnyArray, ""]
    past: Float[AnyArray, ""]
    failed: Bool[AnyArray, ""]
    at_corner: Bool[AnyArray, ""]


def next_trial(
    state: ContinuationState, problem: Problem, point: Point, verdict: Verdict, ways: Directions
) -> ContinuationState:
    """The state with the next trial point."""
    metric = problem.metric
    reach = jnp.where(verdict.arrived, ways.free, state.anchor.reach)
    anchor = state.anchor._replace(reach=reach)
    state = state._replace(anchor=anchor)
    scale = metric.size(anchor.q) + metric.unit
    narrow = _negligible(state) * scale / jnp.maximum(metric.force(ways.by_t), 1e-300)
    beyond = _beyond(state, point, verdict)
    look = branch.bracket(metric, anchor, beyond, narrow)
    plan = _plan(state, problem, verdict, beyond.known, look, narrow)
    if not problem.conservative:
        plan = _without_energy(state, plan, verdict)
    begun = plan.to_load | plan.along | plan.descend

    # Where what comes next begins …
    speed = jnp.maximum(metric.size(anchor.tangent), 1e-300)
    goal = jnp.where(plan.goal > 1 - 1e-9, 1.0, plan.goal)
    onwards = jnp.minimum(goal - anchor.t, anchor.reach)
    length = jnp.minimum(plan.s / speed, anchor.reach)
    rising = jnp.where(verdict.passed, point.bordered.dt, 1.0)
    back = verdict.q + (1 - verdict.t) / rising * verdict.tangent  # from beyond the load
    push = jnp.where(verdict.lost, 0.0, PUSH * metric.range(anchor.q))
    # … or how what was begun goes on.
    walk = _walk(state.descent, point, plan, ways, jnp.where(verdict.lost, jnp.inf, push))
    whole = jnp.minimum(1.0, ways.free)
    grown = jnp.where((state.growth > 0) & (state.growth < 1), BEYOND, 2.0)
    newton = point.q + whole * ways.correction
    bordered_t = jnp.where(state.phase == ALONG, state.t + whole * point.bordered.t, state.t)

    def choose(load: Any, length: Any, flow: Any, go: Any) -> Array:
        return jnp.where(plan.to_load, load, jnp.where(plan.along, length, jnp.where(plan.descend, flow, go)))

    return state._replace(
        phase=choose(TO_LOAD, ALONG, DESCEND, state.phase),
        tries=jnp.where(begun, 0, state.tries),
        beyond=beyond._replace(
            known=beyond.known
            & look.sound
            & ~plan.to_load
            & ~plan.descend
            & ~(plan.failed & (state.phase == TO_LOAD))
        ),
        descent=walk,
        q=choose(
            jnp.where(verdict.passed, back, anchor.ahead(metric, onwards)[0]),
            jnp.where(plan.from_end, look.q, anchor.ahead(metric, length)[0]),
            anchor.q + anchor.tangent * jnp.minimum(push / speed, anchor.reach),
            jnp.where(state.phase == DESCEND, walk.q + walk.fraction * walk.step, newton),
        ),
        t=choose(goal, jnp.where(plan.from_end, look.t, anchor.t + length), plan.past, bordered_t),
        s=jnp.where(plan.along, plan.s, state.s),
        growth=jnp.where(
            plan.failed,
            jnp.where(plan.at_corner, 2 * MARGIN, 1.0),
            jnp.where(verdict.arrived, grown, jnp.where(verdict.passed, 0.0, state.growth)),
        ),
        previous=jax.tree.map(
            lambda gone, now: jnp.where(begun | (whole < 1), gone, now),
            (state.previous[0], jnp.inf),
            (verdict.tangent, metric.size(ways.correction)),
        ),
        memories=jax.tree.map(lambda kept, now: jnp.where(begun, kept, now), anchor.memories, state.memories),
        snap=jnp.where(plan.descend, ~verdict.lost, state.snap),
    )


def _negligible(state: ContinuationState) -> float:
    """Friction is integrated to first order, so ends of branches need not be known better."""
    return ROUGHLY if state.memories else NEGLIGIBLE


def _beyond(state: ContinuationState, point: Point, verdict: Verdict) -> Beyond:
    """An unstable point stays the far end of the bracket while its near end moves up."""
    along, unstable, end = state.phase == ALONG, verdict.unstable, state.beyond
    known = unstable | (end.known & along & ~verdict.passed & ~verdict.lost)
    return Beyond(
        known,
        jnp.where(unstable, point.q, end.q),
        jnp.where(unstable, state.t, end.t),
        jnp.where(unstable, point.bordered.dq, end.dq),
        jnp.where(unstable, point.bordered.dt, end.dt),
        jnp.where(along & known, end.tries + (verdict.arrived | unstable), 0),
    )


def _plan(
    state: ContinuationState,
    problem: Problem,
    verdict: Verdict,
    known: Bool[AnyArray, ""],
    look: Bracket,
    narrow: Float[AnyArray, ""],
) -> Plan:
    """What comes next, given what the point is and whether an unstable one further along is known."""
    arrived, lost, anchor, metric = verdict.arrived, verdict.lost, state.anchor, problem.metric
    to_load, along = state.phase == TO_LOAD, state.phase == ALONG
    speed = jnp.maximum(metric.size(anchor.tangent), 1e-300)
    longest = LONGEST * metric.range(anchor.q)
    lone = verdict.unstable & ~look.sound  # an unstable point that the branch does not lead to
    known = known & look.sound
    narrowed = known & (verdict.unstable | (arrived & along))
    failed = verdict.failed | lone

    # How far to go: less than what failed, to before a corner if one was seen, else further than before.
    corner = verdict.corner * jnp.where(to_load, speed, 1.0)
    led_past = to_load & (state.growth == 0)  # so did the last length along the branch
    at_corner = failed & jnp.isfinite(corner) & ~led_past
    shorter = jnp.where(to_load & ~led_past, 0.5 * speed * (state.t - anchor.t), 0.25 * state.s)
    shorter = jnp.where(at_corner, (1 - MARGIN) * corner, shorter)
    s = jnp.where(failed, shorter, jnp.where(narrowed, look.s, state.growth * state.s))
    s = jnp.minimum(s, longest)

    cornered = at_corner & (corner <= (1.0 if state.memories else CORNER) * narrow * speed)
    nothing_near = failed & (s < _negligible(state) * (metric.size(anchor.q) + metric.unit))
    ended = (narrowed & look.found) | nothing_near | cornered | lost
    easy = arrived & along & ~known & (speed * (1 - anchor.t) < 2 * state.s)
    # At most 1 once a trial from this pose has failed or led past the load, where Newton's method at the load
    # would be tried again.
    untried = state.growth > 1
    to_go = verdict.passed | (arrived & ~along) | easy | (narrowed & untried & (look.t >= 1))
    descend = ended & ~verdict.passed
    past = jnp.maximum(jnp.where(narrowed, look.end, anchor.t), anchor.t + narrow)
    past = past + narrow * (state.nudge - 1) + jnp.where(cornered, corner / speed, 0.0)
    return Plan(
        to_load=to_go & ~descend,
        along=(failed | narrowed | (arrived & along)) & ~descend & ~to_go,
        descend=descend,
        goal=jnp.where(verdict.passed, 1.0, anchor.t + longest / speed),
        s=s,
        look=look,
        from_end=narrowed & ~failed,
        past=jnp.where(lost, 0.0, jnp.minimum(1.0, past)),
        failed=failed,
        at_corner=at_corner,
    )


def _without_energy(state: ContinuationState, plan: Plan, verdict: Verdict) -> Plan:
    """Without an energy there is no flow to follow: shorter steps are all that can be tried."""
    halfway = 0.5 * (state.anchor.t + state.t)
    return plan._replace(
        to_load=(verdict.arrived | plan.failed) & ~verdict.lost,
        along=jnp.array(False),
        descend=verdict.lost,
        goal=jnp.where(plan.failed, halfway, plan.goal),
    )


def _walk(walk: Descent, point: Point, plan: Plan, ways: Directions, radius: Float[AnyArray, ""]) -> Descent:
    """The descent with its next step, or about to begin with a trust radius."""
    step = jnp.where(ways.accepted, ways.flow, walk.step)
    return walk._replace(
        convex=point.stable,
        step=step,
        fraction=jnp.where(ways.accepted, jnp.minimum(1.0, ways.free), 0.25 * walk.fraction),
        slope=walk.here.gradient @ step,
        curvature=jnp.where(ways.accepted, ways.curvature, walk.curvature),
        shift=jnp.where(ways.accepted, ways.shift, walk.shift),
        fresh=plan.descend,
        uphill=jnp.where(plan.descend, UPHILL, walk.uphill),
        radius=jnp.where(plan.descend, radius, walk.radius),
    )
