"""The most likely parameters of a rig: Levenberg–Marquardt on outlines and readings, with priors.

With the whitened unknowns x (parameters, then how far outside the outline of each tube is found), residuals r
of outlines [pixels], e of readings and noise σ the least

    ½ |x|² + Σ ρ(r/σ) + ½ Σ (e/σ_e)²

is looked for, where ρ is ½ t² up to |t| = HUBER and linear beyond, so that what is no outline counts little.
Pictures are taken one after another: each pose is reached from the one before by the system as it is known
so far, and from then on follows the parameters. σ is estimated with them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from exosight.errors import ConvergenceError, InputError
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.misfit import Picture, filled, outline_rows
from exosight.rig.identification.parameters import Prior
from exosight.rig.identification.predicted import predicted_outline
from exosight.rig.identification.response import (
    Model,
    Numbers,
    Response,
    at_rest,
    followed,
    relaxed,
    response,
)

HUBER = 4.0
SMALLEST_NOISE, LARGEST_NOISE = 0.02, 5.0
"""Limits of σ [pixels]."""
STEPS = 40
"""At most, with all pictures."""
EARLY_STEPS = 3
"""With a part of the pictures."""
MORE = 2.0
"""Times as many pictures are taken in before the next search."""
LITTLE = 0.005
"""A gain that ends a search: that of a tenth of a deviation of the posterior along one direction."""
MOST_DAMPED = 1e4
NOISE_CHANGE = 0.05
"""Of the logarithm of σ; a smaller one is not followed, so that steps are compared by one cost."""
LONGEST = 1.0
"""Longest step of a search, in deviations of the prior [root mean square over all unknowns]."""


@dataclass(frozen=True)
class Rows:
    """Residuals over their noise, with their derivatives.

    outline   (points,)             [pixels]
    run       (points,)             number of the stretch of outline, counted over all pictures
    slope     (points, unknowns)    [pixels]
    reading   (readings,)           over their own deviation
    gain      (readings, unknowns)
    """

    outline: Float[np.ndarray, " points"]
    run: np.ndarray
    slope: Float[np.ndarray, "points unknowns"]
    reading: Float[np.ndarray, " readings"]
    gain: Float[np.ndarray, "readings unknowns"]


@dataclass(frozen=True)
class Fit:
    """Where a search stands.

    x       (unknowns,)        parameters, then edge offsets, in deviations of the prior
    q       (pictures, dofs)   poses of the pictures so far
    noise   σ of the outline [pixels]
    rows    at x
    moves   (pictures, dofs, parameters)   dq/dx, by the parameters before the camera's
    """

    x: Float[np.ndarray, " unknowns"]
    q: Float[np.ndarray, "pictures dofs"]
    noise: float
    rows: Rows
    moves: Float[np.ndarray, "pictures dofs parameters"]


class Problem:
    """A model and what was measured."""

    def __init__(self, model: Model, measured: Measurements, prior: Prior) -> None:
        self.model, self.measured, self.prior = model, measured, prior
        self.nominal = model.nominal
        self.pictures = [filled(outline) for outline in measured.outlines]
        self.tubes = len(self.nominal.tubes)
        self.commands = np.asarray(measured.commands, float)
        names = [sensor.name for sensor in self.nominal.schema.sensors]
        missing = [name for name in measured.readings if name not in names]
        if missing:
            raise InputError(
                f"readings: expected sensors of the system, {', '.join(names)}, got {missing[0]}"
            )
        self.sensors = [(names.index(name), name) for name in measured.readings]
        sizes = np.cumsum([0, *(int(outline.run.max()) + 1 for outline in measured.outlines)])
        self.runs = [
            outline.run + first for outline, first in zip(measured.outlines, sizes[:-1], strict=True)
        ]

    @property
    def unknowns(self) -> int:
        """Parameters and edge offsets."""
        return len(self.model.parameters) + self.tubes

    def numbers(self, x: Float[np.ndarray, " unknowns"]) -> Numbers:
        """The rig at the unknowns; InputError where there is none."""
        return self.model.numbers(x[: len(self.model.parameters)])

    def linearised(
        self, x: Float[np.ndarray, " unknowns"], numbers: Numbers, q: Float[np.ndarray, "pictures dofs"]
    ) -> tuple[Rows, Float[np.ndarray, "pictures dofs parameters"]]:
        """Residuals and their derivatives, and dq/dx, at poses that are equilibria."""
        slopes = self.model.slopes(x[: len(self.model.parameters)])
        outline, gradient, reading, gain, moves = [], [], [], [], []
        for k in range(len(q)):
            found, by_x, value, slope = self.seen(
                x, numbers, slopes, self.pictures[k], self.commands[k], q[k]
            )
            outline.append(found)
            gradient.append(by_x)
            moves.append(np.asarray(slope.q))
            for i, name in self.sensors:
                measured, error = self.measured.readings[name][k], self.measured.error(name)
                if np.isfinite(measured):
                    reading.append((float(value.readings[i]) - measured) / error)
                    row = np.zeros(self.unknowns)
                    row[: slope.readings.shape[-1]] = np.asarray(slope.readings[i]) / error
                    gain.append(row)
        rows = Rows(
            np.concatenate(outline),
            np.concatenate(self.runs[: len(q)]),
            np.concatenate(gradient),
            np.array(reading),
            np.reshape(gain, (len(reading), self.unknowns)),
        )
        return rows, np.array(moves)

    def seen(
        self,
        x: Float[np.ndarray, " unknowns"],
        numbers: Numbers,
        slopes: Numbers,
        picture: Picture,
        command: Float[np.ndarray, " channels"],
        q: Float[np.ndarray, " dofs"],
    ) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points unknowns"], Response, Response]:
        """Distances of a picture's points from the outline of a pose [pixels], and their derivatives.

        The last two are the pose's own numbers and derivatives.

        numbers, slopes   at the unknowns
        """
        camera = self.nominal.camera
        value, slope = response(numbers.system, slopes.system, command, q)
        found, by_x = outline_rows(
            picture,
            value,
            slope,
            (numbers.view, slopes.view),
            self.prior.edge * x[len(self.model.parameters) :],
            self.prior.edge,
            (camera.width, camera.height),
            self.nominal.visibility == "stacked",
        )
        return found, by_x, value, slope


def fit(problem: Problem, done: Callable[[int], None] = lambda pictures: None) -> tuple[Fit, bool]:
    """The most likely parameters, and whether the search came to rest.

    done   called with the number of pictures taken in so far

    Raises ConvergenceError if no pose of the first picture is found.
    """
    x, q = _placed(problem)
    count, searched, noise = len(problem.pictures), 0, LARGEST_NOISE
    for k in range(1, count):
        if k >= MORE * searched:
            state, _ = search(problem, started(problem, x, q, noise), EARLY_STEPS)
            x, q, noise, searched = state.x, state.q, state.noise, k
        done(k)
        system = problem.numbers(x).system
        pose, stable = relaxed(system, problem.commands[k : k + 1], q[-1:], problem.commands[k - 1 : k])
        if not stable[0]:
            raise ConvergenceError(f"no stable pose at the command of picture {k + 1}; check the loads")
        q = np.concatenate([q, pose])
    found = search(problem, started(problem, x, q, noise), STEPS)
    done(count)
    return found


def refitted(problem: Problem, start: Fit) -> tuple[Fit, bool]:
    """The search once more from the poses that a path from rest leads to."""
    q, stable = followed(problem.numbers(start.x).system, problem.commands)
    if not stable.all():
        return start, False
    return search(problem, started(problem, start.x, q, start.noise), STEPS)


def _placed(
    problem: Problem,
) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, "1 dofs"]]:
    """The prior's middle, but the camera so that the first outline has the model's place and extent.

    Second, the pose of the first picture there, which no camera changes; ConvergenceError if there is none.
    """
    x = np.zeros(problem.unknowns)
    system = problem.nominal
    found = problem.measured.outlines[0].points
    pose, stable = relaxed(
        system, problem.commands[:1], at_rest(system)[None], np.zeros_like(problem.commands[:1])
    )
    if not stable[0]:
        raise ConvergenceError(
            "no stable pose at the first picture's command; check the loads and their unit"
        )
    model = predicted_outline(system, pose[0], system.camera).points
    camera = system.camera
    ratio = np.linalg.norm(found.std(axis=0)) / np.linalg.norm(model.std(axis=0))
    pixel = camera.metres_per_pixel / ratio
    middle = np.array([camera.width, camera.height]) / 2 + camera.principal
    ahead = (model.mean(axis=0) - middle) * camera.metres_per_pixel - (found.mean(axis=0) - middle) * pixel
    wanted = {
        "pixel": pixel,
        "centre.0": camera.centre[0] + ahead[0],
        "centre.1": camera.centre[1] - ahead[1],
    }
    for i, each in enumerate(problem.model.parameters):
        for name, value in wanted.items():
            if each.entry.startswith("cameras.") and each.entry.endswith(name):
                x[i] = each.x(value / each.metres)
    return x, pose


def started(
    problem: Problem, x: Float[np.ndarray, " unknowns"], q: Float[np.ndarray, "pictures dofs"], noise: float
) -> Fit:
    """Where a search begins: the unknowns x, the equilibria there, and σ [pixels]."""
    rows, moves = problem.linearised(x, problem.numbers(x), q)
    return Fit(x, q, noise, rows, moves)


def noise_of(rows: Rows) -> float:
    """σ of the outline, from the middle half of its residuals [pixels]."""
    return float(np.clip(1.4826 * np.median(np.abs(rows.outline)), SMALLEST_NOISE, LARGEST_NOISE))


def cost(state: Fit) -> float:
    """What is to be least."""
    size = np.abs(state.rows.outline) / state.noise
    rho = np.where(size <= HUBER, 0.5 * size**2, HUBER * size - 0.5 * HUBER**2)
    return float(0.5 * np.sum(state.x**2) + rho.sum() + 0.5 * np.sum(state.rows.reading**2))


def weights(rows: Rows, noise: float) -> Float[np.ndarray, " points"]:
    """Of the outline's residuals [1/pixel²], smaller beyond HUBER deviations."""
    return np.minimum(1.0, HUBER / np.maximum(np.abs(rows.outline) / noise, 1e-12)) / noise**2


