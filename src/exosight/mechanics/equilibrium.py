"""Stable equilibria: local minima of the potential energy, followed along a path of loads, many at a time.

Each robot of a batch walks its own path inside one compiled loop and goes on to its next load as soon as it
has converged (`newton`); robots that have arrived make room for others. So none waits for another.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from exosight.arrays import AnyArray
from exosight.errors import InputError
from exosight.mechanics.newton import Path, begin, metric_of, stepper
from exosight.mechanics.robot import Robot


@dataclass(frozen=True)
class SolverOptions:
    """How an equilibrium is searched.

    tolerance       largest residual of a converged point [-], see `Equilibria`
    max_iterations  Newton steps for one load before it is given up
    lanes           robots solved side by side in one compiled call
    """

    tolerance: float = 1e-10
    max_iterations: int = 200
    lanes: int = 16

    def __post_init__(self) -> None:
        if not (self.tolerance > 0 and self.max_iterations > 0 and self.lanes > 0):
            raise InputError(f"solver: expected tolerance, max_iterations and lanes above 0, got {self}")


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

    q: Float[AnyArray, "*batch loads dofs"]
    converged: Bool[AnyArray, "*batch loads"]
    residual: Float[AnyArray, "*batch loads"]
    min_eigenvalue: Float[AnyArray, "*batch loads"]
    energy: Float[AnyArray, "*batch loads"]
    iterations: Int[AnyArray, "*batch loads"]


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
    done: Callable[[int], None] = lambda robots: None,
) -> Equilibria:
    """The equilibria of each robot along one path of loads, each the start of the next.

    robots    robots of one structure (same bodies, bases, points and terms)
    loads     (loads, channels)   u of each term's channel [N], in the order of the path
    parents   for each load the index of an earlier one whose equilibrium it starts from, −1 for `q`;
              by default the one before: branches of the path let extra loads be asked for without
              changing the others
    q         (robots, dofs)      where the path starts; the unstrained pose by default
    done      called with the number of robots finished, as they finish
    returns   Equilibria with batch shape (robots,)

    A robot that finds no equilibrium at a load says so in `converged`, keeps its best point there, and
    starts the next load from it. Compiled once a structure, and for each power of two of robots and loads.
    """
    loads = np.asarray(loads, dtype=float)
    if not robots:
        raise InputError("robots: expected at least one, got none")
    if any(jax.tree.structure(robot) != jax.tree.structure(robots[0]) for robot in robots):
        raise InputError("robots: expected one structure (bodies, bases, points, terms), got several")
    if loads.ndim != 2 or not len(loads):
        raise InputError(f"loads: expected shape (loads, channels), at least one load, got {loads.shape}")
    if not np.all(np.isfinite(loads)):
        raise InputError("loads: expected finite numbers, got NaN or infinity among them")
    needed = max((term.loads for term in robots[0].terms), default=0)
    if loads.shape[1] < needed:
        raise InputError(f"loads: the robot's terms need {needed} channels, got {loads.shape[1]}")
    source = np.arange(-1, len(loads) - 1) if parents is None else np.asarray(parents)
    if source.shape != loads.shape[:1] or np.any(source >= np.arange(len(loads))) or np.any(source < -1):
        raise InputError("parents: expected each load to start from an earlier one, or from −1")
    count, channels = loads.shape
    dofs = robots[0].dofs
    start = np.zeros((len(robots), dofs)) if q is None else np.asarray(q, dtype=float)
    if start.shape != (len(robots), dofs) or not np.all(np.isfinite(start)):
        raise InputError(f"q: expected finite numbers of shape ({len(robots)}, {dofs}), got {start.shape}")

    # Sizes are rounded up to powers of two, so that few different ones are ever compiled.
    lanes = min(options.lanes, _power_of_two(len(robots)))
    room = max(16, _power_of_two(count))
    padded = jnp.asarray(np.concatenate([loads, np.repeat(loads[-1:], room - count, axis=0)]))
    sources = jnp.asarray(np.concatenate([source, np.zeros(room - count, dtype=int)]))
    workers = min(_cores(), -(-len(robots) // lanes))
    queue = _Queue(len(robots))
    metrics = np.asarray(_metrics(stack(robots)))
    results: list[Equilibria | None] = [None] * len(robots)

    def work() -> None:
        numbers = queue.take(lanes)
        if not numbers:
            return
        numbers += [-1] * (lanes - len(numbers))
        own = [max(i, 0) for i in numbers]
        batch, starts = stack([robots[i] for i in own]), start[own]
        state = _stack([begin(q, room, channels) for q in starts])
        state.load[np.array(numbers) < 0] = count  # lanes without a robot stand still
        while any(i >= 0 for i in numbers) and not queue.stopped:
            # While robots wait, come back as soon as a quarter of the lanes is free for them.
            enough = min(lanes, numbers.count(-1) + max(1, lanes // 4)) if queue.waiting else lanes
            limits = (count, options.tolerance, options.max_iterations, enough)
            found = _advance(
                batch, state, jnp.asarray(starts), padded, sources, *(jnp.asarray(x) for x in limits)
            )
            state = jax.tree.map(np.array, found)
            arrived = [lane for lane, i in enumerate(numbers) if i >= 0 and state.load[lane] == count]
            for lane in arrived:
                i, numbers[lane] = numbers[lane], -1
                path = jax.tree.map(lambda leaf, lane=lane: leaf[lane].copy(), state)
                results[i] = _result(path, count, metrics[i])
            done(len(arrived))
            for lane, i in zip(arrived, queue.take(len(arrived)), strict=False):
                numbers[lane], starts[lane] = i, start[i]
                fresh = jax.tree.leaves(begin(start[i], room, channels))
                for into, leaf in zip(jax.tree.leaves(state), fresh, strict=True):
                    into[lane] = leaf
                batch = jax.tree.map(lambda rows, row, lane=lane: rows.at[lane].set(row), batch, robots[i])

    # Compiled calls release Python's lock, so one thread a core keeps every core busy.
    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            for future in [pool.submit(work) for _ in range(workers)]:
                future.result()
        except BaseException:  # Ctrl-C too: the pool waits for its threads, which need not finish
            queue.stopped = True
            raise
    return jax.tree.map(lambda *leaves: np.stack(leaves), *results)


class _Queue:
    """Numbers of the robots that nobody has taken yet."""

    def __init__(self, count: int) -> None:
        self._next, self._count, self._lock = 0, count, Lock()
        self.stopped = False

    @property
    def waiting(self) -> bool:
        return self._next < self._count

    def take(self, most: int) -> list[int]:
        with self._lock:
            taken = range(self._next, min(self._next + most, self._count))
            self._next = taken.stop
        return list(taken)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _power_of_two(least: int) -> int:
    return 1 << max(0, least - 1).bit_length()


def _stack(paths: Sequence[Path]) -> Path:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *paths)


def _result(path: Path, count: int, metric: Float[np.ndarray, "dofs dofs"]) -> Equilibria:
    """The record of a path that is done; λ of ∇²Π v = λ M v from the whitened Hessian."""
    whitener = np.linalg.inv(np.linalg.cholesky(metric))
    eigenvalue = np.linalg.eigvalsh(whitener @ path.hessians[:count] @ whitener.T)[:, 0]
    return Equilibria(
        q=path.found[:count],
        converged=path.converged[:count] & (eigenvalue > 0),
        residual=path.residuals[:count],
        min_eigenvalue=eigenvalue,
        energy=path.energies[:count],
        iterations=path.iterations[:count],
    )


@eqx.filter_jit
def _metrics(robots: Robot) -> Float[Array, "robots dofs dofs"]:
    return jax.vmap(metric_of)(robots)


@eqx.filter_jit
def _advance(
    robots: Robot,
    paths: Path,
    starts: Float[Array, "lanes dofs"],
    loads: Float[Array, "loads channels"],
    parents: Int[Array, " loads"],
    count: Int[Array, ""],
    tolerance: Float[Array, ""],
    max_iterations: Int[Array, ""],
    enough: Int[Array, ""],
) -> Path:
    """Step every path until `enough` of them have all `count` loads behind them."""

    def step(paths: Path) -> Path:
        def one(robot: Robot, start: Array, path: Path) -> Path:
            return stepper(robot, start, loads, parents, count, tolerance, max_iterations)(path)

        return jax.vmap(one)(robots, starts, paths)

    return jax.lax.while_loop(lambda paths: jnp.sum(paths.load == count) < enough, step, paths)
