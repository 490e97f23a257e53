"""Stable equilibria: local minima of the potential energy, followed along a path of loads.

Newton's method on Π, made globally safe: steps solve (∇²Π + λM) p = −∇Π with λ just large enough for a
Cholesky factor to exist, and are shortened until they lower Π (or, where round-off hides the change of Π, the
residual). A point counts as converged only if ∇²Π itself is positive definite there, so a saddle, which a
root finder accepts, is left along a direction of descent. The metric M is the elastic stiffness: in it every
soft mode weighs its own energy, whatever the units of its coordinate.

Each element of a batch walks its own load path inside one compiled loop and moves on to its next load as soon
as it has converged, so no element waits for another until the very end.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Bool, Float, Int

from exosight.errors import InputError
from exosight.mechanics.energy import Evaluation, potential, stiffness
from exosight.mechanics.robot import Robot

T = TypeVar("T")


@dataclass(frozen=True)
class SolverOptions:
    """How an equilibrium is searched.

    tolerance       largest residual of a converged point [-], see `Equilibria`
    max_iterations  Newton steps for one load before it is given up
    """

    tolerance: float = 1e-10
    max_iterations: int = 200


class Equilibria(eqx.Module):
    """Equilibria along a path; every field may carry leading batch dimensions.

    q               (loads, dofs)   coordinates
    converged       (loads,)        residual within tolerance and stable
    residual        (loads,)        |∇Π| / (|q| + q₀): relative error in the elastic energy norm [-];
                                    |∇Π|² = ∇Πᵀ M⁻¹ ∇Π, |q|² = qᵀ M q, q₀ = |q| of a strain or angle of 0.01
    min_eigenvalue  (loads,)        smallest λ of ∇²Π v = λ M v [-]: 1 at rest, 0 where the pose snaps
    energy          (loads,)        Π [J]
    iterations      (loads,)        Newton steps taken
    """

    q: Float[Array, "*batch loads dofs"]
    converged: Bool[Array, "*batch loads"]
    residual: Float[Array, "*batch loads"]
    min_eigenvalue: Float[Array, "*batch loads"]
    energy: Float[Array, "*batch loads"]
    iterations: Int[Array, "*batch loads"]


def stack(robots: Sequence[Robot]) -> Robot:
    """Robots of one structure as a single batched robot: every number gains a leading axis."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *robots)


def follow(
    robots: Sequence[Robot],
    loads: Float[np.ndarray, "loads channels"],
    *,
    parents: Sequence[int] | None = None,
    q: Float[np.ndarray, "robots dofs"] | None = None,
    options: SolverOptions = SolverOptions(),
    chunk: int = 32,
    done: Callable[[int], None] = lambda robots: None,
) -> Equilibria:
    """The equilibria of each robot along one path of loads, each the start of the next.

    robots    robots of one structure (same bodies, bases, points and terms)
    loads     (loads, channels)   u of each term's channel [N], in the order of the path
    parents   for each load the index of an earlier one whose equilibrium it starts from, −1 for `q`;
              by default the one before: branches of the path let extra loads be asked for without
              changing the others
    q         (robots, dofs)      where the path starts; the unstrained pose by default
    chunk     robots solved in one compiled call
    done      called with the number of robots finished, as they finish
    returns   Equilibria with batch shape (robots,)
    """
    loads = np.asarray(loads, dtype=float)
    if loads.ndim != 2 or not np.all(np.isfinite(loads)):
        raise InputError(f"loads: expected finite numbers of shape (loads, channels), got shape {loads.shape}")
    parents = np.arange(-1, len(loads) - 1) if parents is None else np.asarray(parents)
    if np.any(parents >= np.arange(len(loads))) or np.any(parents < -1):
        raise InputError("parents: expected each load to start from an earlier one, or from −1")
    dofs = robots[0].dofs
    start = np.zeros((len(robots), dofs)) if q is None else np.asarray(q, dtype=float)
    if start.shape != (len(robots), dofs) or not np.all(np.isfinite(start)):
        raise InputError(f"q: expected finite numbers of shape ({len(robots)}, {dofs}), got {start.shape}")

    size = min(chunk, len(robots))
    pieces = [range(i, min(i + size, len(robots))) for i in range(0, len(robots), size)]

    def solve(piece: range) -> Equilibria:
        padded = [min(i, piece[-1]) for i in range(piece[0], piece[0] + size)]  # one shape, one compilation
        batch = stack([robots[i] for i in padded])
        found = _follow_batch(batch, start[padded], loads, parents, options.tolerance, options.max_iterations)
        found = jax.tree.map(lambda leaf: np.asarray(leaf)[: len(piece)], found)
        done(len(piece))
        return found

    parts = list(_in_threads(solve, pieces))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _in_threads(function: Callable[[range], T], items: Sequence[range]) -> Iterator[T]:
    """Compiled calls release Python's lock, so one thread a core keeps every core busy."""
    if len(items) == 1:
        yield function(items[0])
        return
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        yield from pool.map(function, items)


