"""The closest spheres of two tapered solids with round ends.

Such a solid is what a sphere sweeps whose centre and radius change linearly along its axis. Two of them are
closest where

    f(s, t) = |p_a(s) − p_b(t)| − r_a(s) − r_b(t),      s, t from 0 to 1,

is least. It is convex, and its minimum has a closed form: inside, the unit vector n between the centres
follows from n · p_a' = r_a' and n · p_b' = −r_b', and on each side of the square one solid is a sphere.

Where the axes are parallel, and both sides straight, many pairs are equally close, and the closest one jumps
as the solids rock on each other. `smooth_pair` therefore adds ½ ε ((s − ½)² + (t − ½)²) to f, which makes the
pair unique and lets it move smoothly; distances become larger by at most ε / 4, with ε = SPREAD of the mean
radius.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from exosight.arrays import AnyArray
from exosight.mechanics.term import point_wrench

SPREAD = 1e-3
"""ε in the mean radius: 0.01 mm of distance on solids 20 mm thick is 0.0025 mm at most."""

NEWTON_STEPS = 2
"""From the pair without ε: on 4,000 nearly parallel pairs the derivatives are 1e-9 m after none, 1e-14 m
after one, round-off after two."""


class Cones(NamedTuple):
    """Tapered solids in the world: centres and radii at their starts, and the changes to their ends [m]."""

    start: Float[Array, "cones 3"]
    along: Float[Array, "cones 3"]
    radius: Float[Array, " cones"]
    taper: Float[Array, " cones"]

    def centre(self, place: Float[AnyArray, " cones"]) -> Float[Array, "cones 3"]:
        """Of the sphere at a share of the way."""
        return self.start + place[:, None] * self.along

    def thickness(self, place: Float[AnyArray, " cones"]) -> Float[Array, " cones"]:
        """Its radius [m]."""
        return self.radius + place * self.taper


Both = tuple[Float[Array, " cones"], Float[Array, " cones"]]
"""Something of s and of t."""


def smooth_pair(a: Cones, b: Cones, extra: Float[Array, " cones"]) -> Both:
    """The closest pair; its derivative by the poses is that of a last Newton step, whose start has none."""
    fixed, still = jax.lax.stop_gradient((a, b, extra)), jax.lax.stop_gradient(extra)
    s, t = closest_pair(fixed[0], fixed[1])
    for _ in range(NEWTON_STEPS):
        s, t = _in_square((s, t), *_expansion(*fixed, s, t))
    s, t = jax.lax.stop_gradient((s, t))
    (by_s, by_t), _ = _expansion(a, b, still, s, t)
    _, (ss, st, tt) = _expansion(*fixed, s, t)
    moves = [(x > 0) & (x < 1) for x in (s, t)]
    by_s, by_t = jnp.where(moves[0], by_s, 0.0), jnp.where(moves[1], by_t, 0.0)
    st = jnp.where(moves[0] & moves[1], st, 0.0)
    determinant = ss * tt - st**2
    return s - (tt * by_s - st * by_t) / determinant, t - (ss * by_t - st * by_s) / determinant


def slide(
    a: Cones, b: Cones, extra: Float[Array, " cones"], s: Float[Array, " cones"], t: Float[Array, " cones"]
) -> Float[Array, "cones 2 6"]:
    """L⁻¹ x, where L Lᵀ are the second derivatives of f by s and t, and x those by one of these and the twist
    of the first solid; zero where s or t is at an end."""
    _, (ss, st, tt) = _expansion(a, b, extra, s, t)
    gap, distance = between(a, b, s, t)
    n, centre = gap / distance[:, None], a.centre(s)
    rows = []
    for along, turned, place in ((a.along, jnp.cross(a.along, n), s), (-b.along, 0.0 * n, t)):
        aside = (along - dot(along, n)[:, None] * n) / distance[:, None]
        row = point_wrench(centre, aside) + jnp.concatenate([turned, 0.0 * turned], axis=1)
        rows.append(jnp.where(((place > 0) & (place < 1))[:, None], row, 0.0))
    both = (s > 0) & (s < 1) & (t > 0) & (t < 1)
    mixed = jnp.where(both, st, 0.0) / ss
    first, second = rows[0] / jnp.sqrt(ss)[:, None], rows[1] - mixed[:, None] * rows[0]
    return jnp.stack([first, second / jnp.sqrt(tt - mixed**2 * ss)[:, None]], axis=1)


def closest_pair(a: Cones, b: Cones) -> Both:
    """(s, t) where f is least, in closed form; where it is not unique, one of them."""
    apart = a.start - b.start
    none, one = jnp.zeros_like(a.radius), jnp.ones_like(a.radius)
    pairs = [_inside(a, b, apart)]
    for end in (none, one):
        pairs += [(end, _beside(b, a.centre(end))), (_beside(a, b.centre(end)), end)]
    values = [between(a, b, s, t)[1] - a.thickness(s) - b.thickness(t) for s, t in pairs]
    s, t = pairs[0]
    inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)  # NaN is not
    return _least(pairs, [jnp.where(inside, values[0], jnp.inf), *values[1:]])


def _inside(a: Cones, b: Cones, apart: Float[Array, "cones 3"]) -> Both:
    """Where both derivatives vanish, in the square or not: n = x a + y b + z a × b; NaN if nowhere."""
    (u, long_a), (v, long_b) = _unit(a), _unit(b)
    cross, cosine = jnp.cross(u, v), dot(u, v)
    sine = dot(cross, cross)
    on_a, on_b = a.taper / long_a, -b.taper / long_b
    x, y = (on_a - cosine * on_b) / sine, (on_b - cosine * on_a) / sine
    z = jnp.sqrt((1 - x * on_a - y * on_b) / sine)
    z = jnp.where(dot(apart, cross) < 0, -z, z)
    n = x[:, None] * u + y[:, None] * v + z[:, None] * cross
    s = -dot(apart, jnp.cross(v, n)) / (z * sine * long_a)
    return s, -dot(apart, jnp.cross(u, n)) / (z * sine * long_b)


def _beside(cones: Cones, point: Float[Array, "cones 3"]) -> Float[Array, " cones"]:
    """The place on an axis that is closest to a sphere around a point, as in `surface_contact`."""
    u, long = _unit(cones)
    away = point - cones.start
    x = dot(away, u)
    slope = -cones.taper / long
    off = jnp.sqrt(jnp.maximum(dot(away, away) - x**2, 0.0))
    return jnp.clip((x - slope / jnp.sqrt(1 - slope**2) * off) / long, 0.0, 1.0)


def _expansion(
    a: Cones, b: Cones, extra: Float[Array, " cones"], s: Float[Array, " cones"], t: Float[Array, " cones"]
) -> tuple[Both, tuple[Float[Array, " cones"], Float[Array, " cones"], Float[Array, " cones"]]]:
    """First derivatives of f with ε by s and t, and second ones by s s, s t, t t."""
    gap, distance = between(a, b, s, t)
    n = gap / distance[:, None]
    on_a, on_b = dot(n, a.along), -dot(n, b.along)
    first = on_a - a.taper + extra * (s - 0.5), on_b - b.taper + extra * (t - 0.5)
    ss = (dot(a.along, a.along) - on_a**2) / distance + extra
    tt = (dot(b.along, b.along) - on_b**2) / distance + extra
    return first, (ss, -(dot(a.along, b.along) + on_a * on_b) / distance, tt)


def _in_square(at: Both, first: Both, second: tuple[Array, Array, Array]) -> Both:
    """Where a convex quadratic function is least among s, t from 0 to 1, from its derivatives at a place."""
    (s, t), (by_s, by_t), (ss, st, tt) = at, first, second
    determinant = ss * tt - st**2
    free = s - (tt * by_s - st * by_t) / determinant, t - (ss * by_t - st * by_s) / determinant
    places = [free]
    for end in (0.0, 1.0):
        places += [
            (jnp.full_like(s, end), jnp.clip(t - (by_t + st * (end - s)) / tt, 0.0, 1.0)),
            (jnp.clip(s - (by_s + st * (end - t)) / ss, 0.0, 1.0), jnp.full_like(t, end)),
        ]
    values = []
    for to_s, to_t in places:
        ds, dt = to_s - s, to_t - t
        values.append(by_s * ds + by_t * dt + 0.5 * (ss * ds**2 + tt * dt**2) + st * ds * dt)
    outside = (free[0] < 0) | (free[0] > 1) | (free[1] < 0) | (free[1] > 1)
    return _least(places, [jnp.where(outside, jnp.inf, values[0]), *values[1:]])


def _least(places: list[Both], values: list[Float[Array, " cones"]]) -> Both:
    """The place of the smallest value."""
    (s, t), least = places[0], values[0]
    for (other_s, other_t), value in zip(places[1:], values[1:], strict=True):
        less = value < least
        s, t = jnp.where(less, other_s, s), jnp.where(less, other_t, t)
        least = jnp.minimum(least, value)
    return s, t


def between(
    a: Cones, b: Cones, s: Float[Array, " cones"], t: Float[Array, " cones"]
) -> tuple[Float[Array, "cones 3"], Float[Array, " cones"]]:
    """From the second centre to the first, and its length; the tiny offset keeps its derivatives finite."""
    gap = a.centre(s) - b.centre(t)
    return gap, jnp.sqrt(dot(gap, gap) + 1e-30)


def _unit(cones: Cones) -> tuple[Float[Array, "cones 3"], Float[Array, " cones"]]:
    """Directions and lengths of axes."""
    long = jnp.sqrt(dot(cones.along, cones.along))
    return cones.along / long[:, None], long


def dot(x: Float[Array, "n 3"], y: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """x · y of each."""
    return jnp.sum(x * y, axis=-1)
