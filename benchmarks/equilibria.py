"""Equilibria a second: 110 exosuits of all eleven scenarios, each driven 0 → 4 N in 51 loads.

Run alone, `python -m benchmarks.equilibria`: another load on the machine makes the numbers worthless.
"""

import statistics
import time

import numpy as np

from benchmarks.renderer import cpu_name
from exosight.exosuit.assembly import MAX_FORCE, Exosuit, assemble
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import follow

PER_SCENARIO = 10
LOADS = 51
REPEATS = 3


def run() -> dict[str, str | int | float]:
    """Compile and solve once, then measure the median of a few repeats."""
    robots = [assemble(Exosuit(sampled.shape)) for sampled in sample_shapes(PER_SCENARIO, seed=0)]
    loads = np.linspace(0, MAX_FORCE, LOADS)[:, None]
    started = time.perf_counter()
    found = follow(robots, loads)
    first = time.perf_counter() - started
    seconds = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        found = follow(robots, loads)
        seconds.append(time.perf_counter() - started)
    median = statistics.median(seconds)
    return {
        "name": "equilibria",
        "cpu": cpu_name(),
        "shapes": len(robots),
        "loads": LOADS,
        "first call, with compilation [s]": round(first, 1),
        "median of 3 [s]": round(median, 2),
        "equilibria a second": round(found.converged.size / median),
        "Newton steps an equilibrium, mean": round(float(np.mean(found.iterations)), 2),
        "Newton steps an equilibrium, median": float(np.median(found.iterations)),
        "converged and stable [%]": round(100 * float(np.mean(found.converged)), 2),
    }


if __name__ == "__main__":
    for key, value in run().items():
        print(f"{key}: {value}")
