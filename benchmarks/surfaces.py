"""Contact of surfaces on exosuits of `index`: does the way back differ, and do the rod's points matter?

0 → 4 → 0 N at 101 loads, with 8 points an element, and with 16. Writes docs/results/surfaces.json.

    python -m benchmarks.surfaces [--shapes 110]
"""

import argparse
import json
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from exosight.exosuit.assembly import Exosuit, assemble
from exosight.exosuit.index import with_surfaces
from exosight.exosuit.published import system_of
from exosight.exosuit.scenarios import SampledShape, sample_shapes
from exosight.exosuit.shapes import ExosuitShape
from exosight.mechanics import Equilibria, Gauss, Snap, locate_snaps
from exosight.system.observation import observe
from exosight.system.system import System, stack_systems

RESULT = Path(__file__).parent.parent / "docs" / "results" / "surfaces.json"

LOADS = np.concatenate([np.linspace(0, 4, 51), np.linspace(0, 4, 51)[-2::-1]])[:, None]
"""0 → 4 → 0 N."""
DIFFERENT = 0.005
"""Difference of F_net between the ways up and down that counts [N]."""
LEAST = 0.02
"""F_net from which shares of it are taken [N]."""


class Driven(NamedTuple):
    """Exosuits along the path, with F_net (shapes, loads) and zones C1 … (shapes, loads, zones) [N]."""

    found: Equilibria
    snaps: list[list[Snap]]
    net: np.ndarray
    zones: np.ndarray


def driven(systems: list[System], loads: Float[np.ndarray, "loads 1"] = LOADS) -> Driven:
    """Every system along a path of loads [N]."""
    found, snaps = locate_snaps([system.robot for system in systems], loads)
    readings = np.asarray(observe(stack_systems(systems), found.q, found.history).readings)
    names = [sensor.name for sensor in systems[0].schema.sensors]
    zones = [i for i, name in enumerate(names) if name in systems[0].schema.outputs]
    return Driven(found, snaps, readings[..., names.index("F_net")], readings[..., zones])


def with_points(samples: list[SampledShape], points: int) -> Driven:
    """Every exosuit with so many points an element."""
    return driven([_index(sample.shape, Gauss(5, points)) for sample in samples])


def _index(shape: ExosuitShape, points: Gauss) -> System:
    """`index` with other points along its rod."""
    worn = Exosuit(shape)
    return with_surfaces(system_of(assemble(worn, points), worn.finger), worn)


def there_and_back(of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (shapes, loads, …) on the way up, and on the way down at the same loads."""
    there = len(LOADS) // 2 + 1
    return of[:, :there], of[:, : there - 2 : -1]


def share_apart(run: Driven) -> float:
    """Share of loads at which F_net differs between up and down."""
    up, down = there_and_back(run.net)
    return round(float((np.abs(up - down) > DIFFERENT).mean()), 4)


def reversal(run: Driven) -> dict:
    """Ways up and down at equal loads."""
    (q, back), (energy, returned) = (
        there_and_back(np.asarray(each)) for each in (run.found.q, run.found.energy)
    )
    same = np.abs(q - back).max(axis=-1) < 1e-6 * np.abs(q).max(axis=(1, 2))[:, None]
    stored = np.abs(energy - returned) / np.abs(energy).max(axis=1, keepdims=True)
    return {
        "states that did not converge": int((~run.found.converged).sum()),
        "snaps a path": round(float(run.found.snapped.sum(axis=1).mean()), 2),
        "share of loads with F_net over 5 mN apart": share_apart(run),
        "share of loads at the same pose": round(float(same.mean()), 4),
        "largest difference of energy at the same pose, in the path's largest": float(stored[same].max()),
    }


def refinement(coarse: Driven, fine: Driven) -> dict:
    """Twice the points along the rod, at loads before the first snap of either and where F_net counts."""
    before = np.cumsum(coarse.found.snapped | fine.found.snapped, axis=1) == 0
    off = before & (coarse.net > LEAST)
    net = np.abs(fine.net - coarse.net)[off] / coarse.net[off]
    zones = np.abs(fine.zones - coarse.zones)[off].max(axis=-1) / coarse.net[off]
    apart = (net >= 0.005) | (zones >= 0.015)
    force, alone = (
        coarse.net[off][apart],
        coarse.zones[off][apart].max(axis=-1) > 0.8 * coarse.net[off][apart],
    )
    return {
        "states before the first snap": int(off.sum()),
        "share with F_net within 0.5 %": round(float((net < 0.005).mean()), 4),
        "share with every zone within 1.5 % of F_net": round(float((zones < 0.015).mean()), 4),
        "F_net: median, 99 %, largest change": [float(np.quantile(net, p)) for p in (0.5, 0.99, 1)],
        "worst zone in F_net: median, 99 %, largest": [float(np.quantile(zones, p)) for p in (0.5, 0.99, 1)],
        "beyond either": {
            "states": int(apart.sum()),
            "share with over 0.8 of F_net in one zone": round(float(alone.mean()), 4),
            "F_net: median, 90 %, largest [N]": [float(np.quantile(force, p)) for p in (0.5, 0.9, 1)],
            "change of F_net: median, 90 %, largest [mN]": [
                1e3 * float(np.quantile(net[apart] * force, p)) for p in (0.5, 0.9, 1)
            ],
        },
    }


def main() -> None:
    """Drive with either number of points, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=110)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    samples = sample_shapes(10, seed=0)[: given.shapes]
    result: dict = {"name": "surfaces", "shapes": len(samples), "loads": len(LOADS)}
    began = time.perf_counter()
    coarse = with_points(samples, 8)
    result["up and down"] = reversal(coarse)
    print(json.dumps(result, indent=1), time.perf_counter() - began, flush=True)
    result["twice the points"] = refinement(coarse, with_points(samples, 16))
    given.out.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1), time.perf_counter() - began, flush=True)


if __name__ == "__main__":
    main()
