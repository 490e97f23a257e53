"""Whether the steps of solved paths are smooth, or jumps from one branch of equilibria to another (snaps).

Three questions, each to the steps that the one before leaves open:

1. Is the change of q what the path's tangents at both ends lead to, without an unstable pose on the way?
   Then it is smooth.
2. Does going back to the load before lead back to the pose before? If not, it is a jump.
3. Cut in half again and again, on into the half that is least like its tangents: do both halves become like
   theirs? If not, it is a jump of so little hysteresis that it is undone.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from exosight.mechanics.batched_continuation import ContinuationProblem, Solved, solve_paths
from exosight.mechanics.newton import ContinuationState
from exosight.mechanics.robot import Robot

UNDO_ITERATIONS = 20
"""Newton steps in which a smooth step is undone: the slowest of those between loads of the paper's path takes
about 15. Snapping back takes up to a hundred, and need not be waited for."""

HALVINGS = 6
"""Times that a doubtful step is halved. Even near a fold, where the change is the root of the distance to it,
an eighth of a smooth change is left then; of a jump, all."""

DEVIATION = 0.15, 2e-4
"""How far a smooth change may lie from what the tangents at both ends lead to: relative to the larger of
these two, and to the pose itself."""


class _Steps(NamedTuple):
    """Steps of any robots' paths, side by side; poses as coordinates whose length is the elastic energy norm.

    number       whose path it is
    low, high    loads at the two ends [N]
    left, right  the equilibria there
    leaving      the change of the pose over the whole step that the tangent at `low` leads to
    arriving     and that at `high`
    """

    number: Int[np.ndarray, " n"]
    low: Float[np.ndarray, "n channels"]
    high: Float[np.ndarray, "n channels"]
    left: Float[np.ndarray, "n dofs"]
    right: Float[np.ndarray, "n dofs"]
    leaving: Float[np.ndarray, "n dofs"]
    arriving: Float[np.ndarray, "n dofs"]

    def of(self, chosen: Int[np.ndarray, " m"] | Bool[np.ndarray, " n"]) -> "_Steps":
        return _Steps(*(part[chosen] for part in self))


def find_jumps(
    robots: Sequence[Robot],
    solved: Sequence[Solved],
    loads: Float[np.ndarray, "loads channels"],
    source: Int[np.ndarray, " loads"],
    tolerance: float,
    lanes: int | None,
) -> list[Bool[np.ndarray, " loads"]]:
    """For each robot, whether it jumped on the way to each load from its parent."""
    found = [np.zeros(len(loads), dtype=bool) for _ in robots]
    if not np.any(source >= 0):
        return found
    limits = (tolerance, UNDO_ITERATIONS, lanes)
    factors = [np.linalg.cholesky(metric) for _, metric in solved]
    places, doubtful = [], []
    for number, (path, _) in enumerate(solved):
        converged = np.asarray(path.converged)
        to = np.flatnonzero((source >= 0) & converged & converged[source])
        steps = _steps(number, path, factors[number], loads, source[to], to)
        chosen = np.asarray(path.bumps)[to] | (_deviation(steps) > 0)
        places += [(number, load) for load in to[chosen].tolist()]
        doubtful.append(steps.of(chosen))
    if not places:
        return found
    steps = _Steps(*(np.concatenate(parts) for parts in zip(*doubtful, strict=True)))

    undone, reached, _ = _solve(robots, factors, steps, steps.low, steps.right, limits)
    jumped = ~undone | (_length(reached - steps.left) > 1e-5 * _length(steps.left) + 1e-9)
    going = np.flatnonzero(~jumped)
    steps = steps.of(going)
    first = _length(steps.right - steps.left)
    for _ in range(HALVINGS):
        middle = 0.5 * (steps.low + steps.high)
        fine, between, tangent = _solve(robots, factors, steps, middle, steps.left, limits)
        jumped[going[~fine]] = True  # nothing found between: there is no smooth way
        tangent, leaving, arriving = 0.5 * tangent, 0.5 * steps.leaving, 0.5 * steps.arriving
        lower = steps._replace(high=middle, right=between, leaving=leaving, arriving=tangent)
        upper = steps._replace(low=middle, left=between, leaving=tangent, arriving=arriving)
        below = _deviation(lower) > _deviation(upper)
        steps = _Steps(*(np.where(_column(below, a), a, b) for a, b in zip(lower, upper, strict=True)))
        open_ = fine & (_deviation(steps) > 0)
        going, steps, first = going[open_], steps.of(open_), first[open_]
    jumped[going] |= _length(steps.right - steps.left) > first / 8
    for (number, load), jump in zip(places, jumped, strict=True):
        found[number][load] = jump
    return found


def _steps(
    number: int,
    path: ContinuationState,
    factor: Float[np.ndarray, "dofs dofs"],
    loads: Float[np.ndarray, "loads channels"],
    start: Int[np.ndarray, " n"],
    end: Int[np.ndarray, " n"],
) -> _Steps:
    """Steps between equilibria of a path."""
    change = loads[end] - loads[start]
    poses = np.asarray(path.found) @ factor
    leaving, arriving = (_tangents(path, at, change) @ factor for at in (start, end))
    return _Steps(
        np.full(len(end), number), loads[start], loads[end], poses[start], poses[end], leaving, arriving
    )


def _tangents(
    path: ContinuationState, at: Int[np.ndarray, " n"], change: Float[np.ndarray, "n channels"]
) -> Float[np.ndarray, "n dofs"]:
    """dq = −(∇²Π)⁻¹ ∂∇Π/∂u du at some equilibria of a path."""
    force = np.sum(change[:, :, None] * path.load_gradients[at], axis=1)
    return -np.linalg.solve(path.hessians[at], force[:, :, None])[..., 0]


def _deviation(steps: _Steps) -> Float[np.ndarray, " n"]:
    """How much further than allowed a step lies from the segment between its two tangents.

    A smooth one lies near it, also where contacts open or close on the way and the tangent jumps.
    """
    moved, span = steps.right - steps.left, steps.arriving - steps.leaving
    along = np.sum((moved - steps.leaving) * span, axis=1) / np.maximum(np.sum(span**2, axis=1), 1e-300)
    nearest = steps.leaving + np.clip(along, 0, 1)[:, None] * span
    largest = np.maximum(_length(steps.leaving), _length(steps.arriving))
    relative, absolute = DEVIATION
    return _length(moved - nearest) - relative * largest - absolute * _length(steps.right)


def _solve(
    robots: Sequence[Robot],
    factors: Sequence[Float[np.ndarray, "dofs dofs"]],
    steps: _Steps,
    loads: Float[np.ndarray, "n channels"],
    starts: Float[np.ndarray, "n dofs"],
    limits: tuple[float, int, int | None],
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, "n dofs"], Float[np.ndarray, "n dofs"]]:
    """One load in each step, from a pose: success, the equilibrium, and its tangent over the whole step."""
    converged, poses, tangents = np.zeros(len(loads), dtype=bool), starts.copy(), np.zeros_like(starts)
    groups = [np.flatnonzero(steps.number == number) for number in np.unique(steps.number)]
    jobs = []
    for own in groups:
        number = int(steps.number[own[0]])
        q = np.linalg.solve(factors[number].T, starts[own].T).T
        jobs.append(ContinuationProblem(robots[number], loads[own], np.full(len(own), -1), q))
    for own, (path, _) in zip(groups, solve_paths(jobs, *limits) if jobs else [], strict=True):
        factor = factors[int(steps.number[own[0]])]
        converged[own], poses[own] = path.converged, path.found @ factor
        good = np.flatnonzero(path.converged)
        change = (steps.high - steps.low)[own[good]]
        tangents[own[good]] = _tangents(path, good, change) @ factor
    return converged, poses, tangents


def _length(x: Float[np.ndarray, "n dofs"]) -> Float[np.ndarray, " n"]:
    return np.linalg.norm(x, axis=1)


def _column(chosen: Bool[np.ndarray, " n"], like: np.ndarray) -> np.ndarray:
    return chosen.reshape(-1, *(1,) * (like.ndim - 1))
