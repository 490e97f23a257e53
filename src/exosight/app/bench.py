"""How fast equilibria are solved on this machine, and how far that is from what its arithmetic allows."""

import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from exosight.arrays import AnyArray
from exosight.cpu import cores
from exosight.exosuit.assembly import MAX_FORCE, Exosuit, assemble
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Robot, State, advance, drive

FLOOR = 0.15e6
"""Arithmetic of one Newton step of the 25 coordinates: operations that poses, Jacobians, gradient, Hessian
and Cholesky factor cannot do without."""

LOADS = 51
REPEATS = 3

# What a first call waits for, measured in a fresh process so that nothing of it is in memory yet.
_FIRST_CALL = """
import time
import numpy as np
from exosight.arrays import AnyArray
from exosight.exosuit.assembly import Exosuit, assemble
from exosight.mechanics import Robot, drive
robot, loads = assemble(Exosuit()), np.zeros((1, 1))
started = time.perf_counter()
drive([robot], loads)
print(time.perf_counter() - started)
"""


@dataclass(frozen=True)
class Bench:
    """One run of the benchmark."""

    cpu: str
    """name of the processor"""
    cores: int
    """that this process may use"""
    device: str
    """what JAX computes on"""
    shapes: int
    """exosuits, of all eleven scenarios"""
    equilibria: int
    """solved: shapes × 51 loads from 0 to 4 N"""
    seconds: float
    """median of three runs, without compiling [s]"""
    equilibria_per_second: float
    """[1/s]"""
    converged: float
    """share that converged and is stable [-]"""
    snaps: int
    """steps between neighbouring loads at which a pose jumps"""
    iterations_mean: float
    """Newton steps an equilibrium"""
    iterations_median: float
    """the same; few loads at a snap take most"""
    microseconds_per_iteration: float
    """of one core, all overheads included [µs]"""
    matrix_product_rate: float
    """of this machine in the same run: float64, 1024 × 1024, all cores [Gflop/s]"""
    share_of_floor: float
    """time that 0.15 Mflop a Newton step take at that rate, of the time taken [-]"""
    resolve_milliseconds: float
    """a single pose solved again after a change of load of 0.01 N, median [ms]"""
    first_call_seconds: float
    """the first call in a new process, with nothing compiled before [s]"""
    cached_call_seconds: float
    """the same with compiled code on disk [s]"""
    memory: float
    """largest resident memory of this process [MiB]"""


def bench(per_scenario: int, done: Callable[[int, int], None] = lambda done, total: None) -> Bench:
    """Solve so many shapes of each scenario and measure.

    done   called with (steps done, steps in all)
    """
    robots = [assemble(Exosuit(sampled.shape)) for sampled in sample_shapes(per_scenario, seed=0)]
    loads = np.linspace(0, MAX_FORCE, LOADS)[:, None]
    total = 3 + REPEATS
    done(0, total)
    first, cached = _first_calls()
    done(1, total)
    found = drive(robots, np.zeros_like(loads))  # compiles for as many loads, all at rest
    done(2, total)
    rate = _matrix_product_rate()
    seconds = []
    for repeat in range(REPEATS):
        started = time.perf_counter()
        found = drive(robots, loads)
        seconds.append(time.perf_counter() - started)
        done(3 + repeat, total)
    median = statistics.median(seconds)
    resolve = _resolve(robots[0], found.q[:1, LOADS // 2])
    done(total, total)
    iterations = np.asarray(found.iterations)
    return Bench(
        cpu=cpu_name(),
        cores=cores(),
        device=jax.devices()[0].device_kind,
        shapes=len(robots),
        equilibria=iterations.size,
        seconds=median,
        equilibria_per_second=iterations.size / median,
        converged=float(np.mean(found.converged)),
        snaps=int(np.sum(found.snapped)),
        iterations_mean=float(iterations.mean()),
        iterations_median=float(np.median(iterations)),
        microseconds_per_iteration=1e6 * median * cores() / float(iterations.sum()),
        matrix_product_rate=rate / 1e9,
        share_of_floor=FLOOR * float(iterations.sum()) / rate / median,
        resolve_milliseconds=1e3 * resolve,
        first_call_seconds=first,
        cached_call_seconds=cached,
        memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    )


def cpu_name() -> str:
    """The processor's name as the system tells it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _matrix_product_rate() -> float:
    """[flop/s]"""
    size = 1024
    matrix = np.random.default_rng(0).normal(size=(size, size))
    product, seconds = np.empty_like(matrix), []
    for _ in range(9):
        started = time.perf_counter()
        np.matmul(matrix, matrix, out=product)
        seconds.append(time.perf_counter() - started)
    return 2 * size**3 / statistics.median(seconds)


def _resolve(robot: Robot, q: AnyArray) -> float:
    """Median time of a single pose after a small change of load [s]."""
    seconds = []
    state = State(np.asarray(q), np.array([[MAX_FORCE / 2]]))
    for i in range(41):
        loads = np.array([[MAX_FORCE / 2 + 0.01 * (i % 2)]])
        started = time.perf_counter()
        state, _ = advance([robot], state, loads)
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds[1:])  # the first one compiles for a single robot


def _first_calls() -> tuple[float, float]:
    """The first call of a new process without and with compiled code on disk [s]."""
    with tempfile.TemporaryDirectory() as cache:
        settings = {"JAX_COMPILATION_CACHE_DIR": cache, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
        command = [sys.executable, "-c", _FIRST_CALL]
        seconds = []
        for _ in range(2):
            run = subprocess.run(
                command, env={**os.environ, **settings}, check=True, capture_output=True, text=True
            )
            seconds.append(float(run.stdout))
    return seconds[0], seconds[1]
