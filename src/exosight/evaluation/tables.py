"""Tables of numbers with units, one form for the report, the terminal, CSV and JSON."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from exosight.errors import InputError
from exosight.evaluation.metrics import Scores, Spread, finite_or_none
from exosight.evaluation.published import CONTACTS_PUBLISHED, ROBUSTNESS_PUBLISHED, PublishedCase

Cell = str | int | float | Spread | None
"""None and NaN mean "there is no such number" and are shown as a dash."""

OURS, PAPER = "exosight", "paper"
_THOUSANDS = "\N{NARROW NO-BREAK SPACE}"


@dataclass(frozen=True)
class Column:
    """Heading of one column; neighbours of one `group` share a heading above theirs."""

    name: str
    unit: str = ""
    group: str = ""
    digits: int | None = None
    """Decimal places, or None for three significant figures."""

    def key(self, part: str = "") -> str:
        """Return the heading in one line, as CSV and JSON use it: "RMSE exosight SD [N]"."""
        title = " ".join(word for word in (self.group, self.name, part) if word)
        return f"{title} [{self.unit}]" if self.unit else title


@dataclass(frozen=True)
class Table:
    """Rows of numbers under headings; the first column names the row."""

    name: str
    """Stem of the files it is saved to: letters, digits, - and _."""
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    """What a reader has to know to compare fairly; shown under the table."""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", self.name):
            raise InputError(
                f"table name: expected up to 64 letters, digits, - and _, got {self.name!r}; "
                "it becomes a file name"
            )
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(
                    f"table {self.name}: expected {len(self.columns)} cells in a row, one a column, "
                    f"got {len(row)}; pad with None where there is no number"
                )

    def records(self) -> list[dict[str, str | int | float | None]]:
        """Return one flat record a row, all with the same keys; undefined numbers are None.

        A column with a Spread in it becomes three: mean (or the plain number of other rows), SD, count.
        """
        records: list[dict[str, str | int | float | None]] = [{} for _ in self.rows]
        for column, cells in zip(self.columns, zip(*self.rows, strict=True), strict=False):
            spreads = any(isinstance(cell, Spread) for cell in cells)
            for record, cell in zip(records, cells, strict=True):
                is_spread = isinstance(cell, Spread)
                value = cell.mean if is_spread else cell
                record[column.key()] = finite_or_none(value) if isinstance(value, float) else value
                if spreads:
                    record[column.key("SD")] = finite_or_none(cell.sd) if is_spread else None
                    record[column.key("count")] = cell.count if is_spread else None
        return records


def cell_text(cell: Cell, column: Column) -> str:
    """Return the cell as a person reads it: "0.83 ± 0.16", "78 847", "–" for an undefined number."""
    if cell is None:
        return "–"
    if isinstance(cell, Spread):
        mean, sd = cell_text(cell.mean, column), cell_text(cell.sd, column)
        return mean if sd == "–" else f"{mean} ± {sd}"
    if isinstance(cell, str):
        return cell
    if isinstance(cell, int):
        return count_text(cell)
    if finite_or_none(cell) is None:
        return "–"
    if column.digits is not None:
        text = f"{cell:,.{column.digits}f}"
    else:
        # Three significant figures, but never an exponent: 1234.5 is 1 234, not 1.23e+03.
        text = f"{cell:,.0f}" if abs(cell) >= 100 else f"{cell:.3g}"
    return text.replace(",", _THOUSANDS).replace("-", "−")


def count_text(count: int) -> str:
    """Return a whole number with its thousands set apart: "78 847"."""
    return f"{count:,}".replace(",", _THOUSANDS).replace("-", "−")


def contact_table(name: str, caption: str, scores: Scores) -> Table:
    """Return RMSE, RMS% and r of C1…C7 beside the paper's Table 3."""
    rows: list[tuple[Cell, ...]] = [
        (ours.name, ours.rmse, paper.rmse, ours.rms_percent, paper.rms_percent, ours.r, paper.r)
        for ours, paper in zip(scores.contacts, CONTACTS_PUBLISHED, strict=True)
    ]
    rows.append(
        ("mean\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}SD", *_beside(scores, ROBUSTNESS_PUBLISHED["clean"]))
    )
    net = scores.net
    rows.append((net.name, net.rmse, None, net.rms_percent, None, net.r, None))
    note = (
        f"{count_text(scores.frames)} frames. RMS% is the RMSE over the range of the true force. "
        "The means are over C1…C7; F_net is the sum of the seven."
    )
    left_out = len(scores.contacts) - scores.r.count
    if left_out:
        note += (
            " A dash is an undefined number (a force that never varies has no correlation): "
            f"{left_out} of 7 contacts are left out of the mean r, "
            f"{len(scores.contacts) - scores.rms_percent.count} out of the mean RMS%."
        )
    return Table(name, caption, (Column("contact"), *_metric_columns()), tuple(rows), note)


def largest_table(name: str, caption: str, scores: Scores) -> Table:
    """Return the largest true and estimated force of C1…C7 beside those that the paper names."""
    rows = tuple(
        (
            *(ours.name, ours.largest_true, ours.largest_estimated),
            *(paper.largest_true, paper.largest_estimated),
        )
        for ours, paper in zip(scores.contacts, CONTACTS_PUBLISHED, strict=True)
    )
    columns = (
        Column("contact"),
        *(Column(kind, "N", who, 2) for who in (OURS, PAPER) for kind in ("true", "estimated")),
    )
    return Table(name, caption, columns, rows)


def mean_table(
    name: str, caption: str, cases: Mapping[str, Scores], first: str = "split", note: str = ""
) -> Table:
    """Return mean ± SD over C1…C7 of several evaluations, each beside the paper's result on clean images.

    cases  what was evaluated → its scores; the names fill the first column, which is headed `first`
    """
    paper = ROBUSTNESS_PUBLISHED["clean"]
    rows = tuple((case, *_beside(scores, paper)) for case, scores in cases.items())
    return Table(name, caption, (Column(first), *_metric_columns()), rows, note)


def robustness_table(name: str, caption: str, cases: Mapping[str, Scores]) -> Table:
    """Return mean ± SD over C1…C7 for clean and degraded images beside the paper's Table 4."""
    rows = tuple(
        (case.replace("-", ", "), *_beside(scores, ROBUSTNESS_PUBLISHED[case]))
        for case, scores in cases.items()
    )
    return Table(name, caption, (Column("images"), *_metric_columns()), rows)


def _metric_columns() -> tuple[Column, ...]:
    # The paper prints two decimals; here r differs in the third, and RMSE in tenths of a millinewton.
    metrics = (("RMSE", "N", 4), ("RMS%", "%", 2), ("r", "", 3))
    return tuple(
        Column(who, unit, metric, digits if who == OURS else 2)
        for metric, unit, digits in metrics
        for who in (OURS, PAPER)
    )


def _beside(scores: Scores, paper: PublishedCase) -> tuple[Cell, ...]:
    return (scores.rmse, paper.rmse, scores.rms_percent, paper.rms_percent, scores.r, paper.r)
