"""One robot on its path of loads: the step that is repeated until the path is done.

Newton's method on Π, made globally safe: steps solve (∇²Π + λM) p = −∇Π with λ just large enough for a
Cholesky factor to exist, end where a gap closes, and are shortened until they lower Π (or, where round-off
hides the change of Π, the residual). A point counts as converged only if ∇²Π itself is positive definite
there, so a saddle, which a root finder accepts, is left along a direction of descent. The metric M is the
elastic stiffness: in it every soft mode weighs its own energy, whatever the units of its coordinate.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.mechanics.energy import Evaluation, potential, stiffness
from exosight.mechanics.robot import Robot


class ContinuationState(NamedTuple):
    """Where one robot is on its path: the accepted point, the trial point, and what was found so far.

    load, steps        index of the load being solved (its number of loads once done), and steps spent on it
    q, here, residual  the accepted point, and what was found there
    step, fraction     the direction being tried, and how much of it; the trial point is q + fraction · step
    slope              dΠ along the whole step [J]
    fresh              the trial point is a new start, to be accepted whatever its energy
    bumpy              since the last load, an accepted point had a direction of no or negative stiffness
    found, …           what was found at each load solved: coordinates, Hessian, ∂∇Π/∂u, energy, residual,
                       steps, success, and whether the way there was bumpy
    """

    load: Int[AnyArray, ""]
    steps: Int[AnyArray, ""]
    q: Float[AnyArray, " dofs"]
    here: Evaluation
    residual: Float[AnyArray, ""]
    step: Float[AnyArray, " dofs"]
    fraction: Float[AnyArray, ""]
    slope: Float[AnyArray, ""]
    fresh: Bool[AnyArray, ""]
    bumpy: Bool[AnyArray, ""]
    found: Float[AnyArray, "loads dofs"]
    hessians: Float[AnyArray, "loads dofs dofs"]
    load_gradients: Float[AnyArray, "loads channels dofs"]
    energies: Float[AnyArray, " loads"]
    residuals: Float[AnyArray, " loads"]
    iterations: Int[AnyArray, " loads"]
    converged: Bool[AnyArray, " loads"]
    bumps: Bool[AnyArray, " loads"]


def begin(q: Float[AnyArray, " dofs"], room: int, channels: int) -> ContinuationState:
    """A path with room for so many loads about to start from q; in NumPy, as it is filled in from Python."""
    dofs = len(q)
    zeros: Any = np.zeros
    nothing = Evaluation(
        energy=zeros(()),
        gradient=zeros(dofs),
        hessian=zeros((dofs, dofs)),
        load_energy=zeros(channels),
        load_gradient=zeros((channels, dofs)),
    )
    return ContinuationState(
        load=zeros((), int),
        steps=zeros((), int),
        q=zeros(dofs) + q,
        here=nothing,
        residual=zeros(()) + np.inf,
        step=zeros(dofs),
        fraction=zeros(()),
        slope=zeros(()),
        fresh=~zeros((), bool),
        bumpy=zeros((), bool),
        found=zeros((room, dofs)),
        hessians=zeros((room, dofs, dofs)),
        load_gradients=zeros((room, channels, dofs)),
        energies=zeros(room),
        residuals=zeros(room),
        iterations=zeros(room, int),
        converged=zeros(room, bool),
        bumps=zeros(room, bool),
    )


def metric_of(robot: Robot) -> Float[Array, "dofs dofs"]:
    """The elastic stiffness; a coordinate without any (a joint without a spring) weighs as the mean.

    Where there is no stiffness at all, as in a chain held by weights alone, it is 1 N m/rad or N/m.
    """
    elastic = stiffness(robot)
    own = jnp.diag(elastic)
    mean = jnp.mean(own)
    return elastic + jnp.diag(jnp.where(own > 0, 1e-9 * own, jnp.where(mean > 0, mean, 1.0)))


def newton_stepper(
    robot: Robot,
    loads: Float[AnyArray, "loads channels"],
    parents: Int[AnyArray, " loads"],
    starts: Float[AnyArray, "loads dofs"],
    count: Int[AnyArray, ""],
    tolerance: Float[AnyArray, ""],
    max_iterations: Int[AnyArray, ""],
) -> Callable[[ContinuationState], ContinuationState]:
    """The function that takes a path one Newton step further, and to its next load when it has converged.

    Only the first `count` loads are meant; each starts from the equilibrium at one before it, its parent, or
    if that is −1 from its row of `starts`.
    """
    evaluate = potential(robot)
    metric = metric_of(robot)
    factor = jnp.linalg.cholesky(metric)
    unit = 0.01 * jnp.sqrt(jnp.trace(metric) / robot.dofs)

    def size(q: Array) -> Array:
        return jnp.linalg.norm(factor.T @ q)

    def relative(gradient: Array, q: Array) -> Array:
        return jnp.linalg.norm(solve_triangular(factor, gradient, lower=True)) / (size(q) + unit)

    def advance(path: ContinuationState) -> ContinuationState:
        load = jnp.minimum(path.load, count - 1)
        trial = jnp.asarray(path.q + path.fraction * path.step)
        there, motion = evaluate(trial, loads[load])
        residual = relative(there.gradient, trial)

        # Accept on the energy; where its change drowns in round-off, on the residual.
        change = there.energy - path.here.energy
        expected = path.fraction * path.slope
        noise = 1e-12 * (jnp.abs(there.energy) + size(trial) ** 2)
        hidden = (jnp.abs(expected) < noise) & (change > -noise)
        good = jnp.where(hidden, residual <= path.residual, change <= 1e-4 * expected)
        if not robot.conservative:
            good = residual <= (1 - 1e-4 * path.fraction) * path.residual
        accept = path.fresh | (good & jnp.isfinite(residual))
        here, q, residual = jax.tree.map(
            lambda new, old: jnp.where(accept, new, old),
            (there, trial, residual),
            (path.here, path.q, path.residual),
        )
        if robot.conservative:
            cholesky, stable = _shifted_factor(here.hessian, metric)
        else:  # no energy whose minimum it could be: any solution of the equations will do
            cholesky, stable = metric, jnp.array(True)
        reached, energy = residual, here.energy
        small = reached < tolerance
        converged = small & stable
        steps = path.steps + 1
        moved_on = converged | (steps >= max_iterations)
        bumpy = path.bumpy | ~stable

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
        along = jnp.where(saddle, _some_direction(robot.dofs), here.gradient)
        if robot.conservative:
            p = -cho_solve((cholesky, True), along)
        else:
            p = -jnp.linalg.solve(here.hessian, along)
        length = jnp.maximum(size(p), 1e-300)
        longest = 0.5 * size(q) + 20 * unit
        p = p * jnp.where(saddle, (0.05 * size(q) + unit) / length, jnp.minimum(1.0, longest / length))
        if robot.conservative:
            p = jnp.where(here.gradient @ p > 0, -p, p)
        # A refused step is shortened to where a parabola through both energies has its minimum.
        shorter = jnp.clip(-0.5 * expected / jnp.maximum(change - expected, 1e-300), 0.1, 0.5)
        retry = ~accept & ~moved_on
        step = jnp.where(retry, path.step, p)
        reach = jnp.min(
            jnp.stack([jnp.array(1.0), *(term.max_step_fraction(robot, motion, p) for term in robot.terms)])
        )
        fraction = jnp.where(retry, path.fraction * shorter, reach)
        slope = jnp.where(retry, path.slope, here.gradient @ p)

        record = moved_on & (path.load < count)

        def put(into: AnyArray, value: AnyArray) -> Array:
            return jnp.asarray(into).at[load].set(jnp.where(record, value, into[load]))

        found = put(path.found, q)
        elsewhere = moved_on & ~onwards
        parent = parents[following]
        return ContinuationState(
            load=jnp.minimum(path.load + moved_on, count),
            steps=jnp.where(moved_on, 0, steps),
            q=jnp.where(elsewhere, jnp.where(parent < 0, starts[following], found[parent]), q),
            here=here,
            residual=residual,
            step=step,
            fraction=jnp.where(elsewhere, 0.0, fraction),
            slope=slope,
            fresh=elsewhere,
            bumpy=bumpy & ~moved_on,
            found=found,
            hessians=put(path.hessians, here.hessian),
            load_gradients=put(path.load_gradients, here.load_gradient),
            energies=put(path.energies, energy),
            residuals=put(path.residuals, reached),
            iterations=put(path.iterations, steps),
            converged=put(path.converged, converged),
            bumps=put(path.bumps, bumpy),
        )

    return advance


def _shifted_factor(hessian: Array, metric: Array) -> tuple[Array, Array]:
    """The Cholesky factor of hessian + λ metric for the least λ tried that has one, and whether λ = 0."""

    def attempt(shift: Array) -> tuple[Array, Array]:
        return shift, jnp.linalg.cholesky(hessian + shift * metric)

    def failed(state: tuple[Array, Array]) -> Array:
        return ~jnp.all(jnp.isfinite(state[1])) & (state[0] < 1e12)

    shift, factor = jax.lax.while_loop(
        failed, lambda state: attempt(jnp.maximum(2 * state[0], 1e-2)), attempt(jnp.array(0.0))
    )
    return factor, shift == 0


def _some_direction(dofs: int) -> Array:
    """A fixed direction without symmetry, to leave a saddle along: orthogonal to no eigenvector by design."""
    return jnp.asarray(np.random.default_rng(0).normal(size=dofs))