class _Path(NamedTuple):
    """Where one robot is on its path: the accepted point, the trial point, and what was found so far.

    load, steps        index of the load being solved, and Newton steps spent on it
    q, here, residual  the accepted point, and what was found there
    step, fraction     the direction being tried, and how much of it; the trial point is q + fraction · step
    slope              dΠ along the whole step [J]
    fresh              the trial point is a new start, to be accepted whatever its energy
    """

    load: Int[Array, ""]
    steps: Int[Array, ""]
    q: Float[Array, " dofs"]
    here: Evaluation
    residual: Float[Array, ""]
    step: Float[Array, " dofs"]
    fraction: Float[Array, ""]
    slope: Float[Array, ""]
    fresh: Bool[Array, ""]
    found: Float[Array, "loads dofs"]
    ok: Bool[Array, " loads"]
    residuals: Float[Array, " loads"]
    iterations: Int[Array, " loads"]


@eqx.filter_jit
def _follow_batch(
    robot: Robot, q: Array, loads: Array, parents: Array, tolerance: float, max_iterations: int
) -> Equilibria:
    return jax.vmap(lambda r, start: _follow_one(r, start, loads, parents, tolerance, max_iterations))(robot, q)


def _follow_one(
    robot: Robot, start: Array, loads: Array, parents: Array, tolerance: float, max_iterations: int
) -> Equilibria:
    evaluate = potential(robot)
    metric = stiffness(robot)
    # A joint without a spring has no stiffness of its own: a small part of the mean stands in.
    metric = metric + 1e-6 * jnp.trace(metric) / robot.dofs * jnp.eye(robot.dofs)
    factor = jnp.linalg.cholesky(metric)
    unit = 0.01 * jnp.sqrt(jnp.trace(metric) / robot.dofs)
    count = loads.shape[0]

    def size(q: Array) -> Array:
        return jnp.linalg.norm(factor.T @ q)

    def relative(gradient: Array, q: Array) -> Array:
        return jnp.linalg.norm(solve_triangular(factor, gradient, lower=True)) / (size(q) + unit)

    def advance(path: _Path) -> _Path:
        load = jnp.minimum(path.load, count - 1)
        trial = path.q + path.fraction * path.step
        there, motion = evaluate(trial, loads[load])
        residual = relative(there.gradient, trial)

        # Accept on the energy; where its change drowns in round-off, on the residual.
        change = there.energy - path.here.energy
        expected = path.fraction * path.slope
        hidden = jnp.abs(expected) < 1e-12 * (jnp.abs(there.energy) + size(trial) ** 2)
        good = jnp.where(hidden, residual <= path.residual, change <= 1e-4 * expected)
        accept = path.fresh | (good & jnp.isfinite(residual))
        here, q, residual = jax.tree.map(
            lambda new, old: jnp.where(accept, new, old),
            (there, trial, residual),
            (path.here, path.q, path.residual),
        )
        cholesky, stable = _shifted_factor(here.hessian, metric)
        reached = residual
        small = reached < tolerance
        converged = small & stable
        steps = path.steps + 1
        moved_on = converged | (steps >= max_iterations)

        # At the next load the energy and gradient here are known, loads being linear: its first Newton step,
        # with the Hessian of this load, is the tangent of the path.
        following = jnp.minimum(load + 1, count - 1)
        onwards = moved_on & converged & (parents[following] == load)
        more = jnp.where(onwards, loads[following] - loads[load], 0.0)
        here = here._replace(
            energy=here.energy + more @ here.load_energy, gradient=here.gradient + more @ here.load_gradient
        )
        residual = jnp.where(onwards, relative(here.gradient, q), residual)

        # Newton's direction; at a saddle, where there is none, a downhill one of a small fixed size.
        saddle = small & ~stable
        p = -cho_solve((cholesky, True), jnp.where(saddle, _some_direction(robot.dofs), here.gradient))
        length = jnp.maximum(size(p), 1e-300)
        p = p * jnp.where(saddle, (0.05 * size(q) + unit) / length, jnp.minimum(1.0, (0.5 * size(q) + 20 * unit) / length))
        # A refused step is shortened to where a parabola through both energies has its minimum.
        shorter = jnp.clip(-0.5 * expected / jnp.maximum(change - expected, 1e-300), 0.1, 0.5)
        retry = ~accept & ~moved_on
        step = jnp.where(retry, path.step, p)
        reach = jnp.min(jnp.stack([jnp.array(1.0), *(term.reach(robot, motion, p) for term in robot.terms)]))
        fraction = jnp.where(retry, path.fraction * shorter, reach)
        slope = jnp.where(retry, path.slope, here.gradient @ p)

        record = moved_on & (path.load < count)
        found = path.found.at[load].set(jnp.where(record, q, path.found[load]))
        elsewhere = moved_on & ~onwards
        parent = parents[following]
        q = jnp.where(elsewhere, jnp.where(parent < 0, start, found[parent]), q)
        return _Path(
            load=path.load + moved_on,
            steps=jnp.where(moved_on, 0, steps),
            q=q,
            here=here,
            residual=residual,
            step=step,
            fraction=jnp.where(elsewhere, 0.0, fraction),
            slope=slope,
            fresh=elsewhere,
            found=found,
            ok=path.ok.at[load].set(jnp.where(record, converged, path.ok[load])),
            residuals=path.residuals.at[load].set(jnp.where(record, reached, path.residuals[load])),
            iterations=path.iterations.at[load].set(jnp.where(record, steps, path.iterations[load])),
        )

    origin, _ = evaluate(start, loads[0])
    path = jax.lax.while_loop(
        lambda path: path.load < count,
        advance,
        _Path(
            load=jnp.array(0),
            steps=jnp.array(0),
            q=start,
            here=origin,
            residual=jnp.array(jnp.inf),
            step=jnp.zeros(robot.dofs),
            fraction=jnp.array(0.0),
            slope=jnp.array(0.0),
            fresh=jnp.array(True),
            found=jnp.zeros((count, robot.dofs)),
            ok=jnp.zeros(count, dtype=bool),
            residuals=jnp.zeros(count),
            iterations=jnp.zeros(count, dtype=int),
        ),
    )

    def judge(q: Array, load: Array) -> tuple[Array, Array]:
        here, _ = evaluate(q, load)
        half = solve_triangular(factor, here.hessian, lower=True)
        whitened = solve_triangular(factor, half.T, lower=True)
        return here.energy, jnp.linalg.eigvalsh(0.5 * (whitened + whitened.T))[0]

    energy, eigenvalue = jax.lax.map(lambda pair: judge(*pair), (path.found, loads))
    return Equilibria(
        q=path.found,
        converged=path.ok & (eigenvalue > 0),
        residual=path.residuals,
        min_eigenvalue=eigenvalue,
        energy=energy,
        iterations=path.iterations,
    )


def _shifted_factor(hessian: Array, metric: Array) -> tuple[Array, Array]:
    """The Cholesky factor of hessian + λ metric for the least λ tried at which there is one, and whether λ = 0."""

    def attempt(shift: Array) -> tuple[Array, Array]:
        return shift, jnp.linalg.cholesky(hessian + shift * metric)

    def failed(state: tuple[Array, Array]) -> Array:
        return ~jnp.all(jnp.isfinite(state[1])) & (state[0] < 1e12)

    shift, factor = jax.lax.while_loop(
        failed, lambda state: attempt(jnp.maximum(2 * state[0], 1e-2)), attempt(jnp.array(0.0))
    )
    return factor, shift == 0


def _some_direction(dofs: int) -> Array:
    """A fixed direction without symmetry, to leave a saddle along: no eigenvector is orthogonal to it by design."""
    return jnp.asarray(np.random.default_rng(0).normal(size=dofs))
