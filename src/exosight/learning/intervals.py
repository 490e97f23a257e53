"""Intervals around estimated forces that hold what they promise: split conformal prediction.

Each contact's error, in units of the error that the network itself expects there, is sorted over frames that
took no part in training; its quantile at a level is how many such units an interval of that level takes.
Frames whose estimate is zero have quantiles of their own, or else the many that are right about no contact
would make the intervals of the others too narrow.

Source: Lei et al., Distribution-free predictive inference for regression, doi 10.1080/01621459.2017.1307116
(locally weighted); groups as in Vovk et al., Mondrian confidence machine.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError

LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99)
"""Shares of frames whose true force an interval may be asked to hold."""

Forces = Float[np.ndarray, "frames 7"]


@dataclass(frozen=True)
class Widths:
    """Half widths of intervals in units of the expected error, (levels, contacts)."""

    estimated_zero: tuple[tuple[float, ...], ...]
    """where the estimate is zero"""
    estimated_force: tuple[tuple[float, ...], ...]
    """where it is not"""


def calibrate_intervals(forces: Forces, expected_error: Forces, truth: Forces) -> Widths:
    """The widths that held on frames not learned from, with the correction for how few these are.

    forces, expected_error   a network's answers [N]
    truth                    [N]
    """
    units = np.abs(forces - truth) / expected_error
    groups = (forces == 0), (forces > 0)
    zero, force = (
        tuple(tuple(_quantile(units[g[:, i], i], level) for i in range(forces.shape[1])) for level in LEVELS)
        for g in groups
    )
    return Widths(zero, force)


def interval(widths: Widths, level: float, forces: Forces, expected_error: Forces) -> tuple[Forces, Forces]:
    """Lower and upper ends [N], never below zero.

    Raises InputError for a level that is none of LEVELS.
    """
    if level not in LEVELS:
        raise InputError(f"level: expected one of {', '.join(map(str, LEVELS))}, got {level}")
    zero, force = (
        np.array(w[LEVELS.index(level)], np.float32) for w in (widths.estimated_zero, widths.estimated_force)
    )
    half = np.where(forces > 0, force, zero) * expected_error
    return np.maximum(forces - half, 0).astype(np.float32), (forces + half).astype(np.float32)


def _quantile(units: Float[np.ndarray, " n"], level: float) -> float:
    """The ⌈(n + 1) level⌉-th smallest, or the largest where there are too few; 0 where there are none."""
    if not len(units):
        return 0.0
    rank = min(int(np.ceil((len(units) + 1) * level)), len(units))
    return float(np.sort(units)[rank - 1])
