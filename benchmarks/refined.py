"""Forces on pictures of rigs that differ from the model: a network alone, and refined by an identified model.

    python -m benchmarks.refined [--rigs 3]

writes docs/results/refined.json, which `python docs/figures_identification.py` puts into its page. Two
sets of rigs like `index`, of drawn tapered exosuits: as the model says, and with joints twice as stiff
and moduli less by 30 %. Each is identified from twelve pictures from 0.25 to 3 N. Then it is pictured 22
times on the way from 0 to 3 N and back, at loads that are known to 1 %. Points of all outlines are moved
by 0.3 pixels of Gaussian noise in both directions. The network is the shipped one.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from exosight.app.bench import cpu_name
from exosight.control.agreement import agreement
from exosight.control.estimator import OnnxEstimator, model_path
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import NAME, index
from exosight.exosuit.index_file import index_values
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.outlines import Outline, outline_of_picture
from exosight.rig.identification.refined import ONE_PICTURE, Refined, Refiner
from exosight.rig.identification.result import identify
from exosight.system.simulation import simulate_path
from exosight.system.system import System
from exosight.vision.scene import picture

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "refined.json"
NOISE = 0.3
"""Of an outline point, in each direction [pixels]."""
LOADS = np.linspace(0.25, 3.0, 12)[:, None]
BETWEEN = (LOADS[:-1] + LOADS[1:]) / 2
PATH = np.concatenate([BETWEEN, [[3.0]], BETWEEN[::-1]])
"""Loads [N] of the pictures that are read; that at 3 N is not counted."""
LOAD_ERROR = ONE_PICTURE.gain
LEVEL = 0.9
SETS = {"as the model": (1.0, 1.0), "stiffer joints, softer exosuit": (2.0, 0.7)}
"""Factors of joint stiffness and of Young's modulus."""


def drawn(number: int, joints: float, modulus: float) -> tuple[Exosuit, Exosuit]:
    """Exosuit number 0, 1, 2 … as the model has it, and the rig."""
    random = np.random.default_rng([23, number])
    taper = Linear(r0=random.uniform(0.0075, 0.0095), r1=random.uniform(0.004, 0.006))
    worn = Exosuit(ExosuitShape(taper, length=random.uniform(0.085, 0.105)))
    stiffness = tuple(joints * each for each in worn.finger.joint_stiffness)
    finger = replace(worn.finger, joint_stiffness=stiffness)
    return worn, replace(worn, finger=finger, young=modulus * worn.young)


def outline(each: UInt8[np.ndarray, "height width"], system: System, random: np.random.Generator) -> Outline:
    """The outline in a picture, with noise."""
    found = outline_of_picture(each, [tube.shade for tube in system.tubes])
    return replace(found, points=found.points + random.normal(scale=NOISE, size=found.points.shape))


def pictured(system: System, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pictures and readings of the estimated sensors along a path of loads."""
    states = simulate_path(system, path)
    axes = {name: np.asarray(axis) for name, axis in states.observation.axes.items()}
    places = system.schema.output_indices()
    return picture(system, axes), np.asarray(states.observation.readings)[:, places]


def measure(number: int, name: str, network: OnnxEstimator) -> list[dict[str, Any]]:
    """Every picture of a rig."""
    worn, rig = drawn(number, *SETS[name])
    random, system = np.random.default_rng([24, number]), index(rig)
    pictures, _ = pictured(system, LOADS)
    outlines = tuple(outline(each, system, random) for each in pictures)
    begun = time.process_time()
    found = identify(index_values(worn), Measurements(LOADS, outlines))
    identified = time.process_time() - begun
    begun = time.process_time()
    refiner = Refiner(found.named("rig"))
    prepared = time.process_time() - begun
    pictures, true = pictured(system, PATH)
    reading = network.read(pictures, LEVEL)
    places = refiner.system.schema.output_indices()
    before: Refined | None = None
    rows = []
    for k, load in enumerate(PATH[:, 0]):
        said = np.array([load * (1 + random.normal(scale=LOAD_ERROR))])
        begun = time.process_time()
        before = refiner.refine(outline(pictures[k], system, random), said, before)
        seconds = time.process_time() - begun
        if load == PATH.max():
            continue
        one = network.read(pictures[k : k + 1], LEVEL)
        values, deviations = before.readings[places], before.deviations[places]
        agreed = agreement(system.schema.outputs, one, LEVEL, values, deviations)
        rows.append(
            {
                "rig": number,
                "set": name,
                "load": float(load),
                "true": true[k].tolist(),
                "network": reading.forces[k].tolist(),
                "refined": values.tolist(),
                "deviation": deviations.tolist(),
                "net deviation": float(before.deviations[refiner.system.schema.index("F_net")]),
                "misfit": before.misfit,
                "OOD score": float(one.ood_score[0]),
                "disagreement score": agreed.score,
                "CPU seconds": [identified, prepared, seconds],
            }
        )
    return rows


def main() -> None:
    """Measure and write, rig by rig."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rigs", type=int, default=3)
    network = OnnxEstimator.load(model_path(None, NAME), alone=True)
    rows: list[dict[str, Any]] = []
    for number in range(parser.parse_args().rigs):
        for name in SETS:
            rows += measure(number, name, network)
            print(f"rig {number}, {name}: {time.process_time():.0f} s", flush=True)
        result = {"cpu": cpu_name(), "noise [pixels]": NOISE, "load error": LOAD_ERROR, "rows": rows}
        RESULTS.write_text(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
