"""Coverage of prediction intervals: the share of true values inside, and their width."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from exosight.errors import InputError
from exosight.evaluation.naming import common_unit, forces_only, kind, row_name
from exosight.evaluation.tables import Cell, Column, Table
from exosight.system.schema import Schema

Values = Float[np.ndarray, "..."]

GROUPS = ("all", "zero", "other")
"""All frames; those whose estimate is zero; those where it is not."""


@dataclass(frozen=True)
class Coverage:
    """Of the intervals of some levels, by output and GROUPS; NaN where a group has no frames."""

    schema: Schema
    levels: tuple[float, ...]
    """promised share [-]"""
    share: Float[np.ndarray, "levels outputs 3"]
    """of the frames whose true value is inside [-]"""
    width: Float[np.ndarray, "levels outputs 3"]
    """mean width [the outputs' units]"""

    @property
    def calibration_error(self) -> Float[np.ndarray, "outputs 3"]:
        """Mean over the levels of |share inside − promised share| [-]."""
        return np.abs(self.share - np.array(self.levels)[:, None, None]).mean(axis=0)

    def at(self, level: float) -> Float[np.ndarray, " outputs"]:
        """Share inside at one of the levels, over all frames, an output [-]."""
        return self.share[self.levels.index(level), :, 0]


def evaluate_intervals(
    schema: Schema, true: Values, estimated: Values, intervals: Mapping[float, tuple[Values, Values]]
) -> Coverage:
    """Count how often intervals hold the true value.

    schema            of the system whose sensors are estimated
    true, estimated   (frames, outputs)   [their units]
    intervals         promised share → lower and upper ends, (frames, outputs) each

    Raises InputError if shapes differ, or there are no frames or levels.
    """
    shapes = {true.shape, estimated.shape, *(end.shape for ends in intervals.values() for end in ends)}
    if len(shapes) > 1 or not len(true) or not intervals:
        raise InputError(
            f"intervals: expected levels with one lower and one upper end a true value, got {len(intervals)} "
            f"levels and shapes {sorted(shapes)}"
        )
    groups = (np.ones(true.shape, dtype=bool), estimated == 0, estimated != 0)
    share, width = (
        np.array([[_means(values(*ends), group) for group in groups] for ends in intervals.values()])
        for values in (
            lambda low, high: (low <= true) & (true <= high),
            lambda low, high: high - low,
        )
    )
    return Coverage(schema, tuple(intervals), share.transpose(0, 2, 1), width.transpose(0, 2, 1))


def interval_table(name: str, caption: str, found: Coverage) -> Table:
    """Return coverage and mean width, a row for each output and level."""
    unit, above = common_unit(found.schema), _above(found.schema)
    columns = (
        Column(kind(found.schema)),
        Column("promised", "%", digits=0),
        *(Column(words, "%", "inside", 1) for words in ("all frames", "estimate zero", above)),
        *(Column(words, unit, "mean width", 4) for words in ("estimate zero", above)),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            row_name(found.schema, output),
            100 * level,
            *(100 * found.share[k, i]).tolist(),
            *found.width[k, i, 1:].tolist(),
        )
        for i, output in enumerate(found.schema.outputs)
        for k, level in enumerate(found.levels)
    ]
    return Table(name, caption, columns, tuple(rows), "A dash: no frame has such an estimate.")


def calibration_table(name: str, caption: str, found: Coverage) -> Table:
    """Return the calibration error, a row an output, with means over them."""
    schema = found.schema
    columns = (
        Column(kind(schema)),
        *(Column(words, "%", digits=2) for words in ("all frames", "estimate zero", _above(schema))),
    )
    error = 100 * found.calibration_error
    rows: list[tuple[Cell, ...]] = [
        (row_name(schema, output), *row) for output, row in zip(schema.outputs, error.tolist(), strict=True)
    ]
    defined = ~np.isnan(error)
    means = np.where(defined, error, 0).sum(axis=0) / np.maximum(defined.sum(axis=0), 1)
    rows.append(("mean", *np.where(defined.any(axis=0), means, np.nan).tolist()))
    levels = ", ".join(f"{100 * level:g}" for level in found.levels)
    note = f"Mean of |share inside − promised share| over intervals of {levels} %."
    note += " A force estimated as zero mostly is exactly zero: those intervals cover more than promised."
    return Table(name, caption, columns, tuple(rows), note)


def _above(schema: Schema) -> str:
    return "estimate above zero" if forces_only(schema) else "estimate not zero"


def _means(values: np.ndarray, group: Bool[np.ndarray, "frames outputs"]) -> Float[np.ndarray, " outputs"]:
    """Mean of each column over the frames of a group; NaN where there are none."""
    count = group.sum(axis=0)
    total = np.where(group, values, 0).sum(axis=0, dtype=np.float64)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
