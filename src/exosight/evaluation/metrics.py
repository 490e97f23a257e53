"""How far estimated contact forces are from the true ones: RMSE, RMS% of range and Pearson's r."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from exosight.errors import InputError
from exosight.learning.samples import CONTACTS

NET_FORCE = "F_net"


@dataclass(frozen=True)
class ContactMetrics:
    """Agreement of one estimated force with the true one; NaN marks a quantity that is undefined.

    Where the true force never varies there is no range and no correlation: `rms_percent` and `r` are NaN.
    Where only the estimate never varies, `r` alone is NaN.
    """

    name: str
    rmse: float
    """Root mean square error [N]."""
    rms_percent: float
    """RMSE as a share of the range of the true force [%], or NaN."""
    r: float
    """Pearson's correlation [-], or NaN."""
    largest_true: float
    """Largest true force [N]."""
    largest_estimated: float
    """Largest estimated force [N]."""


@dataclass(frozen=True)
class Spread:
    """Mean ± sample standard deviation (n − 1, as MATLAB's `std`) over the values that are defined."""

    mean: float
    sd: float
    count: int
    """How many values were defined and so took part."""


@dataclass(frozen=True)
class Scores:
    """Metrics of C1…C7 and of their sum F_net over one set of frames."""

    frames: int
    contacts: tuple[ContactMetrics, ...]
    net: ContactMetrics

    @property
    def rmse(self) -> Spread:
        """Mean RMSE of the contacts [N]."""
        return spread([contact.rmse for contact in self.contacts])

    @property
    def rms_percent(self) -> Spread:
        """Mean RMS% of the contacts [%], without those whose true force never varies."""
        return spread([contact.rms_percent for contact in self.contacts])

    @property
    def r(self) -> Spread:
        """Mean Pearson correlation of the contacts [-], without those where it is undefined."""
        return spread([contact.r for contact in self.contacts])

    def to_rows(self) -> list[dict[str, str | int | float | None]]:
        """Return one flat record a contact, then F_net, mean, SD and count; undefined numbers are None."""
        rows: list[dict[str, str | int | float | None]] = []
        for item in (*self.contacts, self.net):
            rows.append(
                {
                    "contact": item.name,
                    "rmse_N": finite_or_none(item.rmse),
                    "rms_percent": finite_or_none(item.rms_percent),
                    "r": finite_or_none(item.r),
                    "largest_true_N": finite_or_none(item.largest_true),
                    "largest_estimated_N": finite_or_none(item.largest_estimated),
                }
            )
        for label, part in (("mean", "mean"), ("SD", "sd"), ("count", "count")):
            rows.append(
                {
                    "contact": label,
                    "rmse_N": finite_or_none(getattr(self.rmse, part)),
                    "rms_percent": finite_or_none(getattr(self.rms_percent, part)),
                    "r": finite_or_none(getattr(self.r, part)),
                    "largest_true_N": None,
                    "largest_estimated_N": None,
                }
            )
        return rows


def score(true: Float[np.ndarray, "..."], estimated: Float[np.ndarray, "..."]) -> Scores:
    """Compare estimated with true forces: RMSE, RMSE / range(true) and Pearson's r (paper, section II-F).

    true       (frames, 7)   true magnitudes of f_C1…f_C7 [N]
    estimated  (frames, 7)   the estimator's answer for the same frames [N]

    Raises InputError for another shape, no frames, or a number that is not finite.
    """
    true = _checked("true", true)
    estimated = _checked("estimated", estimated)
    if len(true) != len(estimated):
        raise InputError(
            f"forces: expected as many estimated as true frames, got {len(estimated)} and {len(true)}; "
            "pass the estimates of these very frames"
        )
    return Scores(
        frames=len(true),
        contacts=tuple(_compare(name, true[:, i], estimated[:, i]) for i, name in enumerate(CONTACTS)),
        net=_compare(NET_FORCE, true.sum(axis=1), estimated.sum(axis=1)),
    )


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


def _compare(name: str, true: Float[np.ndarray, " n"], estimated: Float[np.ndarray, " n"]) -> ContactMetrics:
    rmse = float(np.sqrt(np.mean((estimated - true) ** 2)))
    true_range = float(np.ptp(true))
    return ContactMetrics(
        name=name,
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


def _checked(name: str, forces: Float[np.ndarray, "..."]) -> Float[np.ndarray, "frames 7"]:
    if forces.ndim != 2 or forces.shape[1] != len(CONTACTS) or len(forces) == 0:
        raise InputError(
            f"{name} forces: expected shape (frames, 7) with at least one frame, got {forces.shape}; "
            "pass one column for each of C1…C7, without C0"
        )
    if not np.isfinite(forces).all():
        frame = int(np.nonzero(~np.isfinite(forces).all(axis=1))[0][0])
        raise InputError(
            f"{name} forces: expected finite numbers, got {forces[frame].tolist()} in frame {frame}; "
            "drop frames without a label and check the estimator"
        )
    return forces.astype(np.float64)
