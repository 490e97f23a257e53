"""What a trial point of the quasi-static path is: a state to go on from, the end of a branch, or nothing."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics import branch
from exosight.mechanics.continuation_state import ALONG, TO_LOAD, ContinuationState
from exosight.mechanics.energy import Evaluation
from exosight.mechanics.evaluator import solve_any, solve_definite, solve_signed
from exosight.mechanics.metric import Metric

LONGEST = 0.06
"""Longest step along a branch, relative to `Metric.range`."""

ROUGH = 1e-4
"""Residual of points on the way, where nobody has asked for the equilibrium …"""

ROUGH_LANDING = 1e-5
"""… where a descent ends there …"""

ROUGH_WITH_MEMORY = 3e-6
"""… and of robots with friction, which remember these points themselves."""

LAST = 3e-5
"""Longest Newton step that is taken from a point on the way without another look, relative to the pose. With
1e-4 the pose before an end of the way at 134 N was one from which nothing led back."""

CONTRACTION = 0.6
"""Newton steps along a branch get shorter by this at least."""

CORRECTIONS = 10
"""Newton steps before a step along the branch is taken back."""


STIFFENING = 1e3
"""σ: what ∇²Π is made stiffer by along the branch, relative to the metric: more than it falls below zero."""


class Problem(NamedTuple):
    """What stays the same on the whole path.

    working        (channels,)   1, or 0 for what is no load but the time
    conservative                 Π exists
    """

    metric: Metric
    working: Float[AnyArray, " channels"]
    conservative: bool
    tolerance: Float[AnyArray, ""]
    max_iterations: Int[AnyArray, ""]


class Segment(NamedTuple):
    """The present segment of loads, to one of `total`.

    origin, target, span   where it begins and ends, and target − origin [N]
    following              the span of the next one [N]
    ratio                  following / span, 0 unless both have the same direction
    """

    origin: Float[AnyArray, " channels"]
    target: Float[AnyArray, " channels"]
    span: Float[AnyArray, " channels"]
    following: Float[AnyArray, " channels"]
    ratio: Float[AnyArray, ""]
    total: Int[AnyArray, ""]

    @staticmethod
    def of(
        origin: Float[AnyArray, " channels"],
        target: Float[AnyArray, " channels"],
        after: Float[AnyArray, " channels"],
        total: Int[AnyArray, ""],
    ) -> "Segment":
        """From the present load to the next one; `after`: the one after that."""
        span, following = target - origin, after - target
        ratio = (span @ following) / jnp.maximum(span @ span, 1e-300)
        off = following - ratio * span
        straight = off @ off <= 1e-18 * (following @ following)
        ratio = jnp.where(straight, jnp.maximum(ratio, 0.0), 0.0)
        return Segment(origin, target, span, following, ratio, total)

    def load(self, t: AnyArray) -> Float[AnyArray, " channels"]:
        """The load at t, to the last digit at its end."""
        return jnp.where(t >= 1, self.target, self.origin + t * self.span)


class Point(NamedTuple):
    """The point that the next step is taken from, and its linear algebra.

    newton       −(∂∇Π/∂q)⁻¹ ∇Π
    response     dq/du of each channel
    bordered     of the equations with the length along the branch given, if ALONG
    stable       ∇²Π is positive definite, or with friction det ∂∇Π/∂q > 0; true without an energy
    solved       whether `bordered` means anything
    converged    the residual is within tolerance
    """

    q: Float[AnyArray, " dofs"]
    here: Evaluation
    residual: Float[AnyArray, ""]
    newton: Float[AnyArray, " dofs"]
    response: Float[AnyArray, "dofs channels"]
    bordered: branch.Bordered
    stable: Bool[AnyArray, ""]
    solved: Bool[AnyArray, ""]
    converged: Bool[AnyArray, ""]


def linearise(
    state: ContinuationState,
    problem: Problem,
    segment: Segment,
    q: Float[AnyArray, " dofs"],
    here: Evaluation,
    residual: Float[AnyArray, ""],
) -> Point:
    """Newton's steps and responses at q, from one factorisation.

    Along a branch it is that of A = J + σ c cᵀ (`branch.bordered`), from which follow, by the formulas of
    Sherman and Morrison, J⁻¹ and the sign of det J = det A (1 − σ cᵀA⁻¹c).
    """
    metric, tolerance, along = problem.metric, problem.tolerance, state.phase == ALONG
    c = branch.across(metric, state.anchor)
    weight = jnp.where(along, STIFFENING, 0.0)
    right = jnp.concatenate([-here.gradient[:, None], -here.load_gradient.T, weight * c[:, None]], axis=1)
    solved, sign = _factorised(problem, here, here.jacobian + weight * c[:, None] * c, right)
    by_c, left = solved[:, -1], 1 - c @ solved[:, -1]
    stable = sign * left > 0
    bordered = branch.bordered(
        c,
        solved[:, 0],
        solved[:, 1:-1] @ segment.span,
        by_c,
        state.s - c @ (q - state.anchor.q),
    )
    free = solved[:, :-1] + by_c[:, None] * (c @ solved[:, :-1]) / left
    free = jnp.where(stable, free, 0.0)
    newton = free[:, 0]
    step = metric.size(newton) / (metric.size(q) + metric.unit)
    # A stiff system's residual may end above the tolerance by round-off alone, but not its Newton step.
    converged = (residual < tolerance) & ((step <= 10 * tolerance) | ~stable)
    converged = converged | (stable & (step <= 1e-3 * tolerance))
    return Point(q, here, residual, newton, free[:, 1:], bordered, stable, along & (sign != 0), converged)


def _factorised(
    problem: Problem, here: Evaluation, matrix: Float[AnyArray, "dofs dofs"], right: AnyArray
) -> tuple[Float[AnyArray, "dofs right"], AnyArray]:
    """matrix⁻¹ right, and the sign of its determinant; 0 where it has no solution that is of use."""
    if not problem.conservative:  # no energy whose minimum it could be: any solution of the equations will do
        return solve_any(matrix, right), jnp.array(1.0)
    if here.coupling is None:
        solved, definite = solve_definite(matrix, right)
        return solved, jnp.where(definite, 1.0, 0.0)
    # The flow turns away where a real eigenvalue becomes negative.
    return solve_signed(matrix, right)


class Verdict(NamedTuple):
    """What the point is.

    arrived   a stable equilibrium to go on from; `at_load`: at the load that was aimed at; `lost`: given up
    failed    the trial (TO_LOAD, ALONG) is to be taken back
    passed    ALONG: the load aimed at lies before this point
    unstable  ALONG: the branch has turned back, so the point is unstable
    corner    how far from the anchor (in t, or in s if ALONG) the two pieces of the branch meet between
              which Newton's method goes back and forth; otherwise infinite
    tangent   dq/dt, or dq/ds if ALONG
    q, t      where the equilibrium is: the point, or on the way what Newton's last step leads to
    """

    arrived: Bool[AnyArray, ""]
    at_load: Bool[AnyArray, ""]
    lost: Bool[AnyArray, ""]
    failed: Bool[AnyArray, ""]
    passed: Bool[AnyArray, ""]
    unstable: Bool[AnyArray, ""]
    corner: Float[AnyArray, ""]
    tangent: Float[AnyArray, " dofs"]
    q: Float[AnyArray, " dofs"]
    t: Float[AnyArray, ""]


def judge(state: ContinuationState, problem: Problem, segment: Segment, point: Point) -> Verdict:
    """What the trial point of each phase has turned out to be."""
    metric, anchor = problem.metric, state.anchor
    to_load, along = state.phase == TO_LOAD, state.phase == ALONG
    # Newton's method at this load …
    dt = state.t - anchor.t
    change = point.q - anchor.q
    by_load = point.response @ segment.span
    most = branch.UNLIKE_WITH_MEMORY if state.memories else branch.UNLIKE
    like = ~branch.unlike(metric, change, anchor.tangent * dt, by_load * dt, point.q, most)
    solved = point.bordered
    correction = jnp.where(along, solved.q, point.newton)
    if state.memories:
        near = (point.residual < ROUGH_WITH_MEMORY) & (to_load | along)
    else:
        near = point.residual < jnp.where(to_load | along, ROUGH, ROUGH_LANDING)
        near = near & (metric.size(correction) <= LAST * (metric.size(point.q) + metric.unit))
    settled = (point.converged | (near & (state.t < 1))) & point.stable
    # … and along the branch.
    unit = anchor.tangent / jnp.maximum(metric.size(anchor.tangent), 1e-300)
    alike = ~branch.unlike(metric, change, unit * state.s, solved.dq * state.s, point.q, most)
    tangent = jnp.where(along, solved.dq, by_load)
    circling, corner = _two_cycle(state, metric, correction, tangent, jnp.where(along, state.s, dt))

    hopeless = (
        ~(metric.size(correction) <= LONGEST * metric.range(anchor.q))
        | circling
        | (state.tries + 1 >= CORRECTIONS)
        | ~jnp.isfinite(point.residual)
        | (along & ~point.solved)
    )
    on_branch = near & point.solved
    rising, turned = point.stable & (solved.dt > 0), solved.dt < 0
    good = along & on_branch & alike
    onwards = jnp.where(along, good & rising & (state.t < 1), settled)
    arrived = jnp.where(to_load, settled & like, onwards)
    failed = jnp.where(
        to_load,
        jnp.where(settled, ~like, ~point.stable | hopeless),
        along & jnp.where(on_branch, ~(alike & (rising | turned)), hopeless),
    )
    ahead = _opening(state, metric, segment, point, dt)
    ahead = jnp.where(along, ahead * metric.size(anchor.tangent), ahead)
    corner = jnp.where(failed & ~circling & ~point.stable, ahead, corner)
    at_load = arrived & (state.t >= 1)
    lost = ~at_load & (state.steps + 1 >= problem.max_iterations)
    if not problem.conservative:
        lost = lost | (to_load & failed & (dt < 1e-5))
    passed = good & rising & (state.t >= 1)
    last = jnp.where(at_load, 0.0, 0.0 if state.memories else 1.0)
    t = state.t + last * jnp.where(along, solved.t, 0.0)
    return Verdict(
        arrived, at_load, lost, failed, passed, good & turned, corner, tangent, point.q + last * correction, t
    )


def _opening(
    state: ContinuationState, metric: Metric, segment: Segment, point: Point, dt: Float[AnyArray, ""]
) -> Float[AnyArray, ""]:
    """How far in t the expected way leads to where a contact opens, beyond which nothing holds the pose.

    On the way there ∇Π stays zero along the tangent v; beyond, it changes by ∇²Π v + ∂∇Π/∂t, both as at the
    first trial point. With friction, where points slip is no opening, and nothing is said.
    """
    if state.memories:
        return jnp.array(jnp.inf)
    _, v = state.anchor.ahead(metric, dt)
    change = v @ (point.here.jacobian @ v + segment.span @ point.here.load_gradient)
    back = (v @ point.here.gradient) / jnp.where(jnp.abs(change) > 0, change, 1.0)
    first = (state.tries == 0) & ~state.beyond.known
    return jnp.where(first & (back > 0) & (back < dt), dt - back, jnp.inf)


def _two_cycle(
    state: ContinuationState,
    metric: Metric,
    correction: Float[AnyArray, " dofs"],
    tangent: Float[AnyArray, " dofs"],
    place: Float[AnyArray, ""],
) -> tuple[Bool[AnyArray, ""], Float[AnyArray, ""]]:
    """Whether Newton's method goes back and forth, and where the two pieces meet it goes between.

    It does where no equilibrium is near: each piece, of one set of contacts, has its own beyond the corner
    in which they meet. `place` is where in t or s it goes on.
    """
    before, length = state.previous
    bend = before - tangent
    weighed = metric.times(bend)
    back = (weighed @ correction) / jnp.maximum(weighed @ bend, 1e-300)
    circling = (state.tries > 0) & (metric.size(correction) > CONTRACTION * length)
    corner = circling & (place + back > 0) & (back < 0)
    return circling, jnp.where(corner, place + back, jnp.inf)
