"""How cost grows with coordinates, contacts, robots and threads: `python -m benchmarks.scaling`.

Takes four minutes. Each size of a chain and of a contact is measured in a process of its own, which compiles
everything anew, so that time and memory of the first call are those of that size. Writes
docs/results/scaling.json, from which docs/figures_speed.py makes tables and a figure of docs/benchmarks.md.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.timing import LANES, evaluation, in_turns, largest_difference, of_solver
from exosight.app.bench import cpu_name
from exosight.cpu import cores
from exosight.exosuit.assembly import Exosuit, assemble
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import (
    Circular,
    DeadForce,
    Gauss,
    Gravity,
    Legendre,
    Robot,
    Rod,
    drive,
    stack,
)

RESULT = Path(__file__).parents[1] / "docs" / "results" / "scaling.json"

DOFS = (25, 50, 100, 200)
CONTACTS = (42, 102, 202, 402)
ROBOTS = (1, 10, 100, 1_000, 10_000)
OF_SEGMENT = 5
"""Coordinates of a segment of the chain: bending about two axes, linear along it, and constant torsion."""
BY_XLA = 100
"""Coordinates up to which XLA evaluates the chain too: compiling for more takes minutes in all."""


def chain(dofs: int) -> Robot:
    """A soft arm, 0.4 m long, of segments one after the other, under its weight and a force on its tip."""
    count = dofs // OF_SEGMENT
    points = Gauss(1, 3)
    strains = {"torsion_x": Legendre(0), "bend_y": Legendre(1), "bend_z": Legendre(1)}
    rods = tuple(
        Rod(
            f"segment_{i}",
            0.4 / count,
            Circular(np.full(points.size, 0.01)),
            young=1e6,
            density=1070.0,
            strains=strains,
            quadrature=points,
            parent=f"segment_{i - 1}" if i else None,
        )
        for i in range(count)
    )
    force = DeadForce(rods[-1].name, -1, 0, jnp.array([0.0, 0.3, 1.0]))
    return Robot(rods, (force, Gravity(jnp.array([0.0, 0.0, -9.81]))))


def exosuit(contacts: int) -> Robot:
    """The exosuit of `published` with so many contact spheres on its rod, together as stiff as its 42."""
    points = Gauss(elements=5, per_element=(contacts - 2) // 5)
    return assemble(Exosuit(contact_stiffness=1000.0 * 42 / contacts), points)


OF_BATCH = np.array([[0.1], [0.2]])
"""Loads of each robot of a batch [N]."""

AXES = {"dofs": (DOFS, chain), "contacts": (CONTACTS, exosuit)}
LOADS = {"dofs": np.linspace(0, 0.6, 9)[1:, None], "contacts": np.linspace(0, 2, 9)[1:, None]}
"""Of the paths whose equilibria are timed [N]."""


def of_size(axis: str, size: int) -> dict[str, Any]:
    """First call, evaluation and equilibrium of a robot of this size, in a process that has done nothing."""
    robot, loads = AXES[axis][1](size), LOADS[axis]
    started = time.process_time()
    made = of_solver(robot)
    making = time.process_time() - started
    found = drive([robot] * LANES, loads)
    first = time.process_time() - started
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    # Off the equilibrium, where the gradient is not round-off.
    each = 0.9 * np.asarray(found.q)[0], loads
    runs = {"program": evaluation(robot, True, *each), "path": lambda: drive([robot] * LANES, loads)}
    result = {
        "size": size,
        "dofs": robot.dofs,
        "frames": robot.frames,
        "program": made is not None,
        "words": sum(len(stage.code) for stage in made.stages) if made else 0,
        "making [s]": making,
        "first call [s]": first,
        "memory [MiB]": memory,
        "converged": float(np.mean(found.converged)),
        "evaluations an equilibrium": float(np.mean(found.iterations)),
    }
    if axis == "dofs" and size <= BY_XLA:
        runs["xla"] = evaluation(robot, False, *each)
        started = time.process_time()
        expected = runs["xla"]()
        result["compiling by XLA [s]"] = time.process_time() - started
        result["difference"] = largest_difference(runs["program"](), expected)
    spent = in_turns(runs, repeats=7)
    equilibria = LANES * len(loads)
    result |= {f"evaluation by {name} [us]": 1e6 * spent[name] / LANES for name in runs if name != "path"}
    return result | {"equilibrium [us]": 1e6 * spent["path"] / equilibria}


def of_robots() -> list[dict[str, Any]]:
    """Time of an equilibrium in batches of exosuits of all scenarios, and by threads."""
    shapes = [sampled.shape for sampled in sample_shapes(10, seed=0)]
    all_shapes = stack([assemble(Exosuit(shape)) for shape in shapes])

    def batch(count: int) -> Robot:
        which = np.arange(count) % len(shapes)
        return jax.tree.map(lambda leaf: np.asarray(leaf)[which], all_shapes)

    def row(count: int, threads: int) -> dict[str, Any]:
        robots = batch(count)
        os.sched_setaffinity(0, sorted(whole)[:threads])
        wall, cpu = [], []
        try:
            drive(batch(min(count, 16)), OF_BATCH)  # compiles for as many lanes
            for _ in range(7 if count < 1000 else 3 if count < 10_000 else 1):
                before = time.perf_counter(), time.process_time()
                found = drive(robots, OF_BATCH)
                wall.append(time.perf_counter() - before[0])
                cpu.append(time.process_time() - before[1])
        finally:
            os.sched_setaffinity(0, whole)
        if not found.converged.all():
            raise RuntimeError("not all robots converged")
        each = 1e6 / (count * len(OF_BATCH))
        return {
            "robots": count,
            "threads": threads,
            "equilibrium, wall [us]": each * float(np.median(wall)),
            "equilibrium, CPU [us]": each * float(np.median(cpu)),
        }

    whole = os.sched_getaffinity(0)
    several = [count for count in ROBOTS if count >= 1000]
    rows = [row(count, 1) for count in ROBOTS]
    return rows + [row(count, threads) for threads in range(2, len(whole) + 1) for count in several]


def main() -> None:
    """Each size in a process of its own, then batches; write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axis", choices=(*AXES, "robots"), help="measure one axis alone; the others stay")
    parser.add_argument("--size", type=int, help="of that axis: print what is measured, write nothing")
    given = parser.parse_args()
    if given.size:
        print(json.dumps(of_size(given.axis, given.size)))
        return
    kept = json.loads(RESULT.read_text()) if given.axis else {}
    result = kept | {"cpu": cpu_name(), "cores": cores(), "load before": round(os.getloadavg()[0], 2)}
    for axis, (sizes, _) in AXES.items():
        if given.axis in (None, axis):
            result[axis] = []
            for size in sizes:
                result[axis].append(_in_new_process(axis, size))
                print(json.dumps(result[axis][-1]), flush=True)
    if given.axis in (None, "robots"):
        result |= {"robots": of_robots(), "loads": len(OF_BATCH)}
        print(json.dumps(result["robots"], indent=1))
    RESULT.write_text(json.dumps(result, indent=1) + "\n")


def _in_new_process(axis: str, size: int) -> dict[str, Any]:
    environment = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    # NumPy's eigenvalues at each load: threads that wait for one another are counted as CPU time too.
    environment["OPENBLAS_NUM_THREADS"] = "1"
    command = [sys.executable, "-m", "benchmarks.scaling", "--axis", axis, "--size", str(size)]
    run = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(run.stdout.splitlines()[-1])


if __name__ == "__main__":
    main()
