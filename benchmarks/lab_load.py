"""The lab under load: `python -m benchmarks.lab_load`, on an idle machine, which all of it stays on.

half-open  520 connections that have sent half a head and no token: the time of a view asked for with it
heavy      50 closed loops, paths of exosuits that nobody has seen, and large images: the time of a light view
Ctrl-C     with both of them: the time until the process has ended, and its exit code

Writes docs/results/lab_load.json.
"""

import io
import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
from PIL import Image

from exosight.app.bench import cpu_name
from exosight.cpu import cores

RESULT = Path(__file__).parents[1] / "docs" / "results" / "lab_load.json"
HOST = "127.0.0.2"
"""Of this machine, but not among the names that need no token."""
HALF_OPEN, HEAVY = 520, 50
ROUNDS, EACH = 3, 10
SECONDS = 30
"""For which light views are asked for."""


@contextmanager
def serving() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The lab in a process of its own, compiled, and its address with the token."""
    program = [sys.executable, "-c", "from exosight.app.main import main; main()"]
    words = [*program, "lab", "--host", HOST, "--port", "0", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as server:
        try:
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            assert found is not None, "the lab did not start"
            _view(found[0], 300)
            yield server, found[0]
        finally:
            server.kill()


def _client(url: str, seconds: float) -> httpx.Client:
    """On a connection of its own."""
    parts = urlsplit(url)
    cookies = {"exosight_lab": parts.query.removeprefix("token=")}
    return httpx.Client(base_url=f"http://{parts.netloc}", cookies=cookies, timeout=seconds)


def _view(url: str, seconds: float = 120, u: float = 2.4) -> float:
    """Time of a view of the nominal design [s]."""
    with _client(url, seconds) as client:
        start = time.perf_counter()
        client.post("/api/view", json={"drive": [[u]]}).raise_for_status()
        return time.perf_counter() - start


def _half_open(url: str, stack: ExitStack) -> None:
    for _ in range(HALF_OPEN):
        line = stack.enter_context(socket.create_connection((HOST, urlsplit(url).port), timeout=20))
        line.sendall(b"POST /api/view HTTP/1.1\r\nHost: lab\r\nContent-")


def _heavy(url: str, number: int, picture: bytes, statuses: list[int]) -> None:
    view = {"design": {"young": 200.0 + number}, "drive": [[2.4]]}
    path, sent = (
        ("trial", {"json": {"view": view}}),
        ("path", {"json": {"view": view}}),
        ("estimate", {"content": picture}),
    )[number % 3]
    try:
        with _client(url, 600) as client:
            statuses.append(client.post(f"/api/{path}", **sent).status_code)
    except httpx.TransportError:
        pass  # the server was stopped


def _picture() -> bytes:
    """36 million pixels."""
    Image.radial_gradient("L").resize((6000, 6000)).save(file := io.BytesIO(), "PNG")
    return file.getvalue()


def run() -> dict[str, Any]:
    """Times [s]."""
    load, most = os.getloadavg()[0], resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, most), most))
    found: dict[str, Any] = {"cpu": cpu_name(), "cores": cores(), "load before": round(load, 2)}
    picture, statuses = _picture(), list[int]()
    with serving() as (server, url):
        views = []
        for _ in range(ROUNDS):
            with ExitStack() as stack:
                _half_open(url, stack)
                views += [_view(url) for _ in range(EACH)]
        found[f"view, {HALF_OPEN} half-open, largest of {len(views)} [s]"] = round(max(views), 2)
        threads = [
            threading.Thread(target=_heavy, args=(url, number, picture, statuses), daemon=True)
            for number in range(HEAVY)
        ]
        for thread in threads:
            thread.start()
        views, end = [], time.monotonic() + SECONDS
        while time.monotonic() < end and any(thread.is_alive() for thread in threads):
            views.append(_view(url, u=round(0.05 * (len(views) % 80), 2)))
        waiting = sum(thread.is_alive() for thread in threads)
        name = f"light view, {HEAVY} to {waiting} heavy requests, largest of {len(views)} [s]"
        found[name] = round(max(views), 2)
        found["heavy requests refused"] = sum(status != 200 for status in statuses)
        with ExitStack() as stack:
            _half_open(url, stack)
            start = time.perf_counter()
            server.send_signal(signal.SIGINT)
            found["Ctrl-C, exit code"] = server.wait(60)
            seconds = time.perf_counter() - start
        found[f"Ctrl-C, {waiting} heavy requests, {HALF_OPEN} half-open [s]"] = round(seconds, 2)
        assert server.stdout is not None
        assert "Traceback" not in (said := server.stdout.read()), said
    return found


if __name__ == "__main__":
    measured = run()
    for key, value in measured.items():
        print(f"{key}: {value}")
    RESULT.write_text(json.dumps(measured, indent=1) + "\n")
