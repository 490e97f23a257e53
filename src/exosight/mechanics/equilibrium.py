"""Stable equilibria: local minima of the potential energy, followed along a path of loads, many at a time.

Each robot of a batch walks its own path inside one compiled loop and goes on to its next load as soon as it
has converged (`newton`); robots that have arrived make room for others (`batched_continuation`).
So none waits for another.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.batched_continuation import ContinuationProblem, solve_paths, width
from exosight.mechanics.newton import ContinuationState
from exosight.mechanics.robot import Robot
from exosight.mechanics.snap_detection import find_jumps

GROUP = 256
"""Robots solved at a time: the Hessians along a path, by which snaps are told, take half a megabyte each."""


@dataclass(frozen=True)
class SolverOptions:
    """How an equilibrium is searched.

    tolerance       largest residual of a converged point [-], see `Equilibria`
    max_iterations  Newton steps for one load before it is given up
    lanes           robots solved side by side in one compiled call; by default 8 on a CPU, where they share
                    the cache of a core, and 2048 on a GPU
    """

    tolerance: float = 1e-10
    max_iterations: int = 200
    lanes: int | None = None

    def __post_init__(self) -> None:
        if not (self.tolerance > 0 and self.max_iterations > 0 and (self.lanes is None or self.lanes > 0)):
            raise InputError(f"solver: expected tolerance, max_iterations and lanes above 0, got {self}")


class Equilibria(eqx.Module):
    """Equilibria along a path; every field may carry leading batch dimensions.

    q               (loads, dofs)   coordinates
    converged       (loads,)        residual within tolerance and stable
    residual        (loads,)        |∇Π| / (|q| + q₀): relative error in the elastic energy norm [-];
                                    |∇Π|² = ∇Πᵀ M⁻¹ ∇Π, |q|² = qᵀ M q, q₀ = |q| of a strain or angle of 0.01
    min_eigenvalue  (loads,)        smallest λ of ∇²Π v = λ M v [-]: 1 at rest, 0 where the pose snaps; with
                                    forces that have no energy, the smallest real part
    snapped         (loads,)        the pose jumped on the way from the load before, see `snap_detection`
    energy          (loads,)        Π [J]
    iterations      (loads,)        Newton steps taken
    """

    q: Float[AnyArray, "*batch loads dofs"]
    converged: Bool[AnyArray, "*batch loads"]
    residual: Float[AnyArray, "*batch loads"]
    min_eigenvalue: Float[AnyArray, "*batch loads"]
    snapped: Bool[AnyArray, "*batch loads"]
    energy: Float[AnyArray, "*batch loads"]
    iterations: Int[AnyArray, "*batch loads"]


def stack(robots: Sequence[Robot]) -> Robot:
    """Robots of one structure as a single batched robot: every number gains a leading axis."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *robots)


def follow(
    robots: Sequence[Robot],
    loads: Float[np.ndarray, "loads channels"],
    *,
    parents: Sequence[int] | None = None,
    q: Float[np.ndarray, "robots dofs"] | None = None,
    options: SolverOptions = SolverOptions(),
    snaps: bool = True,
    done: Callable[[int], None] = lambda robots: None,
) -> Equilibria:
    """The equilibria of each robot along one path of loads, each the start of the next.

    robots    robots of one structure (same bodies, bases, points and terms)
    loads     (loads, channels)   u of each term's channel [N], in the order of the path
    parents   for each load the index of an earlier one whose equilibrium it starts from, −1 for `q`;
              by default the one before: branches of the path let extra loads be asked for without
              changing the others
    q         (robots, dofs)      where the path starts; the unstrained pose by default
    snaps     whether to tell snaps, which takes a fifth of the time; if not, `snapped` is False throughout
    done      called with the number of robots finished, as they finish
    returns   Equilibria with batch shape (robots,)

    A robot that finds no equilibrium at a load says so in `converged`, keeps its best point there, and
    starts the next load from it. Compiled once a structure and number of lanes.
    """
    loads, source, start = _checked(robots, loads, parents, q)
    jobs = [
        ContinuationProblem(robot, loads, source, np.tile(q0, (len(loads), 1)))
        for robot, q0 in zip(robots, start, strict=True)
    ]
    limits = (options.tolerance, options.max_iterations, options.lanes)
    groups = -(-len(jobs) // max(GROUP, width(options.lanes, len(jobs))))
    results = []
    for numbers in np.array_split(np.arange(len(jobs)), groups):  # of equal sizes: no compilation for a rest
        group = slice(numbers[0], numbers[-1] + 1)
        solved = solve_paths(jobs[group], *limits, done)
        jumps = [np.zeros(len(loads), dtype=bool)] * len(solved)
        if snaps:
            jumps = find_jumps(robots[group], solved, loads, source, options.tolerance, options.lanes)
        results += [_result(*path, snapped) for path, snapped in zip(solved, jumps, strict=True)]
    return jax.tree.map(lambda *leaves: np.array(leaves), *results)


def _checked(
    robots: Sequence[Robot],
    loads: Float[np.ndarray, "loads channels"],
    parents: Sequence[int] | None,
    q: Float[np.ndarray, "robots dofs"] | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Loads, parents and starts as arrays; InputError for what cannot be followed."""
    loads = np.asarray(loads, dtype=float)
    if not robots:
        raise InputError("robots: expected at least one, got none")
    if len({jax.tree.structure(robot) for robot in robots}) > 1:
        raise InputError("robots: expected one structure (bodies, bases, points, terms), got several")
    if loads.ndim != 2 or not len(loads):
        raise InputError(f"loads: expected shape (loads, channels), at least one load, got {loads.shape}")
    if not np.all(np.isfinite(loads)):
        raise InputError("loads: expected finite numbers, got NaN or infinity among them")
    if loads.shape[1] < robots[0].loads:
        raise InputError(f"loads: the robot's terms need {robots[0].loads} channels, got {loads.shape[1]}")
    source = np.arange(-1, len(loads) - 1) if parents is None else np.asarray(parents)
    if source.shape != loads.shape[:1] or np.any(source >= np.arange(len(loads))) or np.any(source < -1):
        raise InputError("parents: expected each load to start from an earlier one, or from −1")
    shape = (len(robots), robots[0].dofs)
    start = np.zeros(shape) if q is None else np.asarray(q, dtype=float)
    if start.shape != shape or not np.all(np.isfinite(start)):
        raise InputError(f"q: expected finite numbers of shape {shape}, got {start.shape}")
    return loads, source, start


def _result(
    path: ContinuationState, metric: Float[np.ndarray, "dofs dofs"], snapped: Bool[np.ndarray, " loads"]
) -> Equilibria:
    """The record of a path that is done; λ of ∇²Π v = λ M v from the whitened Hessian."""
    whitener = np.linalg.inv(np.linalg.cholesky(metric))
    whitened = whitener @ path.hessians @ whitener.T
    if np.allclose(whitened, np.swapaxes(whitened, 1, 2), rtol=0, atol=1e-9 * np.abs(whitened).max()):
        eigenvalue = np.linalg.eigvalsh(whitened)[:, 0]
    else:
        eigenvalue = np.linalg.eigvals(whitened).real.min(axis=-1)
    return Equilibria(
        q=path.found,
        converged=path.converged & (eigenvalue > 0),
        residual=path.residuals,
        min_eigenvalue=eigenvalue,
        snapped=snapped,
        energy=path.energies,
        iterations=path.iterations,
    )
