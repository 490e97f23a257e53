"""The lab as a command: a signal ends it, whatever it is doing."""

import re
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack

import pytest

GUARD = 60
"""Seconds after which a test that hangs fails; the work that is stopped would take ten times as long."""

SERVE = f"""
import os, signal, time
from exosight.app.main import main
from exosight.lab import server

def work(*_):
    os.write(1, b"at work\\n")  # whole, where print would write words and line end apart
    time.sleep({10 * GUARD})

server._warm_up = lambda *_: None
server._answer = server.estimate = work
signal.signal(signal.SIGINT, signal.default_int_handler)  # which background jobs of shells ignore
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_lab_with_requests_at_work_and_connections_half_open(
    number: signal.Signals,
) -> None:
    command = [sys.executable, "-c", SERVE, "lab", "--port", "0", "--no-browser"]
    with ExitStack() as stack:
        both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        lab = stack.enter_context(subprocess.Popen(command, text=True, **both))
        stack.callback(lab.kill)
        assert lab.stdout is not None
        port = re.search(r"127\.0\.0\.1:(\d+)/", lab.stdout.readline())
        assert port is not None
        head = "POST /api/estimate HTTP/1.1\r\nHost: 127.0.0.1\r\n"
        for sent in (head, f"{head}Content-Length: 2\r\n\r\nx", *3 * [f"{head}Content-Length: 1\r\n\r\nx"]):
            line = stack.enter_context(socket.create_connection(("127.0.0.1", int(port[1])), GUARD))
            line.sendall(sent.encode())
        for _ in range(2):
            while "at work" not in (words := lab.stdout.readline()):
                assert words
        lab.send_signal(number)
        said, _ = lab.communicate(timeout=GUARD)
    assert lab.returncode == 128 + number
    assert said.split() == ["exosight:", "stopped"]
