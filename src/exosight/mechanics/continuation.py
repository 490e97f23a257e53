"""One robot under loads that change infinitely slowly: the step that is repeated until its loads are done.

The quasi-static path is the limit of overdamped motion. Loads move on straight segments, from one requested
load to the next, and the robot

- stays on its branch of stable equilibria, in steps as long as the change of pose is what the tangents at
  both ends lead to (`branch`);
- where that ends, at a fold or a corner, follows the flow to another stable equilibrium at the load of the
  end (`descent`): a snap;
- and goes on from there.

Each call evaluates the energy at one trial point and decides where the next one is, so that robots side by
side never wait for one another.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics import branch, descent
from exosight.mechanics.branch import NEGLIGIBLE, Anchor, Beyond
from exosight.mechanics.descent import Descent
from exosight.mechanics.energy import Evaluation, potential
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.metric import Metric
from exosight.mechanics.robot import Robot

TO_LOAD, ALONG, DESCEND = 0, 1, 2
"""Phases: Newton's method at a given load, at a given length along the branch, and descent."""

LONGEST = 0.25
"""Longest step along a branch, relative to `Metric.range`."""

SNAPPED = 1e-4
"""Smallest change of pose that is reported as a snap, relative to `Metric.range`."""

PUSH = 0.003
"""First step from the end of a branch, along the tangent there, and first trust radius of the descent;
relative to `Metric.range`."""

ROUGH = 1e-7
"""Residual of points on the way, where nobody has asked for the equilibrium."""

CONTRACTION = 0.6
"""Newton steps along a branch get shorter by this at least."""

MARGIN = 0.02
"""How far before a corner to look for the last equilibrium first, relative to the way there."""

CORRECTIONS = 10
"""Newton steps before a step along the branch is taken back."""

SNAPS = 16
"""Room for snaps; a path is handed back when half of it is used, and may use the rest until it is."""


class Records(NamedTuple):
    """What was found at each load, and at each snap.

    snap_step     the load on the way to which it snapped
    snap_load     the load of the snap; `before` and `after` the poses there, and the energy set free [J]
    """

    q: Float[AnyArray, "loads dofs"]
    hessian: Float[AnyArray, "loads dofs dofs"]
    energy: Float[AnyArray, " loads"]
    residual: Float[AnyArray, " loads"]
    iterations: Int[AnyArray, " loads"]
    converged: Bool[AnyArray, " loads"]
    snapped: Bool[AnyArray, " loads"]
    tied: Bool[AnyArray, " loads"]
    load: Float[AnyArray, "loads channels"]
    snap_step: Int[AnyArray, " snaps"]
    snap_load: Float[AnyArray, "snaps channels"]
    before: Float[AnyArray, "snaps dofs"]
    after: Float[AnyArray, "snaps dofs"]
    released: Float[AnyArray, " snaps"]


class ContinuationState(NamedTuple):
    """Where one robot is.

    load, steps    index of the load it is on the way to (their number once done), evaluations spent on that
    snaps          how many are in `records`
    phase, tries   see TO_LOAD …, and evaluations spent on the present trial
    origin         loads at the start of the present segment [N]
    q, t           trial point: pose, and where on the segment
    s, growth      length along the branch that is aimed at (ALONG), and how much longer the next may be
    previous       of the Newton step before: the tangent there, and the length of its correction
    snap           the present descent is from the end of a branch, from energy `start` [J]
    nudge          how far past the end of the branch the next descent is to begin, in units of what counts
    snapped, tied  since the last load
    """

    load: Int[AnyArray, ""]
    steps: Int[AnyArray, ""]
    snaps: Int[AnyArray, ""]
    phase: Int[AnyArray, ""]
    tries: Int[AnyArray, ""]
    origin: Float[AnyArray, " channels"]
    anchor: Anchor
    beyond: Beyond
    descent: Descent
    q: Float[AnyArray, " dofs"]
    t: Float[AnyArray, ""]
    s: Float[AnyArray, ""]
    growth: Float[AnyArray, ""]
    previous: tuple[Float[AnyArray, " dofs"], Float[AnyArray, ""]]
    snap: Bool[AnyArray, ""]
    start: Float[AnyArray, ""]
    nudge: Float[AnyArray, ""]
    snapped: Bool[AnyArray, ""]
    tied: Bool[AnyArray, ""]
    records: Records


