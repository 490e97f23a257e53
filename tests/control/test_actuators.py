"""Lines of u: what a program behind a pipe reads, and what happens when it goes away."""

import itertools
import os
import pty
import socket
import termios
from collections import deque
from io import FileIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.control.actuator_curve import ActuatorCurve
from exosight.control.actuators import Actuator, Lines, NoActuator
from exosight.control.line_receiver import LineReceiver
from exosight.errors import DataError, InputError


def test_each_step_is_a_line_and_the_last_one_is_zero(tmp_path: Path) -> None:
    lines = Lines.open(str(tmp_path / "u.txt"), "u", "N")
    assert isinstance(lines, Actuator)
    for u in (0.0, 1.25, -0.5):
        lines.apply(u)
    lines.close()
    assert (tmp_path / "u.txt").read_text().splitlines() == [
        "0 u 0.0000 N",
        "1 u 1.2500 N",
        "2 u -0.5000 N",
        "3 u 0.0000 N",
    ]


def test_a_line_is_there_before_the_next_step(tmp_path: Path) -> None:
    lines = Lines.open(str(tmp_path / "u.txt"), "u", "N")
    lines.apply(2.0)
    assert (tmp_path / "u.txt").read_text() == "0 u 2.0000 N\n"
    lines.close()


def test_a_file_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "u.txt").write_text("precious")
    with pytest.raises(DataError, match="exists already"):
        Lines.open(str(tmp_path / "u.txt"), "u", "N")
    assert (tmp_path / "u.txt").read_text() == "precious"
    with pytest.raises(DataError, match="cannot be written"):
        Lines.open(str(tmp_path / "no folder" / "u.txt"), "u", "N")


def test_a_reader_that_goes_away_is_told_of() -> None:
    reading, writing = os.pipe()
    lines = Lines(FileIO(writing, "wb"), "u", "N")
    lines.apply(1.0)
    os.close(reading)
    with pytest.raises(DataError, match="cannot be sent"):
        lines.apply(2.0)
    lines.close()  # and the end is quiet


def test_a_closed_stream_is_told_of() -> None:
    lines = Lines(FileIO(os.devnull, "wb"), "u", "N")
    lines.close()
    with pytest.raises(DataError, match="cannot be sent"):
        lines.apply(1.0)


def test_stdout_is_a_place_and_stays_open(capfd: pytest.CaptureFixture[str]) -> None:
    lines = Lines.open("-", "u", "N")
    lines.apply(1.5)
    lines.close()
    print("still here", flush=True)
    assert capfd.readouterr().out == "0 u 1.5000 N\n1 u 0.0000 N\nstill here\n"


