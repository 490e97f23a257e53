"""Steps a second of the Gymnasium environment, all grips together: `python -m benchmarks.environment`."""

import time
from typing import Any

import numpy as np

from exosight.app.bench import cpu_name
from exosight.cpu import cores
from exosight.environment.envs import GripVectorEnv

GRIPS, STEPS, REPEATS = 64, 15, 2


def run() -> dict[str, Any]:
    """Steps a second with actions from the whole range and from a tenth of it; states, and pictures too."""
    found: dict[str, Any] = {
        "name": "environment",
        "cpu": cpu_name(),
        "cores": cores(),
        "grips": GRIPS,
    }
    for observation in ("state", "mixed"):
        env = GripVectorEnv(GRIPS, observation=observation)
        for words, size in (("small", 0.1), ("any", 1.0)):
            wall, busy = _measure(env, size)
            found[f"{observation}, {words} actions, steps a second"] = round(wall)
            found[f"{observation}, {words} actions, steps a CPU second"] = round(busy)
    return found


def _measure(env: GripVectorEnv, size: float) -> tuple[float, float]:
    """Steps a second of the clock and of the processor, median of some episodes that begin at 2 N."""
    rng = np.random.default_rng(0)
    rates = []
    for repeat in range(REPEATS + 1):
        env.reset(seed=repeat)
        for _ in range(2):
            env.step(np.ones((GRIPS, 1)))
        started, busy = time.perf_counter(), time.process_time()
        for _ in range(STEPS):
            env.step(size * rng.uniform(-1, 1, (GRIPS, 1)))
        done = GRIPS * STEPS
        rates.append((done / (time.perf_counter() - started), done / (time.process_time() - busy)))
    wall, processor = np.median(rates[1:], axis=0)  # the first one compiles
    return float(wall), float(processor)


if __name__ == "__main__":
    for key, value in run().items():
        print(f"{key}: {value}")
