"""Along one branch of equilibria: to a given load, or by a given length around a fold.

A branch is q(t) on a straight segment of loads, t from 0 to 1. Newton's method finds the point at a given t.
Near a fold, where dq/dt grows without bound, the length s along the tangent of the last equilibrium takes the
place of t (pseudo-arclength continuation), so the branch is followed around the fold. There, or at a corner
where a contact opens or closes, ∇²Π stops being positive definite: the end of the stable branch.
Source: Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems, 1977.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from exosight.arrays import AnyArray
from exosight.mechanics.metric import Metric
from exosight.mechanics.term import Memories

UNLIKE = 0.05
"""How far a smooth change may lie from what the tangents at both ends lead to, relative to the larger of
these two …"""

UNLIKE_WITH_MEMORY = 0.3
"""… of robots with friction, whose points begin to slip and stick one after the other on the way. With 1,
work and losses of exosuits do not agree to 1e-6 in steps of 2.5 mN; with 0.05, most ends of branches that are
found are none."""

UNLIKE_AT_ALL = 5e-5
"""The same, relative to the pose itself."""

SMOOTH = 0.3
"""How far a curve may lie from the mean of the tangents at its ends, relative to half of their difference."""

NEGLIGIBLE = 1e-7
"""A force that counts as none, as a share of the pose: to this the load of a fold is located."""


class Anchor(NamedTuple):
    """The last stable equilibrium.

    q, t          (dofs,), ()   it, and where on the segment of loads
    tangent       (dofs,)       dq/dt
    bend, twist   (dofs,)       d²q/dt² and d³q/dt³, as far as they are known
    reach         ()            how far in t the first open pair is from closing, along the tangent
    memories                    what the terms of the robot remember there
    energy        ()            Π at zero load [J]
    by_load       (channels,)   Λ = ∂Π/∂u [m, for a force]
    by_load_rate  (channels,)   dΛ/dt, at the end of the step to here or, where the load turns, as `tangent`
    """

    q: Float[AnyArray, " dofs"]
    t: Float[AnyArray, ""]
    tangent: Float[AnyArray, " dofs"]
    bend: Float[AnyArray, " dofs"]
    twist: Float[AnyArray, " dofs"]
    reach: Float[AnyArray, ""]
    memories: Memories
    energy: Float[AnyArray, ""]
    by_load: Float[AnyArray, " channels"]
    by_load_rate: Float[AnyArray, " channels"]

    def ahead(
        self, metric: Metric, dt: Float[AnyArray, ""]
    ) -> tuple[Float[AnyArray, " dofs"], Float[AnyArray, " dofs"]]:
        """The pose to be expected at t + dt, and dq/dt there.

        They lie on the tangent where the cubic is further from it than half of the way.
        """
        bent = dt**2 * (self.bend / 2 + dt * self.twist / 6)
        believed = metric.size(bent) <= 0.5 * jnp.abs(dt) * metric.size(self.tangent)
        turned = dt * (self.bend + dt * self.twist / 2)
        ahead = self.q + dt * self.tangent + jnp.where(believed, bent, 0.0)
        return ahead, self.tangent + jnp.where(believed, turned, 0.0)


class Beyond(NamedTuple):
    """An unstable equilibrium further along the branch, if `known`, with its tangent (dq, dt)."""

    known: Bool[AnyArray, ""]
    q: Float[AnyArray, " dofs"]
    t: Float[AnyArray, ""]
    dq: Float[AnyArray, " dofs"]
    dt: Float[AnyArray, ""]
    tries: Float[AnyArray, ""]


def unlike(
    metric: Metric,
    moved: Float[AnyArray, " dofs"],
    leaving: Float[AnyArray, " dofs"],
    arriving: Float[AnyArray, " dofs"],
    pose: Float[AnyArray, " dofs"],
    relative: float,
) -> Bool[AnyArray, ""]:
    """Whether a change of pose is not what the tangents at its two ends lead to.

    A smooth one lies near the segment between them, also where contacts open or close on the way and the
    tangent jumps.

    relative   UNLIKE
    """
    span = arriving - leaving
    weighed = metric.times(span)
    along = jnp.clip((moved - leaving) @ weighed / jnp.maximum(span @ weighed, 1e-300), 0, 1)
    largest = jnp.maximum(metric.size(leaving), metric.size(arriving))
    off = metric.size(moved - leaving - along * span)
    return ~(off <= relative * largest + UNLIKE_AT_ALL * metric.size(pose))


def curvature(
    metric: Metric,
    anchor: Anchor,
    q: Float[AnyArray, " dofs"],
    t: Float[AnyArray, ""],
    tangent: Float[AnyArray, " dofs"],
) -> tuple[Float[Array, " dofs"], Float[Array, " dofs"]]:
    """d²q/dt² and d³q/dt³ at the end of the cubic from the anchor to the point (t, q) with that tangent.

    Zero where no smooth curve joins the two. On one, the change of pose is h times the mean of both
    tangents but for what is small beside h/2 times their difference.
    """
    h = t - anchor.t
    change = tangent - anchor.tangent
    off = q - anchor.q - 0.5 * h * (anchor.tangent + tangent)
    smooth = (h > 0) & (metric.size(off) < 0.5 * SMOOTH * h * metric.size(change))
    h = jnp.where(h > 0, h, 1.0)
    return jnp.where(smooth, change / h - 6 * off / h**2, 0.0), jnp.where(smooth, -12 * off / h**3, 0.0)


def integral(
    h: Float[AnyArray, ""],
    values: tuple[Float[AnyArray, ""], Float[AnyArray, ""]],
    rates: tuple[Float[AnyArray, ""], Float[AnyArray, ""]],
) -> Float[Array, ""]:
    """∫ f dt over a step h from f and df/dt at both ends, on the two straight pieces that these give.

    Where a contact opens, closes or begins to slip within the step, f has a kink; of the trapezoidal rule
    that is an error of second order in h. A smooth f leaves half of that rule's error, of third order.
    """
    bend = h * (rates[0] - rates[1])
    kink = (values[1] - values[0] - h * rates[1]) / jnp.where(bend != 0, bend, 1.0)
    kink = jnp.clip(kink, 0.0, 1.0)
    return jnp.asarray(0.5 * h * (values[0] + values[1] + kink * (1 - kink) * bend))


class Bordered(NamedTuple):
    """Solution of the equations with s given: Newton's correction, and the tangent with ds = 1."""

    q: Float[AnyArray, " dofs"]
    t: Float[AnyArray, ""]
    dq: Float[AnyArray, " dofs"]
    dt: Float[AnyArray, ""]