def test_a_serial_device_gets_lines_as_they_are_at_its_speed() -> None:
    reading, writing = pty.openpty()
    place = os.ttyname(writing)
    settings = termios.tcgetattr(writing)
    settings[3] |= termios.ECHO | termios.ICANON
    settings[1] |= termios.OPOST | termios.ONLCR  # a terminal, which turns line feeds into two bytes
    termios.tcsetattr(writing, termios.TCSANOW, settings)
    for suffix, speed in (("", termios.B115200), ("@9600", termios.B9600)):
        lines = Lines.open(place + suffix, "u", "N")
        assert termios.tcgetattr(writing)[4:6] == [speed, speed]
        lines.apply(1.25)
        assert os.read(reading, 100) == b"0 u 1.2500 N\n"
        lines.close()
        assert os.read(reading, 100) == b"1 u 0.0000 N\n"
    os.close(reading)
    os.close(writing)


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ("/dev/null@9600", "no serial device"),
        ("/dev/ttyS0@12345", "expected one of the speeds 1200, .*, got 12345"),
        ("udp://", "expected udp://HOST:PORT"),
        ("udp://127.0.0.1", "expected udp://HOST:PORT"),
        ("udp://127.0.0.1:0", "expected udp://HOST:PORT"),
        ("udp://127.0.0.1:65536", "expected udp://HOST:PORT"),
        ("udp://no host:5005", "expected udp://HOST:PORT"),
    ],
)
def test_places_that_are_none_are_one_sentence(place: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Lines.open(place, "u", "N")


@pytest.mark.parametrize(("family", "host"), [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "[::1]")])
def test_each_datagram_is_a_line(family: socket.AddressFamily, host: str) -> None:
    with socket.socket(family, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind((host.strip("[]"), 0))
        except OSError:
            pytest.skip(f"no network {host}")
        receiver.settimeout(10)
        lines = Lines.open(f"udp://{host}:{receiver.getsockname()[1]}", "u", "N")
        lines.apply(0.5)
        lines.apply(-1.0)
        lines.close()
        assert [receiver.recv(100) for _ in range(3)] == [
            b"0 u 0.5000 N\n",
            b"1 u -1.0000 N\n",
            b"2 u 0.0000 N\n",
        ]


def test_a_port_where_nobody_listens_is_told_of() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        port = receiver.getsockname()[1]
    lines = Lines.open(f"udp://127.0.0.1:{port}", "u", "N")
    with pytest.raises(DataError, match="cannot be sent"):
        deque(map(lines.apply, [1.0] * 10))  # the first is sent; its refusal comes back with one of the next
    lines.close()


def test_a_reader_that_has_stopped_does_not_hold_up_the_loop(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    reading = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    lines = Lines.open(str(tmp_path / "pipe"), "u", "N")
    with pytest.raises(DataError, match="whoever reads it has stopped"):
        deque(map(lines.apply, [1.0] * 1_000_000))  # far beyond what a pipe holds
    os.close(reading)
    lines.close()


def test_a_driver_on_a_serial_device_releases_where_the_loop_is_stopped() -> None:
    """A program that stops, is killed or hangs sends no line, and the last one holds only so long."""
    reading, writing = pty.openpty()
    time = [0.0]
    driver = LineReceiver("pressure", "kPa", silence=0.5, now=lambda: time[0])
    curve = ActuatorCurve("pressure", "kPa", np.array([0.0, 2.0]), np.array([5.0, 45.0]))
    lines = Lines.open(os.ttyname(writing), curve.name, curve.unit, curve.at)
    assert driver.value == 0  # before the first line
    for u in (0.0, 1.0, 2.0, 1.0):
        lines.apply(u)
        driver.take(os.read(reading, 100))
        assert driver.value == 5 + 20 * u
        time[0] += 0.1
    time[0] += 0.39  # 0.49 s after the last
    assert driver.value == 25
    time[0] += 0.02
    assert driver.value == 0
    lines.apply(1.0)  # the loop goes on
    driver.take(os.read(reading, 100))
    assert driver.value == 25
    lines.close()
    driver.take(os.read(reading, 100))
    assert (driver.value, driver.missed, driver.refused) == (5, 0, 0)  # no load
    os.close(reading)
    os.close(writing)


@given(cuts=st.lists(st.integers(0, 60), max_size=8))
def test_a_driver_takes_lines_in_any_pieces(cuts: list[int]) -> None:
    sent = b"0 u 1.0000 N\n1 u 2.0000 N\n2 u -3.5000 N\n"
    driver = LineReceiver("u", "N", now=lambda: 0.0)
    places = [0, *sorted(min(cut, len(sent)) for cut in cuts), len(sent)]
    for start, stop in itertools.pairwise(places):
        driver.take(sent[start:stop])
    assert (driver.value, driver.missed, driver.refused) == (-3.5, 0, 0)


def test_a_driver_counts_lost_lines_and_refuses_what_is_none() -> None:
    time = [0.0]
    driver = LineReceiver("u", "N", now=lambda: time[0])
    driver.take(b"0 u 1.0000 N\n3 u 2.0000 N\n2 u 9.0000 N\n")  # two lost, then one of them, late
    assert (driver.value, driver.missed, driver.refused) == (2, 2, 1)
    wrong = b"4 v 5.0 N\n4 u 5.0 kPa\n4 u nan N\n4 u 5.0\n-1 u 5.0 N\n4 u x N\n\xff\n2.0000\n" + b"7" * 200
    driver.take(wrong)
    assert (driver.value, driver.refused) == (2, 10)
    time[0] = 1.0  # silent, so that a sender that begins anew is heard
    driver.take(b"0 u 4.0000 N\n")
    assert (driver.value, driver.missed) == (4, 2)
    with pytest.raises(InputError, match="above 0 s"):
        LineReceiver("u", "N", silence=0.0)


def test_nobody_is_an_actuator() -> None:
    nobody = NoActuator()
    nobody.apply(3.0)
    nobody.close()
    assert isinstance(nobody, Actuator)
