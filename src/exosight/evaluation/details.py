"""More on how far estimates are off: explained variance, contact or none, rare errors, the way back."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int8

from exosight.errors import InputError
from exosight.evaluation.metrics import CONTACTS, score, spread
from exosight.evaluation.tables import Cell, Column, Table

TOUCHING = 1e-3
"""A contact counts as touching from this true force on [N]: a hundredth of a typical one."""
CERTAIN = 0.5
"""It is said to touch above this probability [-]."""


@dataclass(frozen=True)
class Detail:
    """One contact; NaN marks a quantity that is undefined."""

    name: str
    r2: float
    """1 − mean squared error / variance of the true force [-]; NaN where that never varies."""
    f1: float
    """2 hits / (2 hits + misses + false alarms) of touching [-]; NaN if it neither touches nor is said to."""
    p95: float
    """95 % of the absolute errors are smaller [N]."""
    largest: float
    """Largest absolute error [N]."""
    rmse_loading: float
    """RMSE while the actuation rises [N]; NaN if it never does."""
    rmse_unloading: float
    """RMSE while it falls [N]; NaN if it never does."""


def evaluate_details(
    true: Float[np.ndarray, "frames 7"],
    estimated: Float[np.ndarray, "frames 7"],
    contact: Float[np.ndarray, "frames 7"],
    loading: Int8[np.ndarray, " frames"],
) -> tuple[Detail, ...]:
    """Compare estimated with true forces, contact by contact.

    true, estimated  on C1…C7 [N]
    contact          probability that each touches [-]
    loading          +1 while the actuation rises, −1 while it falls

    Raises InputError where `score` does, or for a probability outside 0…1.
    """
    score(true, estimated)  # what it refuses is refused here
    if not np.all((contact >= 0) & (contact <= 1)):
        raise InputError("contact: expected probabilities within 0…1")
    return tuple(
        _detail(name, true[:, i], estimated[:, i], contact[:, i], loading) for i, name in enumerate(CONTACTS)
    )


def detail_table(name: str, caption: str, found: tuple[Detail, ...]) -> Table:
    """Return all of them, one row a contact, with means over the contacts."""
    columns = (
        Column("contact"),
        Column("R²", digits=3),
        Column("contact F1", digits=3),
        Column("95th percentile", "N", "absolute error", 4),
        Column("largest", "N", "absolute error", 3),
        Column("loading", "N", "RMSE", 4),
        Column("unloading", "N", "RMSE", 4),
    )
    rows: list[tuple[Cell, ...]] = [
        (d.name, d.r2, d.f1, d.p95, d.largest, d.rmse_loading, d.rmse_unloading) for d in found
    ]
    fields = ("r2", "f1", "p95", "largest", "rmse_loading", "rmse_unloading")
    rows.append(("mean", *(spread([getattr(d, field) for d in found]).mean for field in fields)))
    note = (
        f"A contact touches from a true force of {1000 * TOUCHING:g} mN on, and is said to touch above a "
        f"probability of {CERTAIN:g}. Means are over the contacts where a number is defined."
    )
    return Table(name, caption, columns, tuple(rows), note)


def _detail(
    name: str,
    true: Float[np.ndarray, " frames"],
    estimated: Float[np.ndarray, " frames"],
    contact: Float[np.ndarray, " frames"],
    loading: Int8[np.ndarray, " frames"],
) -> Detail:
    error = estimated.astype(np.float64) - true
    variance = float(np.var(true.astype(np.float64)))
    return Detail(
        name=name,
        r2=1 - float(np.mean(error**2)) / variance if np.ptp(true) > 0 else math.nan,
        f1=_f1(true >= TOUCHING, contact > CERTAIN),
        p95=float(np.quantile(np.abs(error), 0.95)),
        largest=float(np.abs(error).max()),
        rmse_loading=_rms(error[loading > 0]),
        rmse_unloading=_rms(error[loading < 0]),
    )


def _f1(touches: Bool[np.ndarray, " frames"], said: Bool[np.ndarray, " frames"]) -> float:
    hits, all_told = int(np.sum(touches & said)), int(touches.sum() + said.sum())
    return 2 * hits / all_told if all_told else math.nan


def _rms(error: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(error**2))) if len(error) else math.nan
