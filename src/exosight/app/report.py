"""The report: sections of text, tables and figures in, one self-contained HTML page out.

The page loads nothing, from disk or network; a content security policy inside it says so to the browser.
"""

import base64
import csv
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure

from exosight.errors import DataError, InputError
from exosight.evaluation.figures import to_bytes
from exosight.evaluation.tables import PAPER, Column, Table, cell_text
from exosight.files import write_new_file

_TEMPLATE = "report.html"

# Wider figures and tables of more columns do not fit a phone and are scrolled sideways there.
_PHONE_INCHES = 4.5
_PHONE_COLUMNS = 4


@dataclass(frozen=True)
class Picture:
    """A figure with what is said about it."""

    figure: Figure
    caption: str
    """What to see in it; a sentence or two under the figure."""
    alt: str
    """What it shows, in words, for a reader who cannot see it."""


@dataclass(frozen=True)
class Listing:
    """Text to be read or copied letter by letter: a command, a configuration."""

    caption: str
    text: str


@dataclass(frozen=True)
class Points:
    """A bulleted list."""

    items: tuple[str, ...]


Block = str | Points | Table | Picture | Listing
"""What a section is made of; a plain string is a paragraph."""


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Report:
    """A whole page."""

    title: str
    summary: str
    """One paragraph under the title: what this is."""
    sections: tuple[Section, ...]
    footer: str
    """Version, seed and date, or whatever else identifies the run."""


def write_report(report: Report, path: Path) -> None:
    """Write the report as one HTML file with all figures inside.

    Raises DataError if the file exists or cannot be written.
    """
    write_new_file(path, render_report(report).encode())


def render_report(report: Report) -> str:
    """Return the report as one HTML page; every text in it is data and is escaped."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["svg_uri"] = _svg_uri
    source = resources.files("exosight.app").joinpath(_TEMPLATE).read_text(encoding="utf-8")
    sections = [
        {
            "id": f"section-{number}",
            "title": section.title,
            "blocks": [_view(block) for block in section.blocks],
        }
        for number, section in enumerate(report.sections, start=1)
    ]
    return environment.from_string(source).render(report=report, sections=sections)


def write_tables(report: Report, folder: Path) -> list[Path]:
    """Write every table of the report as `<name>.csv` and `<name>.json` into the folder; return the paths.

    Undefined numbers are empty in CSV and null in JSON. Nothing is written if a file of one of the names
    exists (DataError) or two tables share a name (InputError).
    """
    tables = list(_tables(report))
    names = [table.name for table in tables]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise InputError(
            f"tables: expected a name for each, got {', '.join(twice)} more than once; rename one"
        )
    contents = {
        folder / f"{table.name}.{kind}": text.encode()
        for table in tables
        for kind, text in (("csv", _to_csv(table)), ("json", _to_json(table)))
    }
    for path in contents:
        if path.exists():
            raise DataError(f"{path} exists and is not overwritten; choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    for path, content in contents.items():
        write_new_file(path, content)
    return list(contents)


def _tables(report: Report) -> Iterator[Table]:
    for section in report.sections:
        yield from (block for block in section.blocks if isinstance(block, Table))


def _to_csv(table: Table) -> str:
    records = table.records()
    buffer = io.StringIO()
    heads = list(records[0]) if records else [column.key() for column in table.columns]
    writer = csv.DictWriter(buffer, heads, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return buffer.getvalue()


def _to_json(table: Table) -> str:
    content = {"caption": table.caption, "note": table.note, "rows": table.records()}
    return json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _view(block: Block) -> dict[str, Any]:
    """Return what the template needs to know of a block."""
    match block:
        case str():
            return {"kind": "paragraph", "text": block}
        case Points():
            return {"kind": "points", "items": block.items}
        case Listing():
            return {"kind": "listing", "caption": block.caption, "text": block.text}
        case Picture():
            inches = float(block.figure.get_size_inches()[0])
            return {"kind": "picture", "picture": block, "inches": inches, "wide": inches > _PHONE_INCHES}
        case Table():
            groups = [
                {"name": name, "columns": list(columns)}
                for name, columns in groupby(block.columns, key=lambda column: column.group)
            ]
            rows = [
                [
                    {
                        "text": cell_text(cell, column),
                        "words": isinstance(cell, str),
                        "paper": _is_paper(column),
                    }
                    for cell, column in zip(row, block.columns, strict=True)
                ]
                for row in block.rows
            ]
            wide = len(block.columns) > _PHONE_COLUMNS
            return {"kind": "table", "table": block, "groups": groups, "rows": rows, "wide": wide}


def _is_paper(column: Column) -> bool:
    return PAPER in (column.name, column.group.rpartition(", ")[2])


def _svg_uri(figure: Figure) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(to_bytes(figure)).decode()