def begin(q: Float[AnyArray, " dofs"], origin: Float[AnyArray, " channels"], room: int) -> ContinuationState:
    """A robot at pose q and loads `origin` with room for so many loads; in NumPy, filled in from Python."""
    n, channels = len(q), len(origin)
    zeros: Any = np.zeros
    whole, flag, one = zeros((), int), zeros((), bool), zeros(())
    nothing = Evaluation(one, zeros(n), zeros((n, n)), zeros(channels), zeros((channels, n)))
    q = zeros(n) + q
    return ContinuationState(
        load=whole,
        steps=whole,
        snaps=whole,
        phase=whole + DESCEND,
        tries=whole,
        origin=zeros(channels) + origin,
        anchor=Anchor(q, one, zeros(n), one),
        beyond=Beyond(flag, zeros(n), one, zeros(n), one, whole),
        descent=Descent(q, nothing, one + np.inf, zeros(n), one, one, one, one + np.inf, one, ~flag, ~flag),
        q=q,
        t=one,
        s=one,
        growth=one + 2,
        previous=(zeros(n), one + np.inf),
        snap=flag,
        start=one,
        nudge=one + 1,
        snapped=flag,
        tied=flag,
        records=Records(
            q=zeros((room, n)),
            hessian=zeros((room, n, n)),
            energy=zeros(room),
            residual=zeros(room),
            iterations=zeros(room, int),
            converged=zeros(room, bool),
            snapped=zeros(room, bool),
            tied=zeros(room, bool),
            load=zeros((room, channels)),
            snap_step=zeros(SNAPS, int),
            snap_load=zeros((SNAPS, channels)),
            before=zeros((SNAPS, n)),
            after=zeros((SNAPS, n)),
            released=zeros(SNAPS),
        ),
    )


class Point(NamedTuple):
    """The point that the next step is taken from, and its linear algebra.

    newton       −(∇²Π)⁻¹ ∇Π
    response     dq/du of each channel
    stable       ∇²Π is positive definite; true without an energy
    converged    the residual is within tolerance
    """

    q: Float[Array, " dofs"]
    here: Evaluation
    residual: Float[Array, ""]
    newton: Float[Array, " dofs"]
    response: Float[Array, "dofs channels"]
    stable: Bool[Array, ""]
    converged: Bool[Array, ""]


