"""Balance of energy on exosuits: what the loads supply against what is stored and lost.

0 → 4 → 0 N in steps of several sizes with friction, with creep and with both, on exosuits with and without
snaps. Writes docs/results/balance.json.

    python -m benchmarks.balance
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.surfaces import LOADS
from exosight.exosuit.assembly import ROD
from exosight.exosuit.index import index, index_friction
from exosight.exosuit.scenarios import sample_shapes
from exosight.exosuit.shapes import ExosuitShape
from exosight.mechanics import Robot, locate_snaps
from exosight.mechanics.friction import Held
from exosight.mechanics.relaxation import relaxation
from exosight.mechanics.term import Memories

RESULT = Path(__file__).parent.parent / "docs" / "results" / "balance.json"

SHAPES = 0, 2, 3, 4, 14, 21
"""Of the two exosuits of each scenario, seed 0; two of them snap often."""
PARTS = 1, 4, 16, 64, 256
"""Into how many parts each step of 0.08 N is divided."""
COMPARED = 16, 64
"""Those of creep, and of friction and creep."""
SHARE, TIME, RATE = 0.2, 2.0, 1.0
"""Of what creeps [-], its time of relaxation [s], and how fast the load changes [N/s]."""


def lost(history: Memories) -> np.ndarray:
    """Work that friction has taken so far, of (..., points, 12) numbers remembered: (...) [J]."""
    memory = np.asarray(history[0])
    points = np.asarray(Held.of(memory.reshape(-1, memory.shape[-1])).dissipated)
    return points.reshape(memory.shape[:-1]).sum(axis=-1)


def with_friction(shape: ExosuitShape) -> Robot:
    """The exosuit on the finger, μ = 0.3."""
    return index_friction(shape).robot


def with_creep(shape: ExosuitShape) -> Robot:
    """The same without friction; a share of the exosuit's stiffness relaxes."""
    return _creeping(index(shape).robot)


def with_both(shape: ExosuitShape) -> Robot:
    """Friction and creep."""
    return _creeping(index_friction(shape).robot)


def _creeping(robot: Robot) -> Robot:
    return Robot(robot.bodies, (*robot.terms, relaxation(ROD, [SHARE], [TIME], 1, robot)))


def balance(shapes: list[ExosuitShape], made: Callable[[ExosuitShape], Robot], parts: int) -> dict:
    """One kind of exosuit in one size of steps.

    Where points begin to touch or to slip within a step, work and losses are of second order.
    """
    number = np.arange(parts * (len(LOADS) - 1) + 1) / parts
    path = np.interp(number, np.arange(len(LOADS)), LOADS[:, 0])
    time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path)))]) / RATE
    robots = [made(shape) for shape in shapes]
    loads = np.stack([path, time], axis=1) if robots[0].clocks else path[:, None]
    found, snaps = locate_snaps(robots, loads)
    energy, spent, work = (x - x[:, :1] for x in (found.energy, found.dissipated, found.supplied))
    in_snaps = np.array([sum(snap.energy - snap.taken for snap in own) for own in snaps])
    off = np.abs(energy + spent - work)[:, -1] / work[:, -1]
    calm = np.array([not own for own in snaps])
    result = {
        "step [N]": round(float(path[1]), 6),
        "loads": int(found.converged.size),
        "loads that converge": int(found.converged.sum()),
        "snaps": sum(map(len, snaps)),
        "work [mJ]": round(1e3 * float(work[:, -1].sum()), 4),
        "lost in snaps [mJ]": round(1e3 * float(in_snaps.sum()), 4),
        "lost otherwise [mJ]": round(1e3 * float((spent[:, -1] - in_snaps).sum()), 4),
        "least lost in a step [mJ]": 1e3 * float(np.diff(spent, axis=1).min()),
        "paths without a snap": int(calm.sum()),
        "difference of each path, relative": off.tolist(),
        "largest difference there, relative": float(off[calm].max(initial=0)),
        "largest difference on paths with snaps, relative": float(off[~calm].max(initial=0)),
    }
    return result


def main() -> None:
    """Drive in each size of steps, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    every = [sample.shape for sample in sample_shapes(2, seed=0)]
    shapes = [every[i] for i in SHAPES]
    result: dict = {"name": "balance", "shapes": len(shapes), "kinds": {}}
    kinds = ("friction", with_friction, PARTS), ("creep", with_creep, COMPARED), ("both", with_both, COMPARED)
    for name, made, several in kinds:
        result["kinds"][name] = []
        for parts in several:
            result["kinds"][name].append(balance(shapes, made, parts))
            print(name, json.dumps(result["kinds"][name][-1], indent=1), flush=True)
    given.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
