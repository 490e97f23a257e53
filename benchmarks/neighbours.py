"""The same problems solved by exosight, PyElastica and SoRoMoX: error and time side by side, in one run.

`python -m benchmarks.neighbours`, with the extra `compare` installed, writes docs/results/neighbours.json,
which docs/validation.md shows. Each program runs in the same process, first once to compile, then three
times, the programs taking turns; times are medians. What takes long runs once after the first.
"""

import json
import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from benchmarks import motion, rest
from benchmarks.planar import LENGTH, PRESS, TIP_FORCE, at_rest
from exosight.app.bench import cpu_name
from exosight.cpu import cores

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "neighbours.json"
REPEATS = 3
LONG = 20.0
"""What takes longer [s] in the first turn is left out of the others: its spread is small beside it."""
PACKAGES = ("exosight", "pyelastica", "soromox", "diffrax", "jax", "numba", "numpy")


@dataclass(frozen=True)
class Case:
    """One program at one setting: the work, and the error of what it returns."""

    problem: str
    program: str
    setting: str
    work: Callable[[], Any]
    error: Callable[[Any], float]


@dataclass(frozen=True)
class Row:
    """What a run gave: error [-]; median time of a call, processor time in it, and the first call's time [s].

    The first call compiles, where nothing before it has.
    """

    problem: str
    program: str
    setting: str
    error: float
    seconds: float
    processor_seconds: float
    first_seconds: float


def cantilevers() -> list[Case]:
    """Distance of the tip from that of the program's own differential equation, over the length."""
    ours, theirs = at_rest(TIP_FORCE).tip, at_rest(TIP_FORCE, thins=True).tip

    def off(exact: np.ndarray) -> Callable[[Any], float]:
        return lambda found: float(np.linalg.norm(found.tip - exact)) / LENGTH

    name = "cantilever"
    return [
        *(
            Case(name, "exosight", f"{n} element{'s' * (n > 1)}", rest.Exosight(n, False), off(ours))
            for n in (1, 2, 5, 10)
        ),
        *(
            Case(name, "PyElastica", f"{n} elements", rest.PyElastica(n, False), off(theirs))
            for n in (10, 20, 40, 80)
        ),
    ]


def contacts() -> list[Case]:
    """Force on the sphere against that of the program's own differential equation, relative."""
    ours = at_rest(-PRESS, sphere=True).push
    theirs = at_rest(-PRESS, sphere=True, slides=True, thins=True).push

    def off(exact: float) -> Callable[[Any], float]:
        return lambda found: abs(found.push / exact - 1)

    name = "contact"
    return [
        *(Case(name, "exosight", f"{n} elements", rest.Exosight(n, True), off(ours)) for n in (3, 6, 12)),
        *(
            Case(name, "PyElastica", f"{n} elements", rest.PyElastica(n, True), off(theirs))
            for n in (11, 20, 41, 80)
        ),
        Case(name, "PyElastica", "22 elements, sphere off a middle", rest.PyElastica(22, True), off(theirs)),
    ]


def motions(name: str, case: motion.Case, steps: Sequence[float], finest: float) -> list[Case]:
    """Largest difference in any coordinate from SoRoMoX's finest run, over the largest coordinate."""
    exact = motion.their_rollout(case, finest)()

    def off(found: np.ndarray) -> float:
        return float(np.abs(found - exact).max() / np.abs(exact).max())

    return [
        *(
            Case(name, "exosight", f"tolerance {tol:.0e} m", motion.Exosight(case, tol), off)
            for tol in (1e-6, 1e-8, 1e-10)
        ),
        *(
            Case(name, "SoRoMoX", f"step {1e3 * step:g} ms", motion.their_rollout(case, step), off)
            for step in steps
        ),
    ]


def timed(runs: Sequence[Case]) -> list[Row]:
    """Every run once to compile, then all of them in turn, three times over but for those that take long."""
    first, errors = [], []
    times: list[list[tuple[float, float]]] = [[] for _ in runs]
    for run in track(runs, "first calls"):
        started = time.perf_counter()
        errors.append(run.error(run.work()))
        first.append(time.perf_counter() - started)
    for _ in track(range(REPEATS), "timed calls"):
        for run, own in zip(runs, times, strict=True):
            if own and own[0][0] > LONG:
                continue
            started, worked = time.perf_counter(), time.process_time()
            run.work()
            own.append((time.perf_counter() - started, time.process_time() - worked))
    medians = [[statistics.median(column) for column in zip(*own, strict=True)] for own in times]
    return [
        Row(run.problem, run.program, run.setting, error, *median, compiling)
        for run, error, median, compiling in zip(runs, errors, medians, first, strict=True)
    ]


def write(file: Path, runs: Sequence[Case], packages: Sequence[str]) -> None:
    """Measure, write the numbers with what they were measured on, and print them."""
    found = {
        "machine": {
            "cpu": cpu_name(),
            "cores": cores(),
            "load_before": round(os.getloadavg()[0], 2),
            "versions": {name: version(name) for name in packages},
        },
        "rows": [asdict(row) for row in timed(runs)],
    }
    file.parent.mkdir(exist_ok=True)
    file.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    for row in found["rows"]:
        print(
            f"{row['problem']:26}{row['program']:12}{row['setting']:34}{row['error']:9.1e}"
            f"{row['seconds']:10.3g} s, first {row['first_seconds']:.3g} s"
        )


def main() -> None:
    """Measure anew and write the numbers of docs/validation.md."""
    runs = [
        *cantilevers(),
        *contacts(),
        *motions("motion in a plane", motion.PLANE, (2.5e-3, 1e-3, 4e-4), 1e-4),
        *motions("motion in space", motion.SPACE, (8e-4, 4e-4), 2e-4),
        *motions("motion in space, slender", motion.SLENDER, (4e-5,), 2e-5),
    ]
    write(RESULTS, runs, PACKAGES)


if __name__ == "__main__":
    main()
