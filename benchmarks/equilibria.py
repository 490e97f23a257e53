"""Equilibria a second: 110 exosuits of all eleven scenarios, each driven 0 → 4 N in 51 loads.

The same as `exosight bench`, and in the same run the rates of `index` and `index-friction` beside that of
`published`: one warm call each, then nine in turns. Run alone: another load on the machine makes the numbers
worthless.
"""

import statistics
import time
from dataclasses import asdict

import numpy as np

from exosight.app.bench import LOADS, bench
from exosight.exosuit.assembly import MAX_FORCE
from exosight.exosuit.index import index, index_friction
from exosight.exosuit.published import published
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import drive

PER_SCENARIO = 10
TURNS = 9
"""Medians of shares differed by 5 % from run to run; with three, on a machine whose speed drifts, by 13 %."""
SYSTEMS = {"published": published, "index": index, "index-friction": index_friction}


def rates() -> dict[str, float]:
    """Of each system, medians of the rate [1/s] and of its share of the first one's, and its Newton steps."""
    shapes = [sampled.shape for sampled in sample_shapes(PER_SCENARIO, seed=0)]
    robots = {name: [system(shape).robot for shape in shapes] for name, system in SYSTEMS.items()}
    loads = np.linspace(0, MAX_FORCE, LOADS)[:, None]
    seconds: dict[str, list[float]] = {name: [] for name in SYSTEMS}
    found = {name: drive(each, np.zeros_like(loads)) for name, each in robots.items()}  # compiles
    for _ in range(TURNS):
        for name, each in robots.items():
            started = time.perf_counter()
            found[name] = drive(each, loads)
            seconds[name].append(time.perf_counter() - started)
    rate = {name: found[name].converged.size / statistics.median(own) for name, own in seconds.items()}
    shares = {
        name: statistics.median(first / each for first, each in zip(seconds["published"], own, strict=True))
        for name, own in seconds.items()
    }
    result = {}
    for name, each in found.items():
        result[f"{name}: equilibria per second"] = rate[name]
        result[f"{name}: share of published"] = shares[name]
        result[f"{name}: converged"] = float(each.converged.mean())
        result[f"{name}: iterations mean"] = float(each.iterations.mean())
    return result


def run() -> dict[str, str | int | float]:
    """Measure, and round for reading."""
    found = asdict(bench(PER_SCENARIO)) | rates()
    return {
        name: float(f"{value:.4g}") if isinstance(value, float) else value for name, value in found.items()
    }


if __name__ == "__main__":
    for key, value in run().items():
        print(f"{key}: {value}")
