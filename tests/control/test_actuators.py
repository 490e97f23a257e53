"""Lines of u: what a program behind a pipe reads, and what happens when it goes away."""

import os
from io import FileIO
from pathlib import Path

import pytest

from exosight.control.actuators import Actuator, Lines, NoActuator
from exosight.errors import DataError


def test_each_step_is_a_line_and_the_last_one_is_zero(tmp_path: Path) -> None:
    lines = Lines.open(str(tmp_path / "u.txt"))
    assert isinstance(lines, Actuator)
    for u in (0.0, 1.25, -0.5):
        lines.apply(u)
    lines.close()
    assert (tmp_path / "u.txt").read_text().splitlines() == ["0.0000", "1.2500", "-0.5000", "0.0000"]


def test_a_line_is_there_before_the_next_step(tmp_path: Path) -> None:
    lines = Lines.open(str(tmp_path / "u.txt"))
    lines.apply(2.0)
    assert (tmp_path / "u.txt").read_text() == "2.0000\n"
    lines.close()


def test_a_file_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "u.txt").write_text("precious")
    with pytest.raises(DataError, match="exists already"):
        Lines.open(str(tmp_path / "u.txt"))
    assert (tmp_path / "u.txt").read_text() == "precious"
    with pytest.raises(DataError, match="cannot be written"):
        Lines.open(str(tmp_path / "no folder" / "u.txt"))


def test_a_reader_that_goes_away_is_told_of() -> None:
    reading, writing = os.pipe()
    lines = Lines(FileIO(writing, "wb"))
    lines.apply(1.0)
    os.close(reading)
    with pytest.raises(DataError, match="cannot be sent"):
        lines.apply(2.0)
    lines.close()  # and the end is quiet


def test_a_closed_stream_is_told_of() -> None:
    lines = Lines(FileIO(os.devnull, "wb"))
    lines.close()
    with pytest.raises(DataError, match="cannot be sent"):
        lines.apply(1.0)


def test_stdout_is_a_place_and_stays_open(capfd: pytest.CaptureFixture[str]) -> None:
    lines = Lines.open("-")
    lines.apply(1.5)
    lines.close()
    print("still here", flush=True)
    assert capfd.readouterr().out == "1.5000\n0.0000\nstill here\n"


def test_nobody_is_an_actuator() -> None:
    nobody = NoActuator()
    nobody.apply(3.0)
    nobody.close()
    assert isinstance(nobody, Actuator)