def stepper(
    robot: Robot,
    loads: Float[AnyArray, "loads channels"],
    count: Int[AnyArray, ""],
    tolerance: Float[AnyArray, ""],
    max_iterations: Int[AnyArray, ""],
) -> Callable[[ContinuationState], ContinuationState]:
    """The function that takes a robot one evaluation further; only the first `count` loads are meant."""
    evaluate = potential(robot)
    metric = Metric.of(robot)

    def reach(motion: Motion, p: Array) -> Array:
        return jnp.min(
            jnp.stack(
                [jnp.array(jnp.inf), *(term.max_step_fraction(robot, motion, p) for term in robot.terms)]
            )
        )

    def step(state: ContinuationState) -> ContinuationState:
        target = loads[jnp.minimum(state.load, count - 1)]
        span = target - state.origin
        there, motion = evaluate(state.q, jnp.where(state.t >= 1, target, state.origin + state.t * span))
        residual = metric.force(there.gradient) / (metric.size(state.q) + metric.unit)

        descending = state.phase == DESCEND
        moved, accepted = descent.accept(state.descent, metric, state.q, there, residual, robot.conservative)
        q, here, residual = jax.tree.map(
            lambda a, b: jnp.where(descending, a, b),
            (moved.q, moved.here, moved.residual),
            (state.q, there, residual),
        )
        point = _point(robot, metric, q, here, residual, tolerance)
        verdict = _judge(state, metric, point, span, robot.conservative, max_iterations)
        p, shift = descent.direction(
            moved,
            metric,
            point.newton,
            point.stable,
            point.converged & ~point.stable,
            descending & accepted & ~verdict.arrived,
        )
        if not robot.conservative:
            p = point.newton * jnp.minimum(1.0, moved.radius / jnp.maximum(metric.size(point.newton), 1e-300))
        state, tangent = _settle(state, metric, point, moved, verdict, target, span, loads, count)
        correction = jnp.where(state.phase == ALONG, verdict.bordered.q, point.newton)
        way = jnp.where(verdict.arrived, tangent, jnp.where(descending, p, correction))
        far = reach(motion, way)
        by_t = span @ here.load_gradient
        return _next(
            state, metric, point, verdict, by_t, far, p, shift, accepted, correction, robot.conservative
        )

    return step


def _point(
    robot: Robot, metric: Metric, q: Array, here: Evaluation, residual: Array, tolerance: Array
) -> Point:
    right = jnp.concatenate([here.gradient[:, None], here.load_gradient.T], axis=1)
    if robot.conservative:
        factor = jnp.linalg.cholesky(here.hessian)
        stable = jnp.all(jnp.isfinite(factor))
        solved = -cho_solve((jnp.where(stable, factor, metric.factor), True), right)
    else:  # no energy whose minimum it could be: any solution of the equations will do
        stable = jnp.array(True)
        solved = -jnp.linalg.solve(here.hessian, right)
    newton = solved[:, 0]
    small = metric.size(newton) <= 10 * tolerance * (metric.size(q) + metric.unit)
    converged = (residual < tolerance) & (small | ~stable)
    return Point(q, here, residual, newton, solved[:, 1:], stable, converged)


class Verdict(NamedTuple):
    """What the point is.

    arrived   a stable equilibrium to go on from; `at_load`: at the load that was aimed at; `lost`: given up
    failed    the trial (TO_LOAD, ALONG) is to be taken back
    passed    ALONG: the load aimed at lies before this point
    unstable  ALONG: the branch has turned back, so the point is unstable
    corner    how far from the anchor (in t, or in s if ALONG) the two pieces of the branch meet between
              which Newton's method goes back and forth; otherwise infinite
    tangent   dq/dt, or dq/ds if ALONG
    """

    arrived: Bool[Array, ""]
    at_load: Bool[Array, ""]
    lost: Bool[Array, ""]
    failed: Bool[Array, ""]
    passed: Bool[Array, ""]
    unstable: Bool[Array, ""]
    corner: Float[Array, ""]
    tangent: Float[Array, " dofs"]
    bordered: branch.Bordered


