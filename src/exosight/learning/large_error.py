"""The probability that an estimate is far off, by logistic regression; without PyTorch.

An OOD score says that an image is unusual, not that its estimate is wrong, and a network's expected error
does not hold for images unlike the training data. Together, calibrated on images of both kinds, they give one
number that follows the error:

    P(e > limit) = σ(b + w₁ log(ê / limit) + w₂ log(max(s, 1)))

e is the error of a sum of estimated sensors, such as F_net (of a sensor where a system has no such sum), ê
the error that the network expects, s the OOD score as a share of its limit. Of several sums the largest share
of its limit counts.

Source: Hendrycks and Gimpel, A baseline for detecting misclassified and out-of-distribution examples,
arXiv 1610.02136; calibration as in Platt, Probabilistic outputs for support vector machines, 1999.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float, Float64
from pydantic import Field

from exosight.system.schema import Schema

SHARE = 0.2
"""Error that counts as large, as a share of the standard deviation of what is estimated."""

LIKELY = 0.5
"""Probability of a large error above which an estimate is flagged."""

NOT_SHOWN = "device not shown"
"""The cause of unusual images of other things: whatever is estimated from them is wrong."""

_STEPS = 50  # Newton's method takes some ten
_RIDGE = 1e-3  # of one frame: keeps the weights finite where all errors are small, or all large
_LEAST = 1e-9

Values = Float[np.ndarray, "frames outputs"]
Finite = Annotated[float, Field(ge=-1e6, le=1e6)]


@dataclass(frozen=True)
class LargeError:
    """What counts as a large error, and how probable it is.

    Raises ValueError unless each sensor has a limit above 0.
    """

    sensors: tuple[str, ...]
    """sums of estimated sensors, or the estimated sensors"""
    limits: tuple[float, ...]
    """of each, the error from which on it is large [its unit]"""
    bias: Finite
    error: Finite
    """weight of log(ê / limit)"""
    ood: Finite
    """weight of log(max(s, 1))"""

    def __post_init__(self) -> None:
        if not self.sensors or len(self.sensors) != len(self.limits):
            raise ValueError("large_error: expected a limit for each of its sensors, and a sensor at least")
        if not all(0 < limit < np.inf for limit in self.limits):
            raise ValueError("large_error: expected limits above 0")

    def describe(self, schema: Schema) -> str:
        """What is meant by a large error, such as "an error of F_net above 0.05 N"."""
        parts = [
            f"{name} above {limit:g} {schema.sensor(name).unit}".rstrip()
            for name, limit in zip(self.sensors, self.limits, strict=True)
        ]
        return "an error of " + " or ".join(parts)


def is_large(meant: LargeError, schema: Schema, values: Values, truth: Values) -> Bool[np.ndarray, " frames"]:
    """Whether the error of each frame is large."""
    weights = _weights(schema, meant.sensors)
    return np.max(np.abs((values - truth) @ weights) / np.array(meant.limits), axis=1) > 1


def error_probability(
    meant: LargeError, schema: Schema, expected_error: Values, ood_score: Float[np.ndarray, " frames"]
) -> Float64[np.ndarray, " frames"]:
    """Probability that the error of each frame is large.

    expected_error   that the network itself expects [the outputs' units]
    ood_score        as a share of its limit
    """
    given = _given(schema, meant.sensors, meant.limits, expected_error, ood_score)
    return _logistic(given @ np.array([meant.bias, meant.error, meant.ood]))


def fit_large_error(
    schema: Schema,
    usual: Float[np.ndarray, "n outputs"],
    values: Values,
    expected_error: Values,
    truth: Values,
    ood_score: Float[np.ndarray, " frames"],
    unrelated: tuple[Float[np.ndarray, "others outputs"], Float[np.ndarray, " others"]],
) -> LargeError:
    """From frames that were not learned from, as they are and disturbed, and images of other things.

    usual       (n, outputs)   true values that say how far what is estimated spreads [their units]
    unrelated   expected errors and OOD scores of images without the system, whose errors all count as large
    """
    sums = [s.name for s in schema.sensors if s.parts and s.name in schema.controllable]
    spread = {name: float(np.std(usual @ schema.weights(name))) for name in sums or schema.outputs}
    least = _LEAST + 0.01 * max(spread.values())
    limits = tuple(_round(SHARE * max(each, least)) for each in spread.values())
    meant = LargeError(tuple(spread), limits, 0.0, 0.0, 0.0)
    given = np.concatenate(
        [_given(schema, meant.sensors, limits, *each) for each in ((expected_error, ood_score), unrelated)]
    )
    large = np.append(is_large(meant, schema, values, truth), np.ones(len(unrelated[1]), bool))
    weights = _fit(given, large)
    return LargeError(meant.sensors, limits, *weights.tolist())


def _fit(given: Float64[np.ndarray, "frames 3"], large: Bool[np.ndarray, " frames"]) -> np.ndarray:
    """Logistic regression by Newton's method; the ridge draws all weights to 0."""
    weights = np.zeros(given.shape[1])
    for _ in range(_STEPS):
        found = _logistic(given @ weights)
        slope = given.T @ (found - large) + _RIDGE * weights
        curvature = (given * (found * (1 - found))[:, None]).T @ given + _RIDGE * np.eye(len(weights))
        step = np.linalg.solve(curvature, slope)
        # At most one unit at a time: far from the optimum the curvature vanishes.
        step /= max(1.0, float(np.abs(step).max()))
        weights -= step
        if np.abs(step).max() < 1e-10:
            break
    return weights


def _given(
    schema: Schema,
    sensors: tuple[str, ...],
    limits: tuple[float, ...],
    expected_error: Values,
    ood_score: Float[np.ndarray, " frames"],
) -> Float64[np.ndarray, "frames 3"]:
    share = (expected_error.astype(float) @ np.abs(_weights(schema, sensors)) / np.array(limits)).max(axis=1)
    return np.column_stack(
        [np.ones(len(share)), np.log(np.maximum(share, _LEAST)), np.log(np.maximum(ood_score, 1.0))]
    )


def _weights(schema: Schema, sensors: tuple[str, ...]) -> Float64[np.ndarray, "outputs sensors"]:
    return np.column_stack([schema.weights(name) for name in sensors])


def _logistic(x: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    return 1 / (1 + np.exp(-np.clip(x, -500, 500)))


def _round(value: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    steps = power * np.array([1.0, 2.0, 5.0, 10.0])
    return float(f"{steps[np.argmin(np.abs(np.log(steps / value)))]:.1g}")
