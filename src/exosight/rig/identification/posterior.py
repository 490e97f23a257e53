"""What is known of a rig after its pictures: intervals, what stays open, what a further one would tell.

Near its most likely value the whitened unknowns x are Gaussian (Laplace's approximation) with covariance

    C = (Jᵀ J / τσ² + Gᵀ G + 1)⁻¹,

J and G the derivatives of outlines and of readings over their errors. Neighbouring points of an outline err
alike; τ, how many times the variance of means of neighbouring residuals exceeds that of means of independent
ones, makes the points count as the fewer that they are worth. What all pictures misplace alike is added to C
(`shared_errors`).

A further picture is worth ½ log det(1 + J' C J'ᵀ / τσ²), the expected gain of information about x [nats]
(D. V. Lindley, On a measure of the information provided by an experiment, 1956, doi 10.1214/aoms/1177728069).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.errors import DataError
from exosight.rig.identification.fit import (
    HUBER,
    SMALLEST_NOISE,
    Fit,
    Problem,
    Rows,
    information,
    weights,
)
from exosight.rig.identification.misfit import filled
from exosight.rig.identification.predicted import predicted_outline
from exosight.rig.identification.response import at_rest, relaxed
from exosight.rig.identification.shared_errors import shared_errors

NORMAL_95 = 1.959963984540054
OPEN = 0.7
"""Deviation along a direction, in those of the prior, from which the data count as silent on it."""
SHOWN = 0.2
"""Smallest share in such a direction, of the largest one, that is named."""
BLOCK = 25
"""Neighbouring points of an outline whose errors are averaged."""


@dataclass(frozen=True)
class Estimate:
    """A parameter: its most likely number, the ends of its 95 % interval, and of the prior's [unit]."""

    entry: str
    unit: str
    value: float
    low: float
    high: float
    prior_low: float
    prior_high: float
    share: float
    """deviation of the posterior in those of the prior"""


@dataclass(frozen=True)
class OpenDirection:
    """Entries that may change together without a trace in the data.

    share    deviation along it, in those of the prior
    change   of each entry for one deviation: a factor of sizes, else a difference [in the unit]
    """

    share: float
    change: dict[str, float]


def correlation(rows: Rows) -> float:
    """τ of the residuals: the variance of means of BLOCK neighbours over that of as many independent points.

    At least 1.
    """
    size = HUBER * 1.4826 * np.median(np.abs(rows.outline))
    residuals = np.clip(rows.outline, -size, size)
    ends = np.flatnonzero(np.diff(rows.run)) + 1
    means = [
        np.mean(block)
        for stretch in np.split(residuals, ends)
        for block in np.split(stretch[: len(stretch) // BLOCK * BLOCK], len(stretch) // BLOCK or 1)
        if len(block) == BLOCK
    ]
    power = float(np.mean(residuals**2))
    if not means or power == 0:
        return 1.0
    return max(1.0, BLOCK * float(np.mean(np.square(means))) / power)


@dataclass(frozen=True)
class Posterior:
    """x and its covariance.

    x             (unknowns,)            most likely, in deviations of the prior
    covariance    (unknowns, unknowns)
    independent   (unknowns, unknowns)   C, without the errors that pictures share
    noise         σ of the outline [pixels]
    crowding      τ [-]
    """

    x: Float[np.ndarray, " unknowns"]
    covariance: Float[np.ndarray, "unknowns unknowns"]
    independent: Float[np.ndarray, "unknowns unknowns"]
    noise: float
    crowding: float


def posterior(problem: Problem, state: Fit) -> Posterior:
    """That of a finished search."""
    size = np.minimum(np.abs(state.rows.outline), HUBER * state.noise)
    noise = max(float(np.sqrt(np.mean(size**2))), SMALLEST_NOISE)
    tau = correlation(state.rows)
    sigma = noise * np.sqrt(tau)
    matrix, _ = information(state.rows, sigma)
    independent = np.linalg.inv(matrix + np.eye(len(state.x)))
    weight = weights(state.rows, sigma)
    errors = problem.prior.shared * shared_errors(problem, state)
    moves = independent @ (state.rows.slope.T @ (weight[:, None] * errors))
    return Posterior(state.x, independent + moves @ moves.T, independent, noise, tau)


def estimates(problem: Problem, known: Posterior) -> tuple[Estimate, ...]:
    """Every parameter with its 95 % interval."""
    found = []
    deviations = np.sqrt(np.diag(known.covariance))
    for i, each in enumerate(problem.model.parameters):
        x, half = float(known.x[i]), NORMAL_95 * float(deviations[i])
        value, low, high, prior_low, prior_high = (
            each.value(at) for at in (x, x - half, x + half, -NORMAL_95, NORMAL_95)
        )
        share = float(deviations[i])
        found.append(Estimate(each.entry, each.unit, value, low, high, prior_low, prior_high, share))
    return tuple(found)


def open_directions(problem: Problem, known: Posterior) -> tuple[OpenDirection, ...]:
    """Along which the posterior is about as wide as the prior, the widest first."""
    parameters = problem.model.parameters
    own = known.covariance[: len(parameters), : len(parameters)]
    variance, vectors = np.linalg.eigh(own)
    found = []
    for share, vector in zip(np.sqrt(variance[::-1]), vectors.T[::-1], strict=True):
        if share < OPEN:
            break
        vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
        named = np.flatnonzero(np.abs(vector) >= SHOWN * np.abs(vector).max())
        change = {}
        for i in named:
            move = parameters[i].deviation * share * float(vector[i])
            change[parameters[i].entry] = float(np.exp(move)) if parameters[i].size else move
        found.append(OpenDirection(float(share), change))
    return tuple(found)


def information_gains(
    problem: Problem, known: Posterior, commands: Float[np.ndarray, "candidates channels"]
) -> Float[np.ndarray, " candidates"]:
    """What one more picture at each command, approached from rest, would tell [nats]; NaN without a pose."""
    own = known.x[: len(problem.model.parameters)]
    numbers, slopes = problem.numbers(known.x), problem.model.slopes(own)
    camera = problem.model.camera(own)
    rest = np.tile(at_rest(numbers.system), (len(commands), 1))
    q, stable = relaxed(numbers.system, commands, rest, np.zeros_like(commands))
    gains = np.full(len(commands), np.nan)
    factor = np.linalg.cholesky(known.independent)
    for k in np.flatnonzero(stable):
        try:
            picture = filled(predicted_outline(numbers.system, q[k], camera))
        except DataError:  # out of the picture there
            continue
        _, by_x, _, _ = problem.seen(known.x, numbers, slopes, picture, commands[k], q[k])
        seen = by_x @ factor / (known.noise * np.sqrt(known.crowding))
        gains[k] = 0.5 * np.linalg.slogdet(np.eye(len(known.x)) + seen.T @ seen)[1]
    return gains
