"""What the command line shows: results on stdout, progress and notes on stderr."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table as RichTable
from rich.text import Text

from exosight.dataset.files import write_new_file
from exosight.evaluation.tables import Table, cell_text

out = Console(highlight=False, soft_wrap=True)
notes = Console(stderr=True, highlight=False)


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text(f"{speed:.1f} {task.fields['unit']}/s" if speed else "")


@contextmanager
def progress(description: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """A bar with rate and time left on stderr; yields the function to call with (done, total)."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=notes) as bars:
        task = bars.add_task(description, total=None, unit=unit)

        def update(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total)

        yield update


def show(table: Table) -> None:
    """Print one table of numbers with their units."""
    rich = RichTable(
        title=table.caption,
        caption=table.note or None,
        title_justify="left",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    for i, column in enumerate(table.columns):
        words = (column.group, column.name, f"[{column.unit}]" if column.unit else "")
        head = Text("\n".join(word for word in words if word))
        rich.add_column(head, justify="left" if i == 0 else "right", vertical="bottom")
    for row in table.rows:
        rich.add_row(*(cell_text(cell, column) for cell, column in zip(row, table.columns, strict=True)))
    out.print(rich)


def say(text: str) -> None:
    """Print one line for the reader, on stderr."""
    notes.print(text, markup=False)


def write_json(values: Any, target: str) -> None:
    """Write plain values as JSON, to stdout if the target is "-", else to a new file."""
    text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
    else:
        write_new_file(Path(target), text.encode())
        say(f"wrote {target}")