def across(metric: Metric, anchor: Anchor) -> Float[AnyArray, " dofs"]:
    """c = M v/|v|, v the anchor's tangent: cᵀ(q − q_anchor) is the length s along it."""
    return metric.times(anchor.tangent / jnp.maximum(metric.size(anchor.tangent), 1e-300))


def bordered(
    c: Float[AnyArray, " dofs"],
    newton: Float[AnyArray, " dofs"],
    by_t: Float[AnyArray, " dofs"],
    by_c: Float[AnyArray, " dofs"],
    missing: Float[AnyArray, ""],
) -> Bordered:
    """∇Π = 0 and cᵀ(q − q_anchor) = s, linearised.

    With A = ∂∇Π/∂q + σ c cᵀ, regular at a fold too, in the place of ∂∇Π/∂q, as cᵀq is known:

    newton, by_t   −A⁻¹ ∇Π, −A⁻¹ ∂∇Π/∂t
    by_c           A⁻¹ σ c
    missing        s − cᵀ(q − q_anchor)
    """
    steepness = c @ by_t
    newton = newton + by_c * missing
    t, dt = (missing - c @ newton) / steepness, (1 - c @ by_c) / steepness
    return Bordered(newton + by_t * t, t, by_c + by_t * dt, dt)


class Bracket(NamedTuple):
    """The end of the stable branch, between an anchor and an unstable point beyond.

    s        where along the anchor's tangent to look next
    q, t     the pose expected there
    end      t at the end of the branch, or slightly more
    found    it is found as precisely as wanted
    sound    the two points do belong to one branch; otherwise nothing else means anything
    """

    s: Float[AnyArray, ""]
    q: Float[AnyArray, " dofs"]
    t: Float[AnyArray, ""]
    end: Float[AnyArray, ""]
    found: Bool[AnyArray, ""]
    sound: Bool[AnyArray, ""]


def bracket(metric: Metric, anchor: Anchor, beyond: Beyond, narrow: Float[AnyArray, ""]) -> Bracket:
    """Where the branch ends: at the largest t of a smooth fold, or at the corner where two pieces meet.

    narrow   how precisely in t
    """
    speed = jnp.maximum(metric.size(anchor.tangent), 1e-300)
    dq_a, dt_a = anchor.tangent / speed, 1 / speed
    c = across(metric, anchor)
    between = beyond.q - anchor.q
    s_b = c @ between
    forward = c @ beyond.dq
    forward = jnp.where(jnp.abs(forward) > 1e-9 * metric.size(beyond.dq), forward, 1.0)
    dq_b, dt_b = beyond.dq / forward, beyond.dt / forward
    fold = (dt_b < 0) & (s_b > 0)
    # At a fold the tangents meet at a larger t than that of the branch; its largest t is where dt/ds is zero.
    steeper = jnp.where(fold, dt_a - dt_b, 1.0)
    meeting = jnp.clip((beyond.t - dt_b * s_b - anchor.t) / steeper, 0.0, jnp.maximum(s_b, 0.0))
    smooth = s_b * dt_a / steeper
    # Elsewhere a contact opens or closes, and two pieces meet at an angle (the second may lead back) …
    apart = dq_a - dq_b
    weighed = metric.times(apart)
    angle = weighed @ apart
    corner = weighed @ (between - dq_b * s_b) / jnp.maximum(angle, 1e-300)
    # … or the branch goes straight on, unstable in a direction of its own.
    straight = angle < 1e-3
    place = jnp.where(fold, meeting, jnp.where(straight, s_b, corner))
    sound = (place > 0) & (place <= 4 * metric.size(between)) & ~(straight & ~fold & (s_b <= 0))
    end = anchor.t + dt_a * place
    even = beyond.tries % 2 == 0
    s = jnp.where(
        fold,
        jnp.clip(jnp.where(even, smooth, 0.995 * meeting), 0.005 * s_b, 0.99 * s_b),
        jnp.where(straight, 0.5 * s_b, 0.98 * corner),
    )
    far = fold & (s > 0.5 * s_b)
    q = jnp.where(far, beyond.q + dq_b * (s - s_b), anchor.q + dq_a * s)
    t = jnp.where(far, beyond.t + dt_b * (s - s_b), anchor.t + dt_a * s)
    found = sound & ((end - anchor.t <= narrow) | (beyond.tries >= 40))
    return Bracket(s, q, t, end, found, sound)
