"""How far estimated sensors are from the true ones: RMSE, RMS% of range and Pearson's r."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.evaluation.naming import sums, with_sums
from exosight.system.schema import Schema


@dataclass(frozen=True)
class SensorMetrics:
    """Agreement of one estimated sensor with the true one; NaN marks a quantity that is undefined.

    Where the true value never varies there is no range and no correlation: `rms_percent` and `r` are NaN.
    Where only the estimate never varies, `r` alone is NaN.
    """

    name: str
    unit: str
    rmse: float
    """Root mean square error [unit]."""
    rms_percent: float
    """RMSE as a share of the range of the true value [%], or NaN."""
    r: float
    """Pearson's correlation [-], or NaN."""
    largest_true: float
    """Largest true value [unit]."""
    largest_estimated: float
    """Largest estimated value [unit]."""


@dataclass(frozen=True)
class Spread:
    """Mean ± sample standard deviation (n − 1, as MATLAB's `std`) over the values that are defined."""

    mean: float
    sd: float
    count: int
    """How many values were defined and so took part."""


@dataclass(frozen=True)
class Scores:
    """Metrics of the estimated sensors of a schema, and of their sums, over one set of frames."""

    schema: Schema
    frames: int
    outputs: tuple[SensorMetrics, ...]
    sums: tuple[SensorMetrics, ...]

    @property
    def rmse(self) -> Spread:
        """Mean RMSE of the estimated sensors [their unit]; undefined where their units differ."""
        one_unit = len({output.unit for output in self.outputs}) == 1
        return spread([output.rmse for output in self.outputs] if one_unit else [])

    @property
    def rms_percent(self) -> Spread:
        """Mean RMS% of the estimated sensors [%], without those whose true value never varies."""
        return spread([output.rms_percent for output in self.outputs])

    @property
    def r(self) -> Spread:
        """Mean Pearson correlation of the estimated sensors [-], without those where it is undefined."""
        return spread([output.r for output in self.outputs])


def score(schema: Schema, true: Float[np.ndarray, "..."], estimated: Float[np.ndarray, "..."]) -> Scores:
    """Compare estimated with true sensors: RMSE, RMSE / range(true) and Pearson's r (paper, section II-F).

    true       (frames, outputs)   what the estimated sensors of the schema read [their units]
    estimated  (frames, outputs)   the estimator's answer for the same frames [their units]

    Raises InputError for another shape, no frames, or a number that is not finite.
    """
    true, estimated = _checked("true", schema, true), _checked("estimated", schema, estimated)
    if len(true) != len(estimated):
        raise InputError(
            f"scores: expected as many estimated as true frames, got {len(estimated)} and {len(true)}; "
            "pass the estimates of these very frames"
        )
    names = (*schema.outputs, *sums(schema))
    columns = zip(names, with_sums(schema, true).T, with_sums(schema, estimated).T, strict=True)
    found = tuple(_compare(name, schema.sensor(name).unit, t, e) for name, t, e in columns)
    count = len(schema.outputs)
    return Scores(schema, len(true), found[:count], found[count:])


def spread(values: Sequence[float]) -> Spread:
    """Mean and sample standard deviation of the defined values; NaN where too few (0 and 1) are defined."""
    defined = np.array([value for value in values if not math.isnan(value)])
    return Spread(
        mean=float(defined.mean()) if len(defined) > 0 else math.nan,
        sd=float(defined.std(ddof=1)) if len(defined) > 1 else math.nan,
        count=len(defined),
    )


def finite_or_none(value: float | int) -> float | int | None:
    """Return the number, or None for NaN and infinity: JSON has neither, and None cannot pass for a "
    "number."""
    return value if math.isfinite(value) else None


def _compare(
    name: str, unit: str, true: Float[np.ndarray, " n"], estimated: Float[np.ndarray, " n"]
) -> SensorMetrics:
    rmse = float(np.sqrt(np.mean((estimated - true) ** 2)))
    true_range = float(np.ptp(true))
    return SensorMetrics(
        name=name,
        unit=unit,
        rmse=rmse,
        rms_percent=100 * rmse / true_range if true_range > 0 else math.nan,
        r=_pearson(true, estimated),
        largest_true=float(true.max()),
        largest_estimated=float(estimated.max()),
    )


def _pearson(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    # Tested on the range, not on the variance: rounding of the mean gives a constant a variance above zero.
    if np.ptp(a) == 0 or np.ptp(b) == 0:
        return math.nan
    a, b = a - a.mean(), b - b.mean()
    # Scaled to 1 first, so that no square under- or overflows whatever the unit.
    a, b = a / np.abs(a).max(), b / np.abs(b).max()
    return float(np.clip(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)), -1, 1))


def _checked(
    name: str, schema: Schema, values: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "frames outputs"]:
    outputs = schema.outputs
    if values.ndim != 2 or values.shape[1] != len(outputs) or len(values) == 0:
        raise InputError(
            f"{name} values: expected shape (frames, {len(outputs)}) with at least one frame, got "
            f"{values.shape}; pass one column for each of {', '.join(outputs)}"
        )
    if not np.isfinite(values).all():
        frame = int(np.nonzero(~np.isfinite(values).all(axis=1))[0][0])
        raise InputError(
            f"{name} values: expected finite numbers, got {values[frame].tolist()} in frame {frame}; "
            "drop frames without a label and check the estimator"
        )
    return values.astype(np.float64)
