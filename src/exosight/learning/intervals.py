"""Intervals around estimates that hold what they promise: split conformal prediction.

Each output's error, in units of the error that the network itself expects there, is sorted over frames that
took no part in training; its quantile at a level is how many such units an interval of that level takes.
Frames whose estimate of a force is zero have quantiles of their own, or else the many that are right about no
contact would make the intervals of the others too narrow. Where either are too few for that, all count.

Source: Lei et al., Distribution-free predictive inference for regression, doi 10.1080/01621459.2017.1307116
(locally weighted); groups as in Vovk et al., Mondrian confidence machine.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from exosight.validation import check_name

LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99)
"""Shares of frames whose true value an interval may be asked to hold."""

FEW = 20
"""Frames below which those whose estimate is zero, or is not, have no quantiles of their own."""

Values = Float[np.ndarray, "frames outputs"]


@dataclass(frozen=True)
class Widths:
    """Half widths of intervals in units of the expected error, (levels, outputs)."""

    estimated_zero: tuple[tuple[float, ...], ...]
    """where the estimate of a force is zero"""
    estimated_force: tuple[tuple[float, ...], ...]
    """where it is not"""


def calibrate_intervals(
    values: Values, expected_error: Values, truth: Values, nonnegative: Bool[np.ndarray, " outputs"]
) -> Widths:
    """The widths that held on frames not learned from, with the correction for how few these are.

    values, expected_error   a network's answers [the outputs' units]
    truth                    likewise
    nonnegative              which outputs are forces
    """
    units = np.abs(values - truth) / expected_error
    zero = (values == 0) & nonnegative
    columns = range(values.shape[1])
    groups = (
        [units[g[:, i], i] if g[:, i].sum() >= FEW else units[:, i] for i in columns] for g in (zero, ~zero)
    )
    return Widths(
        *(tuple(tuple(_quantile(own, level) for own in group) for level in LEVELS) for group in groups)
    )


def interval(
    widths: Widths,
    level: float,
    values: Values,
    expected_error: Values,
    nonnegative: Bool[np.ndarray, " outputs"],
) -> tuple[Values, Values]:
    """Lower and upper ends [the outputs' units], of forces never below zero.

    Raises InputError for a level that is none of LEVELS.
    """
    check_name("level", level, LEVELS)
    zero, force = (
        np.array(w[LEVELS.index(level)], np.float32) for w in (widths.estimated_zero, widths.estimated_force)
    )
    half = np.where((values == 0) & nonnegative, zero, force) * expected_error
    low = np.maximum(values - half, np.where(nonnegative, np.float32(0), np.float32(-np.inf)))
    return low.astype(np.float32), (values + half).astype(np.float32)


def _quantile(units: Float[np.ndarray, " n"], level: float) -> float:
    """The ⌈(n + 1) level⌉-th smallest, or the largest where there are too few."""
    rank = min(int(np.ceil((len(units) + 1) * level)), len(units))
    return float(np.sort(units)[rank - 1])
