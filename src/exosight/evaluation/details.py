"""More on how far estimates are off: chance in r, explained variance, contact or none, rare errors."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int8, Int32

from exosight.errors import InputError
from exosight.evaluation.metrics import score, spread
from exosight.evaluation.naming import common_unit, kind, row_name
from exosight.evaluation.tables import Cell, Column, Table
from exosight.system.schema import Schema, SensorSpec

TOUCHING = 1e-3
"""A contact counts as touching from this true force on [N]: a hundredth of a typical one."""
CERTAIN = 0.5
"""It is said to touch above this probability [-]."""
LIKELY = 0.95
"""Share of the draws of designs whose r lies between `r_low` and `r_high`."""

_DRAWS = 2000


def touching_shares(schema: Schema, readings: Float[np.ndarray, "frames sensors"]) -> dict[str, float]:
    """Share of the frames in which each estimated contact force is at least 1 mN, by sensor."""
    return {
        spec.name: float(np.mean(readings[:, place] >= TOUCHING))
        for place, spec in enumerate(schema.sensors)
        if spec.estimated and spec.quantity == "contact force"
    }


@dataclass(frozen=True)
class Detail:
    """One output; NaN marks a quantity that is undefined."""

    name: str
    r_low: float
    """Pearson's r by the choice of designs: 2.5 % of their draws have less [-]; NaN where undefined."""
    r_high: float
    """97.5 % of them have less [-]."""
    r2: float
    """1 − mean squared error / variance of the true value [-]; NaN where that never varies."""
    f1: float
    """2 hits / (2 hits + misses + false alarms) of touching [-]; NaN if it neither touches nor is said to, or
    is not a force."""
    p95: float
    """95 % of the absolute errors are smaller [the output's unit]."""
    largest: float
    """Largest absolute error [its unit]."""
    rmse_loading: float
    """RMSE while the command rises [its unit]; NaN if it never does."""
    rmse_unloading: float
    """RMSE while it falls [its unit]; NaN if it never does."""


def evaluate_details(
    schema: Schema,
    true: Float[np.ndarray, "frames outputs"],
    estimated: Float[np.ndarray, "frames outputs"],
    contact: Float[np.ndarray, "frames outputs"],
    direction: Int8[np.ndarray, " frames"],
    design: Int32[np.ndarray, " frames"],
) -> tuple[Detail, ...]:
    """Compare estimated with true sensors, output by output.

    true, estimated  [the outputs' units]
    contact          probability that each touches [-]
    direction        +1 while the command rises, −1 while it falls, 0 where there is no such thing
    design           number of the design

    Raises InputError where `score` does, or for a probability outside 0…1.
    """
    score(schema, true, estimated)  # what it refuses is refused here
    if not np.all((contact >= 0) & (contact <= 1)):
        raise InputError("contact: expected probabilities within 0…1")
    low, high = resampled_r(true, estimated, design)
    r_limits = zip(low.tolist(), high.tolist(), strict=True)
    return tuple(
        _detail(sensor, true[:, i], estimated[:, i], contact[:, i], direction, limits)
        for i, (sensor, limits) in enumerate(zip(schema.estimated, r_limits, strict=True))
    )


