"""Tables of numbers on file and their places in the pages, and pictures beside them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from exosight.evaluation.tables import Table, cell_text


def table_of(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows])


def machine(found: Mapping[str, Any]) -> str:
    """What a benchmark ran on, of its results."""
    load = found.get("load before", found.get("load_before"))
    return f"Machine: {found['cpu']}, {found['cores']} cores, load average {load} before the run"


def shown(table: Table) -> str:
    """A table of results in Markdown, as the terminal shows it."""
    return table_of(
        [column.key() for column in table.columns],
        [
            [cell_text(cell, column) for cell, column in zip(row, table.columns, strict=True)]
            for row in table.rows
        ],
    )


def filled(page: str, tables: Mapping[str, str]) -> str:
    """The page with what stands between `<!-- name -->` and `<!-- end -->` replaced, for each name.

    Raises ValueError if the page has no such place.
    """
    for name, table in tables.items():
        before, start, rest = page.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not (start and end):
            raise ValueError(f"no place for {name} on the page")
        page = f"{before}{start}{table.rstrip()}\n{end}{after}"
    return page


def fill(path: Path, tables: Mapping[str, str]) -> None:
    """Put tables into a page."""
    path.write_text(filled(path.read_text(encoding="utf-8"), tables), encoding="utf-8")
    print(f"wrote {path}")


def save(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a picture, without the name of the program that drew it: versions of that make no difference."""
    figure.savefig(path, dpi=dpi, metadata={"Software": None})
    print(f"wrote {path}")
