"""What the command line shows while it works."""

import pytest
from rich.console import Console

from exosight.app import console
from exosight.evaluation.tables import Column, Table


@pytest.mark.parametrize(("seconds", "rate"), [(1000.0, "0.036"), (0.5, "72.0")])
def test_a_short_line_cuts_no_number(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], seconds: float, rate: str
) -> None:
    now = iter([0.0])
    monkeypatch.setattr(console, "notes", Console(stderr=True, width=80, get_time=lambda: next(now, seconds)))
    with console.progress("training light network, by shape", "steps") as update:
        update(1, 1020)
        update(36, 1020)
    line = capsys.readouterr().err.splitlines()[-1]
    assert "…" not in line
    assert "36/1020" in line
    assert f"{rate} steps/s" in line


@pytest.mark.parametrize(("width", "rows"), [(80, 12), (300, 2)])
def test_a_table_too_wide_for_the_line_lies_on_its_side(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int, rows: int
) -> None:
    columns = (Column("controller"), *(Column(f"unshortened{i}", "N") for i in range(12)))
    cells = tuple((name, *(float(i) for i in range(12))) for name in ("guarded", "plain"))
    monkeypatch.setattr(console, "out", Console(width=width))
    console.show(Table("wide", "A wide table", columns, cells, "a note"))
    shown = capsys.readouterr().out
    assert "…" not in shown
    assert all(f"unshortened{i}" in shown for i in range(12))
    heads, body = shown.split("─" * 10, 1)
    assert ("plain" in heads) == (rows == 12)
    assert len([line for line in body.splitlines()[1:] if line.strip() not in ("", "a note")]) == rows
