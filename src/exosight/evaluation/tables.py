"""Tables of numbers with units, one form for the report, the terminal, CSV and JSON."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from exosight.errors import InputError
from exosight.evaluation.metrics import Scores, Spread, finite_or_none
from exosight.evaluation.naming import common_unit, kind, row_name, span
from exosight.evaluation.published import CONTACTS_PUBLISHED, ROBUSTNESS_PUBLISHED, is_published
from exosight.system.schema import Schema

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


def sensor_table(name: str, caption: str, scores: Scores) -> Table:
    """Return RMSE, RMS% and r of every output and sum; of the published system beside the paper's Table 3."""
    schema = scores.schema
    paper = CONTACTS_PUBLISHED if is_published(schema) else (None,) * len(scores.outputs)
    rows: list[tuple[Cell, ...]] = [
        (row_name(schema, ours.name), *_beside(scores, ours, other))
        for ours, other in zip(scores.outputs, paper, strict=True)
    ]
    rows.append(("mean\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}SD", *means(scores, "clean")))
    rows += [(row_name(schema, total.name), *_beside(scores, total, None)) for total in scores.sums]
    note = (
        f"{count_text(scores.frames)} frames. RMS% is the RMSE over the range of the true value. "
        f"The means are over {span(schema.outputs)}."
    )
    note += "".join(
        f" {total.name} is the sum of {span(schema.sensor(total.name).parts)}." for total in scores.sums
    )
    count = len(scores.outputs)
    if scores.r.count < count:
        note += (
            " A dash is an undefined number (a value that never varies has no correlation): "
            f"{count - scores.r.count} of {count} {kind(schema)}s are left out of the mean r, "
            f"{count - scores.rms_percent.count} out of the mean RMS%."
        )
    if not common_unit(schema):
        note += " Errors in different units have no mean."
    return Table(name, caption, (Column(kind(schema)), *metric_columns(schema)), tuple(rows), note)


def largest_table(name: str, caption: str, scores: Scores) -> Table:
    """Return the largest true and estimated value of each output, beside those that the paper names."""
    schema = scores.schema
    paper = CONTACTS_PUBLISHED if is_published(schema) else ()
    rows = tuple(
        (
            *(row_name(schema, ours.name), ours.largest_true, ours.largest_estimated),
            *((paper[i].largest_true, paper[i].largest_estimated) if paper else ()),
        )
        for i, ours in enumerate(scores.outputs)
    )
    columns = (
        Column(kind(schema)),
        *(
            Column(of, common_unit(schema), who, 2)
            for who in (OURS, *((PAPER,) if paper else ()))
            for of in ("true", "estimated")
        ),
    )
    return Table(name, caption, columns, rows)


def mean_table(
    name: str, caption: str, cases: Mapping[str, Scores], first: str = "split", note: str = ""
) -> Table:
    """Return mean ± SD over the outputs of several evaluations; of the published system beside the paper's.

    cases  what was evaluated → its scores, all of one system; the names fill the first column, headed `first`
    """
    rows = tuple((case, *means(scores, "clean")) for case, scores in cases.items())
    return Table(name, caption, (Column(first), *metric_columns(_schema(cases))), rows, note)


def robustness_table(name: str, caption: str, cases: Mapping[str, Scores]) -> Table:
    """Return mean ± SD over the outputs for clean and degraded images, beside the paper's Table 4."""
    rows = tuple((case.replace("-", ", "), *means(scores, case)) for case, scores in cases.items())
    return Table(name, caption, (Column("images"), *metric_columns(_schema(cases))), rows)


def metric_columns(schema: Schema) -> tuple[Column, ...]:
    """RMSE, RMS% and r; of the published system each beside the paper's."""
    # The paper prints two decimals; here r differs in the third, and RMSE in tenths of a millinewton.
    metrics = (("RMSE", common_unit(schema), 4), ("RMS%", "%", 2), ("r", "", 3))
    return tuple(
        Column(who, unit, metric, digits if who == OURS else 2)
        for metric, unit, digits in metrics
        for who in ((OURS, PAPER) if is_published(schema) else (OURS,))
    )


def means(scores: Scores, case: str) -> tuple[Cell, ...]:
    """Cells of `metric_columns`: mean ± SD over the outputs on images of one of the paper's cases."""
    return _beside(scores, scores, ROBUSTNESS_PUBLISHED[case])


def _beside(scores: Scores, ours: Any, paper: Any) -> tuple[Cell, ...]:
    """RMSE, RMS% and r of ours; where the system is the paper's, each followed by the paper's or a dash."""
    return tuple(
        getattr(each, metric, None)
        for metric in ("rmse", "rms_percent", "r")
        for each in ((ours, paper) if is_published(scores.schema) else (ours,))
    )


def _schema(cases: Mapping[str, Scores]) -> Schema:
    return next(iter(cases.values())).schema
