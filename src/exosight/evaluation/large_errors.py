"""Whether the probability of a large error follows the errors."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from exosight.evaluation.ood_detection import auroc
from exosight.evaluation.tables import Cell, Column, Table

FEW = 10
"""Frames with a large error, and without, below which no AUROC is shown."""


def large_error_table(
    meant: str,
    likely: float,
    cases: Mapping[str, tuple[Float[np.ndarray, " frames"], Bool[np.ndarray, " frames"]]],
) -> Table:
    """A row for each kind of images, and one for all.

    meant    what a large error is, in words
    likely   probability above which an estimate is flagged
    cases    probability of a large error, and whether it is large, of each frame
    """
    columns = (
        Column("images"),
        Column("large errors", "%", digits=1),
        Column("mean probability", "%", digits=1),
        Column("flagged", "%", digits=1),
        Column("AUROC", digits=3),
    )
    probability, large = (np.concatenate(each) for each in zip(*cases.values(), strict=True))
    rows: list[tuple[Cell, ...]] = []
    for name, (p, bad) in {**cases, "all": (probability, large)}.items():
        enough = min(bad.sum(), (~bad).sum()) >= FEW
        shares = (100 * float(np.mean(x)) for x in (bad, p, p > likely))
        rows.append((name.replace("-", ", "), *shares, auroc(p[~bad], p[bad]) if enough else None))
    note = (
        f"Large: {meant}. Flagged: its probability is above {100 * likely:g} %. AUROC: probability that a "
        "frame with a large error has a higher probability of it than one without."
    )
    return Table("large_errors", "Large errors and their probability", columns, tuple(rows), note)
