"""Each kind of input in a process of its own, watched by this one."""

import multiprocessing
import resource
import tempfile
import time
import traceback
import warnings
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from typing import Any

from benchmarks.fuzz import every, opened

LONGEST = 20.0
"""Time for one input [s]."""
LARGEST = 4 * 2**30
"""Memory that a process can have [bytes], so that one that asks for more fails alone."""
FIELDS = ("next", "accepted", "refused", "defect", "before", "after", "slowest")
"""What a process counts: memory in KiB before the first input and at its peak, the longest time in ms."""


def work(name: str, seed: int, start: int, stop: int, counts: Any, found: Any) -> None:
    """Try the inputs from `start` on, in a process of its own."""
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        attempt = opened(name, Path(folder))
        counts[FIELDS.index("before")] = counts[FIELDS.index("after")] = _peak()
        resource.setrlimit(resource.RLIMIT_DATA, (LARGEST, LARGEST))
        counts[0] = start
        begun = time.perf_counter()
        for number, outcome, error in every(attempt, name, seed, start, stop - start):
            took = time.perf_counter() - begun
            counts[FIELDS.index(outcome)] += 1
            counts[FIELDS.index("after")] = _peak()
            counts[FIELDS.index("slowest")] = max(counts[FIELDS.index("slowest")], int(1e3 * took))
            if error is not None:
                found.put((number, "".join(traceback.format_exception(error))[-3000:]))
            counts[0] = number + 1
            begun = time.perf_counter()


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def run(name: str, count: int, seed: int, start: int) -> dict[str, Any]:
    """Try so many inputs of a kind; counts, numbers of the inputs that hung or crashed, memory and time."""
    context = multiprocessing.get_context("spawn")
    found = context.SimpleQueue()
    totals = {field: 0 for field in FIELDS[1:]}
    hangs, crashes, tracebacks = [], [], []
    stop, begun = start + count, time.perf_counter()
    while start < stop:
        counts = RawArray("q", len(FIELDS))
        counts[0] = -1
        process = context.Process(target=work, args=(name, seed, start, stop, counts, found))
        process.start()
        last, since = -1, time.monotonic()
        while process.is_alive():
            process.join(0.2)
            while not found.empty():
                tracebacks.append(found.get())
            if counts[0] != last or counts[0] < 0:
                last, since = counts[0], time.monotonic()
            elif time.monotonic() - since > LONGEST:
                hangs.append(last)
                process.kill()
                process.join()
        while not found.empty():
            tracebacks.append(found.get())
        if process.exitcode and counts[0] < 0:
            raise RuntimeError(f"{name}: cannot begin")
        if process.exitcode and counts[0] not in hangs:
            crashes.append(counts[0])
        for i, field in enumerate(FIELDS[1:], 1):
            kept = max if field in ("before", "after", "slowest") else int.__add__
            totals[field] = kept(totals[field], counts[i])
        start = counts[0] + (1 if process.exitcode else 0)
    return {
        "inputs": count,
        "accepted": totals["accepted"],
        "refused": totals["refused"],
        "tracebacks": totals["defect"],
        "hangs over 20 s": len(hangs),
        "crashes": len(crashes),
        "peak memory before [MiB]": totals["before"] >> 10,
        "peak memory [MiB]": totals["after"] >> 10,
        "slowest input [ms]": totals["slowest"],
        "seconds": round(time.perf_counter() - begun),
        "numbers": {"tracebacks": tracebacks, "hangs": hangs, "crashes": crashes},
    }