def resampled_r(
    true: Float[np.ndarray, "frames n"],
    estimated: Float[np.ndarray, "frames n"],
    design: Int32[np.ndarray, " frames"],
    seed: int = 0,
) -> Float64[np.ndarray, "2 n"]:
    """Between what Pearson's r of each column lies in 95 % of draws of as many designs, with replacement.

    Whole designs are drawn (bootstrap of clusters), as frames of one are much alike. Draws in which r is not
    defined do not count; NaN where it never is.

    Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section 13.3 (percentile interval).
    """
    x, y = (values - values.mean(axis=0, dtype=np.float64) for values in (true, estimated))
    _, of = np.unique(design, return_inverse=True)
    designs = int(of.max()) + 1
    sums = np.zeros((designs, 6, x.shape[1]))
    np.add.at(sums, of, np.stack([np.ones_like(x), x, y, x * x, y * y, x * y], axis=1))
    drawn = np.random.default_rng(seed).multinomial(designs, np.full(designs, 1 / designs), size=_DRAWS)
    n, sx, sy, sxx, syy, sxy = np.moveaxis(np.tensordot(drawn, sums, axes=1), 1, 0)
    vx, vy = n * sxx - sx * sx, n * syy - sy * sy
    defined = (vx > 1e-9 * n * sxx) & (vy > 1e-9 * n * syy)  # what a constant has is round-off
    r = np.where(defined, n * sxy - sx * sy, np.nan) / np.sqrt(np.where(defined, vx * vy, 1.0))
    found = np.full((2, x.shape[1]), np.nan)
    some = ~np.isnan(r).all(axis=0)
    found[:, some] = np.nanquantile(r[:, some], [(1 - LIKELY) / 2, (1 + LIKELY) / 2], axis=0)
    return np.clip(found, -1.0, 1.0)


def detail_table(name: str, caption: str, schema: Schema, found: tuple[Detail, ...]) -> Table:
    """Return all of them, one row an output, with means over the outputs.

    Loading and unloading are left out where no frame has a direction.
    """
    unit = common_unit(schema)
    directed = any(not math.isnan(value) for d in found for value in (d.rmse_loading, d.rmse_unloading))
    metrics = ("r_low", "r_high", "r2", "f1", "p95", "largest", "rmse_loading", "rmse_unloading")
    fields = metrics if directed else metrics[:-2]
    columns = (
        Column(kind(schema)),
        Column("from", group="r, 95 %", digits=3),
        Column("to", group="r, 95 %", digits=3),
        Column("R²", digits=3),
        Column("contact F1", digits=3),
        Column("95th percentile", unit, "absolute error", 4),
        Column("largest", unit, "absolute error", 3),
        Column("loading", unit, "RMSE", 4),
        Column("unloading", unit, "RMSE", 4),
    )[: 1 + len(fields)]
    rows: list[tuple[Cell, ...]] = [
        (row_name(schema, d.name), *(getattr(d, field) for field in fields)) for d in found
    ]
    averaged = fields if unit else ("r_low", "r_high", "r2", "f1")
    means = {field: spread([getattr(d, field) for d in found]).mean for field in averaged}
    rows.append(("mean", *(means.get(field) for field in fields)))
    note = (
        f"Of {_DRAWS} draws of as many designs, with replacement, {100 * LIKELY:g} % have an r within the "
        f"first two numbers. A contact touches from a true force of {1000 * TOUCHING:g} mN on, and is said "
        f"to touch above a probability of {CERTAIN:g}. Means are over the {kind(schema)}s where a number is "
        "defined."
    )
    return Table(name, caption, columns, tuple(rows), note)


def _detail(
    sensor: SensorSpec,
    true: Float[np.ndarray, " frames"],
    estimated: Float[np.ndarray, " frames"],
    contact: Float[np.ndarray, " frames"],
    direction: Int8[np.ndarray, " frames"],
    r_limits: tuple[float, float],
) -> Detail:
    is_force = not sensor.signed
    error = estimated.astype(np.float64) - true
    variance = float(np.var(true.astype(np.float64)))
    return Detail(
        name=sensor.name,
        r_low=r_limits[0],
        r_high=r_limits[1],
        r2=1 - float(np.mean(error**2)) / variance if np.ptp(true) > 0 else math.nan,
        f1=_f1(true >= TOUCHING, contact > CERTAIN) if is_force else math.nan,
        p95=float(np.quantile(np.abs(error), 0.95)),
        largest=float(np.abs(error).max()),
        rmse_loading=_rms(error[direction > 0]),
        rmse_unloading=_rms(error[direction < 0]),
    )


def _f1(touches: Bool[np.ndarray, " frames"], said: Bool[np.ndarray, " frames"]) -> float:
    hits, all_told = int(np.sum(touches & said)), int(touches.sum() + said.sum())
    return 2 * hits / all_told if all_told else math.nan


def _rms(error: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(error**2))) if len(error) else math.nan