def information(rows: Rows, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Newton matrix of the measurements, and the gradient of their cost."""
    weight = weights(rows, noise)
    matrix = rows.slope.T @ (weight[:, None] * rows.slope) + rows.gain.T @ rows.gain
    return matrix, rows.slope.T @ (weight * rows.outline) + rows.gain.T @ rows.reading


def search(problem: Problem, state: Fit, steps: int) -> tuple[Fit, bool]:
    """Levenberg–Marquardt from a state, until a step gains next to nothing.

    Poses have kinks where contacts begin, so steps may gain little before the gradient vanishes.
    """
    damping = 1e-3
    for _ in range(steps):
        noise = noise_of(state.rows)
        if abs(np.log(noise / state.noise)) > NOISE_CHANGE:
            state = replace(state, noise=noise)
        matrix, gradient = information(state.rows, state.noise)
        matrix, gradient = matrix + np.eye(len(state.x)), gradient + state.x
        before, trial = cost(state), None
        while damping < MOST_DAMPED:
            step = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient)
            size = np.sqrt(np.mean(step**2))
            trial = _tried(problem, state, step * min(1.0, LONGEST / max(size, 1e-12)))
            if trial is not None and cost(trial) <= before:
                break
            trial, damping = None, 10 * damping
        if trial is None:
            return state, True
        state, damping = trial, damping / 10
        if before - cost(state) < LITTLE:
            return state, True
    return state, False


def _tried(problem: Problem, state: Fit, step: Float[np.ndarray, " unknowns"]) -> Fit | None:
    """The state after a step; None where there is no system or no stable pose."""
    x = state.x + step
    try:
        numbers = problem.numbers(x)
    except InputError:
        return None
    ahead = state.moves @ step[: state.moves.shape[-1]]
    q, stable = relaxed(numbers.system, problem.commands[: len(state.q)], state.q + ahead)
    if not stable.all():
        return None
    rows, moves = problem.linearised(x, numbers, q)
    return Fit(x, q, state.noise, rows, moves)