def _judge(
    state: ContinuationState,
    metric: Metric,
    point: Point,
    span: Array,
    conservative: bool,
    max_iterations: Array,
) -> Verdict:
    anchor = state.anchor
    to_load, along = state.phase == TO_LOAD, state.phase == ALONG
    longest = LONGEST * metric.range(anchor.q)
    # Newton's method at this load …
    tangent = point.response @ span
    change = point.q - anchor.q
    dt = state.t - anchor.t
    like = ~branch.unlike(metric, change, anchor.tangent * dt, tangent * dt, point.q)
    rough = to_load & (state.t < 1) & (point.residual < ROUGH)
    settled = (point.converged | rough) & point.stable
    off = ~jnp.isfinite(point.residual)
    # … and along the branch.
    solved = branch.bordered(
        metric,
        anchor,
        point.q,
        point.here.gradient,
        point.here.hessian,
        span @ point.here.load_gradient,
        state.s,
    )
    on_branch = point.residual < ROUGH
    unit = anchor.tangent / jnp.maximum(metric.size(anchor.tangent), 1e-300)
    alike = ~branch.unlike(metric, change, unit * state.s, solved.dq * state.s, point.q)
    # Where no equilibrium is near, Newton's method goes back and forth between the pieces of two sets of
    # contacts; they meet where a branch ends in a corner.
    correction = jnp.where(along, solved.q, point.newton)
    bend = state.previous[0] - jnp.where(along, solved.dq, tangent)
    weighed = metric.matrix @ bend
    back = (weighed @ correction) / jnp.maximum(weighed @ bend, 1e-300)
    length = metric.size(correction)
    circling = (state.tries > 0) & (length > CONTRACTION * state.previous[1])
    place = jnp.where(along, state.s, dt) + back
    corner = jnp.where(circling & (place > 0) & (back < 0), place, jnp.inf)
    stray = ~point.stable | ~(length <= longest) | circling | (state.tries + 1 >= CORRECTIONS) | off
    drift = ~(length <= longest) | circling | (state.tries + 1 >= CORRECTIONS) | off
    rising = point.stable & (solved.dt > 0)
    good = along & on_branch & alike
    passed = good & rising & (state.t >= 1)
    turned = good & (solved.dt < 0)
    arrived = jnp.where(to_load, settled & like, jnp.where(along, good & rising & (state.t < 1), settled))
    failed = jnp.where(
        to_load,
        (settled & ~like) | (~settled & stray),
        along & jnp.where(on_branch, ~(alike & (rising | (solved.dt < 0))), drift),
    )
    at_load = arrived & (state.t >= 1)
    lost = ~at_load & (state.steps + 1 >= max_iterations)
    if not conservative:
        lost = lost | (to_load & failed & (dt < 1e-5))
    return Verdict(
        arrived, at_load, lost, failed, passed, turned, corner, jnp.where(along, solved.dq, tangent), solved
    )


def _settle(
    state: ContinuationState,
    metric: Metric,
    point: Point,
    moved: Descent,
    verdict: Verdict,
    target: Array,
    span: Array,
    loads: Array,
    count: Array,
) -> tuple[ContinuationState, Array]:
    """The state with what has been found recorded, and dq/dt from here on."""
    arrived, at_load, lost = verdict.arrived, verdict.at_load, verdict.lost
    descending = state.phase == DESCEND
    started = descending & state.descent.fresh
    start = jnp.where(started, point.here.energy, state.start)
    tied = state.tied | (descending & point.converged & ~point.stable)
    far = metric.size(point.q - state.anchor.q) > SNAPPED * metric.range(point.q)
    jumped = arrived & descending & state.snap & far
    snapped = state.snapped | jumped
    steps = state.steps + 1
    done = (at_load | lost) & (state.load < count)
    load = jnp.minimum(state.load, count - 1)
    q = jnp.where(at_load, point.q, state.anchor.q)
    reached = jnp.where(at_load, target, state.origin + state.anchor.t * span)
    records = state.records

    def put(into: AnyArray, value: AnyArray) -> Array:
        return jnp.asarray(into).at[load].set(jnp.where(done, value, into[load]))

    at = jnp.minimum(state.snaps, SNAPS - 1)

    def put_snap(into: AnyArray, value: AnyArray) -> Array:
        return jnp.asarray(into).at[at].set(jnp.where(jumped, value, into[at]))

    records = Records(
        q=put(records.q, q),
        hessian=put(records.hessian, point.here.hessian),
        energy=put(records.energy, point.here.energy),
        residual=put(records.residual, point.residual),
        iterations=put(records.iterations, steps),
        converged=put(records.converged, at_load),
        snapped=put(records.snapped, snapped),
        tied=put(records.tied, tied),
        load=put(records.load, reached),
        snap_step=put_snap(records.snap_step, state.load),
        snap_load=put_snap(records.snap_load, state.origin + state.t * span),
        before=put_snap(records.before, state.anchor.q),
        after=put_snap(records.after, point.q),
        released=put_snap(records.released, start - point.here.energy),
    )
    following = loads[jnp.minimum(state.load + 1, count - 1)]
    tangent = point.response @ jnp.where(at_load, following - target, span)
    t = jnp.where(at_load, 0.0, state.t)
    anchor = Anchor(
        q=jnp.where(arrived, point.q, state.anchor.q),
        t=jnp.where(at_load | lost, 0.0, jnp.where(arrived, t, state.anchor.t)),
        tangent=jnp.where(arrived, tangent, state.anchor.tangent),
        reach=state.anchor.reach,
    )
    small = arrived & descending & state.snap & ~far
    nudge = jnp.where(small, 8 * state.nudge, jnp.where(arrived, 1.0, state.nudge))
    return state._replace(
        load=jnp.minimum(state.load + done, count),
        steps=jnp.where(done, 0, steps),
        snaps=state.snaps + jumped,
        tries=state.tries + 1,
        origin=jnp.where(done, reached, state.origin),
        anchor=anchor,
        descent=moved,
        start=start,
        nudge=nudge,
        snapped=snapped & ~done,
        tied=tied & ~done,
        records=records,
    ), tangent


