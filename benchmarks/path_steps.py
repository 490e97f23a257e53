"""Does a state depend on the steps that lead to it? 0 → 4 → 0 N in steps of several sizes, on 110 exosuits.

Writes docs/results/path_steps.json after each size, so that what was measured stands if the rest is stopped.

    python -m benchmarks.path_steps [--shapes 110] [--steps 0.5 0.1 0.02]
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from exosight.exosuit.assembly import MAX_FORCE, Exosuit, assemble
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Equilibria, Robot, Snap, locate_snaps
from exosight.mechanics.metric import metric_of

RESULT = Path(__file__).parent.parent / "docs" / "results" / "path_steps.json"

SAME = 1e-9
"""Largest difference of two states that are the same, relative to the largest pose of the path."""

Driven = tuple[Equilibria, list[list[Snap]]]


def there_and_back(step: float) -> np.ndarray:
    """0 → 4 → 0 N, (loads, 1)."""
    up = np.linspace(0, MAX_FORCE, round(MAX_FORCE / step) + 1)
    return np.concatenate([up, up[-2::-1]])[:, None]


def described(driven: Driven, seconds: float) -> dict:
    """What one size of step took, and what was found."""
    found, snaps = driven
    there = (found.q.shape[1] + 1) // 2
    on_the_way_up = found.iterations[:, 1:there]
    smooth = ~found.snapped[:, 1:there]
    return {
        "evaluations a load, 0 to 4 N": round(float(on_the_way_up.mean()), 2),
        "evaluations a load without a snap": round(float(on_the_way_up[smooth].mean()), 2),
        "median of these": float(np.median(on_the_way_up[smooth])),
        "most evaluations for one load": int(found.iterations.max()),
        "snaps a path": round(float(np.mean([len(s) for s in snaps])), 2),
        "states that did not converge": int((~found.converged).sum()),
        "loads reported as tied": int(found.tied.sum()),
        "seconds, compilation included": round(seconds, 1),
    }


def differences(robots: list[Robot], coarse: Driven, fine: Driven, loads: np.ndarray) -> dict:
    """Where the states at the loads of the coarse path differ, in the elastic norm."""
    every = (fine[0].q.shape[1] - 1) // (coarse[0].q.shape[1] - 1)
    largest, differing = [], []
    for i, robot in enumerate(robots):
        factor = np.linalg.cholesky(np.asarray(metric_of(robot)))
        expected, same = coarse[0].q[i] @ factor, fine[0].q[i, ::every] @ factor
        error = np.linalg.norm(same - expected, axis=1) / np.linalg.norm(expected, axis=1).max()
        largest.append(float(error.max()))
        for k in np.flatnonzero(error > SAME)[:1]:
            before = slice(0, k * every + 1)
            differing.append(
                {
                    "shape": i,
                    "first at load [N]": round(float(loads[k, 0]), 6),
                    "on the way": "up" if k < len(loads) / 2 else "down",
                    "loads that differ": int((error > SAME).sum()),
                    "largest difference": float(error.max()),
                    "tied before": bool(fine[0].tied[i, before].any() or coarse[0].tied[i, : k + 1].any()),
                }
            )
    agreeing = [error for error in largest if error <= SAME]
    return {
        "share of shapes that agree": round(len(agreeing) / len(robots), 4),
        "worst difference of those": max(agreeing, default=0.0),
        "worst difference of all": max(largest),
        "shapes that differ": differing,
    }


def main() -> None:
    """Drive, compare with the first size of step, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=110)
    parser.add_argument("--steps", type=float, nargs="+", default=[0.5, 0.1, 0.02])
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    robots = [assemble(Exosuit(sample.shape)) for sample in sample_shapes(10, seed=0)][: given.shapes]
    result: dict = {"name": "path_steps", "shapes": len(robots), "steps": {}, "against the first": {}}
    first: Driven | None = None
    for step in given.steps:
        began = time.perf_counter()
        driven = locate_snaps(robots, there_and_back(step))
        result["steps"][f"{step} N"] = described(driven, time.perf_counter() - began)
        if first is None:
            first = driven
        else:
            loads = there_and_back(given.steps[0])
            result["against the first"][f"{step} N"] = differences(robots, first, driven, loads)
        given.out.write_text(json.dumps(result, indent=1) + "\n")
        print(json.dumps(result, indent=1), flush=True)


if __name__ == "__main__":
    main()
