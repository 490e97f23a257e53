"""Friction on exosuits of `index-friction`: what it costs, and whether steps matter.

0 → 4 → 0 N at 101 loads without friction and with μ = 0.3; the controller's exosuit in steps of 0.02, 0.1 and
0.5 N. Writes docs/results/friction.json.

    python -m benchmarks.friction [--per-scenario 2]
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from benchmarks.balance import lost
from benchmarks.surfaces import LOADS, Driven, driven, share_apart
from exosight.control import CONTROL_SHAPE
from exosight.exosuit.index import index, index_friction
from exosight.exosuit.scenarios import sample_shapes
from exosight.system.simulation import simulate_path

RESULT = Path(__file__).parent.parent / "docs" / "results" / "friction.json"

STEPS = 0.02, 0.1, 0.5
"""[N]; all are compared with the first."""


def described(run: Driven, seconds: float) -> dict:
    """What driving the exosuits took, and how far the ways up and down are apart."""
    found = run.found
    return {
        "share of loads that converge": round(float(found.converged.mean()), 5),
        "exosuits that converge at every load": int(found.converged.all(axis=1).sum()),
        "snaps a path": round(float(np.mean([len(snaps) for snaps in run.snaps])), 2),
        "evaluations a load": round(float(found.iterations.mean()), 2),
        "share of loads with F_net over 5 mN apart": share_apart(run),
        "seconds, compilation included": round(seconds, 1),
    }


def steps() -> dict:
    """The controller's exosuit: F_net and what is lost, in steps of several sizes."""
    system = index_friction(CONTROL_SHAPE)
    sensor = [each.name for each in system.schema.sensors].index("F_net")
    result: dict = {}
    exact: dict[tuple[float, bool], float] = {}
    for step in STEPS:
        up = np.linspace(0, 4, round(4 / step) + 1)
        way = np.concatenate([up, up[-2::-1]])
        states = simulate_path(system, way[:, None])
        net = states.observation.readings[:, sensor]
        back = np.arange(len(way)) >= len(up)
        forces = {(round(u, 2), down): f for u, down, f in zip(way.tolist(), back.tolist(), net, strict=True)}
        exact = exact or forces
        apart = {at: 1e3 * abs(force - exact[at]) for at, force in forces.items()}
        result[f"{step} N"] = {
            "evaluations a load": round(float(states.equilibria.iterations.mean()), 2),
            "F_net at 2 N, up and down [N]": [round(float(forces[2.0, down]), 4) for down in (False, True)],
            "lost [mJ]": round(1e3 * float(lost(states.equilibria.history)[-1]), 4),
            "largest difference of F_net at multiples of 0.5 N [mN]": round(
                float(max(d for (u, _), d in apart.items() if round(u / 0.5, 6) % 1 == 0)), 3
            ),
            "largest difference of F_net at any load [mN]": round(float(max(apart.values())), 3),
            "loads with a difference over 1 mN": sum(bool(d > 1) for d in apart.values()),
        }
    return result


def main() -> None:
    """Drive without and with friction, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--per-scenario", type=int, default=2)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    shapes = [sample.shape for sample in sample_shapes(given.per_scenario, seed=0)]
    result: dict = {"name": "friction", "shapes": len(shapes), "loads": len(LOADS)}
    for name, made in (("index", index), ("index-friction", index_friction)):
        began = time.perf_counter()
        run = driven([made(shape) for shape in shapes])
        result[name] = described(run, time.perf_counter() - began)
        print(json.dumps(result, indent=1), flush=True)
    result["the controller's exosuit in steps of"] = steps()
    given.out.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result, indent=1), flush=True)


if __name__ == "__main__":
    main()