def _next(
    state: ContinuationState,
    metric: Metric,
    point: Point,
    verdict: Verdict,
    by_t: Array,
    far: Array,
    p: Array,
    shift: Array,
    accepted: Array,
    correction: Array,
    conservative: bool,
) -> ContinuationState:
    """The state with the next trial point.

    far   how much of the direction taken from here (the tangent, if arrived) there is before a gap closes
    p     the step of the descent, and `shift` of it; `accepted`: it is to be taken
    """
    arrived, failed, unstable = verdict.arrived, verdict.failed, verdict.unstable
    to_load, along, descending = (state.phase == phase for phase in (TO_LOAD, ALONG, DESCEND))
    anchor = state.anchor._replace(reach=jnp.where(arrived, jnp.minimum(far, 1e30), state.anchor.reach))
    speed = jnp.maximum(metric.size(anchor.tangent), 1e-300)
    longest = LONGEST * metric.range(anchor.q)
    scale = metric.size(anchor.q) + metric.unit
    narrow = NEGLIGIBLE * scale / jnp.maximum(metric.force(by_t), 1e-300)

    # An unstable point stays the far end of the bracket while its near end moves up.
    end = state.beyond
    known = unstable | (end.known & along & ~verdict.passed & ~verdict.lost)
    end = Beyond(
        known,
        jnp.where(unstable, point.q, end.q),
        jnp.where(unstable, state.t, end.t),
        jnp.where(unstable, verdict.bordered.dq, end.dq),
        jnp.where(unstable, verdict.bordered.dt, end.dt),
        jnp.where(along & known, end.tries + (arrived | unstable), 0),
    )
    look = branch.bracket(metric, anchor, end, narrow)
    lone = unstable & ~look.sound  # an unstable point that the branch does not lead to
    known = known & look.sound
    narrowed = known & (unstable | (arrived & along))
    failed = failed | lone
    shorter = jnp.where(to_load, 0.5 * speed * (state.t - anchor.t), 0.25 * state.s)
    corner = verdict.corner * jnp.where(to_load, speed, 1.0)
    at_corner = failed & jnp.isfinite(corner)
    shorter = jnp.where(at_corner, (1 - MARGIN) * corner, shorter)
    s = jnp.where(failed, shorter, jnp.where(narrowed, look.s, state.growth * state.s))
    s = jnp.minimum(s, longest)
    slower = jnp.where(at_corner, 2 * MARGIN, 1.0)
    cornered = at_corner & (corner <= narrow * speed)

    ended = (narrowed & look.found) | (failed & (s < NEGLIGIBLE * scale)) | cornered | verdict.lost
    easy = arrived & along & ~known & (speed * (1 - anchor.t) < 2 * state.s)
    beyond_load = narrowed & (look.t >= 1)
    to_go = verdict.passed | (arrived & ~along) | easy | beyond_load
    start_descent = ended & ~verdict.passed
    start_to_load = to_go & ~start_descent
    start_along = (failed | narrowed | (arrived & along)) & ~start_descent & ~start_to_load
    goal = jnp.where(verdict.passed, 1.0, anchor.t + longest / speed)
    if not conservative:  # no flow to follow either
        start_descent, start_to_load, start_along = verdict.lost, arrived | failed, jnp.array(False)
        start_to_load = start_to_load & ~verdict.lost
        goal = jnp.where(failed, 0.5 * (anchor.t + state.t), goal)
    goal = jnp.where(goal > 1 - 1e-9, 1.0, goal)

    # Where each of these begins …
    onwards = jnp.minimum(goal - anchor.t, anchor.reach)
    length = jnp.minimum(s, anchor.reach * speed)
    from_end = narrowed & ~failed
    along_q = jnp.where(from_end, look.q, anchor.q + anchor.tangent * (length / speed))
    along_t = jnp.where(from_end, look.t, anchor.t + length / speed)
    past = jnp.maximum(jnp.where(narrowed, look.end, anchor.t), anchor.t + narrow) + narrow * (
        state.nudge - 1
    )
    past = past + jnp.where(cornered, corner / speed, 0.0)
    descent_t = jnp.where(verdict.lost, 0.0, jnp.minimum(1.0, past))
    push = jnp.where(verdict.lost, 0.0, PUSH * metric.range(anchor.q))
    ahead = anchor.tangent * (jnp.minimum(push, anchor.reach * speed) / speed)
    # … or how what was begun goes on.
    walk = state.descent
    whole = jnp.minimum(1.0, far)
    step = jnp.where(accepted, p, walk.step)
    fraction = jnp.where(accepted, whole, 0.25 * walk.fraction)
    go_q = jnp.where(descending, walk.q + fraction * step, point.q + whole * correction)
    go_t = jnp.where(along, state.t + whole * verdict.bordered.t, state.t)

    def choose(load: Any, length: Any, flow: Any, go: Any) -> Array:
        return jnp.where(
            start_to_load, load, jnp.where(start_along, length, jnp.where(start_descent, flow, go))
        )

    walk = walk._replace(
        convex=point.stable,
        step=step,
        fraction=fraction,
        slope=walk.here.gradient @ step,
        curvature=step @ walk.here.hessian @ step,
        shift=jnp.where(accepted, shift, walk.shift),
        fresh=start_descent,
        radius=jnp.where(start_descent, jnp.where(verdict.lost, jnp.inf, push), walk.radius),
    )
    restarted = start_to_load | start_along | start_descent
    return state._replace(
        phase=choose(TO_LOAD, ALONG, DESCEND, state.phase),
        tries=jnp.where(restarted, 0, state.tries),
        anchor=anchor,
        beyond=end._replace(known=known & ~start_to_load & ~start_descent & ~(failed & to_load)),
        descent=walk,
        q=choose(anchor.q + anchor.tangent * onwards, along_q, anchor.q + ahead, go_q),
        t=choose(goal, along_t, descent_t, go_t),
        s=jnp.where(start_along, s, state.s),
        growth=jnp.where(
            failed, jnp.where(at_corner, 2 * MARGIN, 1.0), jnp.where(arrived, 2.0, state.growth)
        ),
        previous=jax.tree.map(
            lambda gone, now: jnp.where(restarted | (whole < 1), gone, now),
            (state.previous[0], jnp.inf),
            (verdict.tangent, metric.size(correction)),
        ),
        snap=jnp.where(start_descent, ~verdict.lost, state.snap),
    )
