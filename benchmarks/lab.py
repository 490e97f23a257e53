"""How soon the lab answers, and what it keeps: `python -m benchmarks.lab [SECONDS]`, on an idle machine.

latency  from a slider's event to pictures and forces on the screen, in headless Chromium; the length slider
         has an exosuit solved that nobody has seen, the actuation goes on from where it is. With the time
         that the server's process computes for it, which other work on the machine changes less
pages    twenty clients that ask as fast as they can, each for exosuits of its own
memory   of the server, and of the page, while sliders are dragged for SECONDS (60 by default)
"""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from playwright.sync_api import Page, sync_playwright

from exosight.app.bench import cpu_name
from exosight.cpu import cores

PORT = 8799
URL = f"http://127.0.0.1:{PORT}"
CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium")
REPEATS = 60
PAGES, EACH = 20, 10
LENGTH = "#settings details:first-of-type .slider:nth-of-type(4) input[type=range]"

# Resolves after the frame in which the view is painted.
_MOVE = """([slider, value]) => new Promise((done) => {
  const input = document.querySelector(slider), start = performance.now();
  document.addEventListener("shown", () => requestAnimationFrame(() => setTimeout(
    () => done(performance.now() - start))), { once: true });
  input.value = value;
  input.dispatchEvent(new Event("input"));
})"""


@contextmanager
def serving() -> Iterator[subprocess.Popen[bytes]]:
    """The lab in a process of its own, compiled."""
    program = [sys.executable, "-c", "from exosight.app.main import main; main()"]
    server = subprocess.Popen(
        [*program, "lab", "--port", str(PORT), "--no-browser"], stderr=subprocess.DEVNULL
    )
    try:
        for _ in range(600):
            try:
                httpx.post(f"{URL}/api/view", json={}, timeout=120)
                break
            except httpx.TransportError:
                time.sleep(0.2)
        yield server
    finally:
        server.terminate()
        server.wait()


def _latency(
    page: Page, server: subprocess.Popen[bytes], slider: str, values: np.ndarray
) -> dict[str, float]:
    found, before = [], _computed(server)
    for value in values:
        found.append(page.evaluate(_MOVE, [slider, float(value)]))
    return {**_two(found), "server's CPU time [ms]": round((_computed(server) - before) / len(values), 1)}


def _computed(server: subprocess.Popen[bytes]) -> float:
    """Processor time of the server so far [ms]."""
    fields = Path(f"/proc/{server.pid}/stat").read_text().rpartition(")")[2].split()
    return 1e3 * (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _two(milliseconds: list[float]) -> dict[str, float]:
    return {
        "median [ms]": round(float(np.median(milliseconds)), 1),
        "95 % [ms]": round(float(np.quantile(milliseconds, 0.95)), 1),
    }


def _resident(server: subprocess.Popen[bytes]) -> float:
    """Memory of the server [MiB]."""
    for line in Path(f"/proc/{server.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    raise RuntimeError("no VmRSS: this needs Linux")


def _heap(page: Page) -> float:
    """Memory of the page's scripts after its garbage is collected [MiB]."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    return session.send("Runtime.getHeapUsage")["usedSize"] / 2**20


def _pages() -> dict[str, float]:
    def ask(number: int) -> list[float]:
        found = []
        with httpx.Client(base_url=URL, timeout=120) as client:
            for i in range(EACH):
                start = time.perf_counter()
                young = 200.0 + number * EACH + i
                view = {"design": {"young": young}, "drive": [[2.4]]}
                client.post("/api/view", json=view).raise_for_status()
                found.append(1e3 * (time.perf_counter() - start))
        return found

    start = time.perf_counter()
    with ThreadPoolExecutor(PAGES) as pool:
        found = [each for one in pool.map(ask, range(PAGES)) for each in one]
    return {**_two(found), "views a second": round(len(found) / (time.perf_counter() - start), 1)}


def run(seconds: float = 60) -> dict[str, Any]:
    """Latency [ms] and memory [MiB]; needs Chromium."""
    rng = np.random.default_rng(0)
    found: dict[str, dict[str, float]] = {}
    with serving() as server, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(URL)
        page.wait_for_selector("#path path.down")
        lengths = rng.permutation(np.arange(70.0, 110.0, 0.1))
        found["actuation moved"] = _latency(
            page, server, "#channel-u", rng.permutation(np.tile(np.arange(80) * 0.05, 2))
        )
        for u, some in ((2.4, lengths[:REPEATS]), (4.0, lengths[REPEATS : 2 * REPEATS])):
            page.evaluate(_MOVE, ["#channel-u", u])
            found[f"new exosuit at {u} N"] = _latency(page, server, LENGTH, some)
        page.evaluate(_MOVE, ["#channel-u", 2.4])
        server_memory, page_memory = [], []
        end, moves = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            if moves % 50 == 0:
                server_memory.append(_resident(server))
                page_memory.append(_heap(page))
            page.evaluate(
                _MOVE, [LENGTH, rng.uniform(70, 110)] if moves % 2 else ["#channel-u", rng.uniform(0, 4)]
            )
            moves += 1
        browser.close()
        for name, memory in (("server", server_memory), ("page", page_memory)):
            found[f"{seconds:g} s of dragging, {name}"] = {
                "at first [MiB]": round(memory[0], 1), "at last [MiB]": round(memory[-1], 1)
            }  # fmt: skip
        found[f"{PAGES} pages at once"] = _pages()
    told = {f"{what}, {key}": value for what, values in found.items() for key, value in values.items()}
    return {"name": "lab", "cpu": cpu_name(), "cores": cores(), "moves": moves, **told}


if __name__ == "__main__":
    for key, value in run(*map(float, sys.argv[1:])).items():
        print(f"{key}: {value}")
