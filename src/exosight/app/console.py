"""What the command line shows: results on stdout, progress and notes on stderr."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.measure import Measurement
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
from rich.status import Status
from rich.table import Column
from rich.table import Table as RichTable
from rich.text import Text

from exosight.app.output import check_new_file, new_folder
from exosight.errors import printable
from exosight.evaluation.tables import Table, cell_text
from exosight.files import write_new_file


class _Console(Console):
    def on_broken_pipe(self) -> None:
        raise BrokenPipeError  # for the command line's door to deal with; Rich would end the program


out = _Console(highlight=False)
notes = _Console(stderr=True, highlight=False)


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        done, seconds = task.completed - task.fields["before"], task.elapsed
        if not (done and seconds):
            return Text("")
        rate = done / seconds
        return Text(f"{rate:{'.1f' if rate >= 1 else '.2g'}} {task.fields['unit']}/s")


@contextmanager
def progress(description: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """A bar with rate and time left on stderr; yields the function to call with (done, total)."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(table_column=Column(no_wrap=True)),
        _Rate(table_column=Column(no_wrap=True)),
        TimeElapsedColumn(table_column=Column(no_wrap=True)),
        TextColumn("left"),
        TimeRemainingColumn(table_column=Column(no_wrap=True)),
    )  # where lines are short the bar alone gives way, not the numbers
    bars = Progress(*columns, console=notes, expand=True)
    started = False

    def update(done: int, total: int) -> None:
        nonlocal started
        if not started:  # only now: wrong options are reported without a bar
            started = True
            bars.start()
            # What an earlier run did before it was stopped says nothing about the speed of this one.
            before = max(done - 1, 0)
            bars.add_task(description, total=total, completed=before, before=before, unit=unit)
        bars.update(bars.task_ids[0], completed=done)

    try:
        yield update
    finally:
        if started:
            bars.stop()


def waiting(words: str) -> Status:
    """What a terminal shows while something runs whose end cannot be foretold."""
    return notes.status(words)


def show(table: Table) -> None:
    """Print one table of numbers with their units; on its side if only so a line has room for its words."""
    cells = [
        [cell_text(cell, column) for cell, column in zip(row, table.columns, strict=True)]
        for row in table.rows
    ]
    heads = [
        "\n".join(filter(None, (column.group, column.name, f"[{column.unit}]" if column.unit else "")))
        for column in table.columns
    ]
    drawn = _drawn(table, heads, cells)
    if cells and not _fits(drawn):
        first, *names = zip(*cells, strict=True)
        sides = [[head.replace("\n", " "), *values] for head, values in zip(heads[1:], names, strict=True)]
        turned = _drawn(table, [heads[0], *first], sides)
        drawn = turned if _fits(turned) else drawn
    out.print(drawn)


def _fits(drawn: RichTable) -> bool:
    return Measurement.get(out, out.options.update(max_width=10_000), drawn).minimum <= out.width


def _drawn(table: Table, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> RichTable:
    rich = RichTable(
        title=Text(printable(table.caption)),
        caption=Text(printable(table.note)) if table.note else None,
        title_justify="left",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    for i, head in enumerate(heads):
        rich.add_column(
            Text("\n".join(map(printable, head.split("\n")))),
            justify="left" if i == 0 else "right",
            vertical="bottom",
        )
    for row in rows:
        rich.add_row(*(Text(printable(cell)) for cell in row))  # no markup: units stand in brackets
    return rich


def say(text: str) -> None:
    """Print one line for the reader, on stderr."""
    notes.print(printable(text), markup=False)


@contextmanager
def results_folder(path: Path | None) -> Iterator[Path | None]:
    """A folder to fill, see `new_folder`, and a note once it is complete; None where none is asked for."""
    if path is None:
        yield None
        return
    with new_folder(path) as folder:
        yield folder
    say(f"wrote {path}")


def show_or_write(tables: Iterable[Table], values: Any, target: str | None) -> None:
    """Tables on the terminal; with a target the values instead, see `write_json`."""
    if target is not None:
        write_json(values, target)
        return
    for table in tables:
        show(table)


def check_json_target(target: str | None) -> None:
    """Raise DataError now if `write_json` will not be able to write there: before the work, not after it."""
    if target not in (None, "-"):
        check_new_file(Path(target))


def write_json(values: Any, target: str) -> None:
    """Write plain values as JSON, to stdout if the target is "-", else to a new file."""
    if target == "-":
        sys.stdout.write(to_json(values))
    else:
        write_new_file(Path(target), to_json(values).encode())
        say(f"wrote {target}")


def to_json(values: Any) -> str:
    """Plain values as JSON text, in ASCII so that no terminal or locale can break it."""
    return json.dumps(values, indent=1, allow_nan=False) + "\n"
