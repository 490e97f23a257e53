"""What a network makes of other exosuits, fingers and cameras than those it learned from.

    python -m benchmarks.shifts DATA [--model MODEL] [--out FILE]

Every third exosuit of the network's own test part of DATA is worn and seen anew, one thing changed at a time,
evenly between the limits below. Beside the errors: whether intervals that promise 90 % still hold so much,
how many frames the OOD score turns away, and the errors on the others.
"""

import argparse
import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exosight.app.data import Data, load
from exosight.app.provenance import test_part
from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.dataset.config import GenerateConfig
from exosight.dataset.designs import config_of, design_set
from exosight.dataset.frames import Frames, concatenate
from exosight.dataset.simulation import simulate_designs
from exosight.evaluation import evaluate_intervals, score
from exosight.exosuit.variation import PlantVariation
from exosight.system.design import Design
from exosight.vision import AppearanceVariation, LightingVariation

RESULT = Path(__file__).parents[1] / "docs" / "results" / "accuracy" / "shifts.json"
PROMISED = 0.9
GROUP = 64  # designs simulated together: bounds the memory

Variation = PlantVariation | LightingVariation | AppearanceVariation
SHIFTS: dict[str, Variation] = {
    "nothing": PlantVariation(),
    "modulus 0.9 to 1.1 times": PlantVariation(young=(0.9, 1.1)),
    "modulus 0.5 to 2 times": PlantVariation(young=(0.5, 2.0)),
    "joint stiffness 0.9 to 1.1 times": PlantVariation(joint_stiffness=(0.9, 1.1)),
    "joint stiffness 0.5 to 2 times": PlantVariation(joint_stiffness=(0.5, 2.0)),
    "links ±3 %, radius ±5 %": PlantVariation(link_length=(0.97, 1.03), finger_radius=(0.95, 1.05)),
    "mount ±1 mm, ±1°": PlantVariation(mount_offset=(-0.001, 0.001), mount_angle=(-0.0175, 0.0175)),
    "camera moved by up to 2 % of the image": AppearanceVariation(shift=0.02),
    "camera moved by up to 10 %": AppearanceVariation(shift=0.1),
    "camera nearer or farther by up to 3 %": AppearanceVariation(zoom=0.03),
    "camera nearer or farther by up to 15 %": AppearanceVariation(zoom=0.15),
    "camera turned by up to 2°": AppearanceVariation(roll=0.035),
    "camera tilted by up to 10°": AppearanceVariation(tilt=0.175),
    "lens distortion up to 5 %": AppearanceVariation(distortion=0.05),
    "lamp up to 30° away": LightingVariation(lamp=0.52),
    "shades of finger and exosuit": LightingVariation(shades={"finger": (0.55, 0.8), "exosuit": (0.2, 0.5)}),
    "plain background of any gray": AppearanceVariation(backgrounds=("flat",)),
    "uneven background": AppearanceVariation(backgrounds=("smooth",)),
    "blur up to 1.5 pixels": AppearanceVariation(blur=1.5),
    "objects hide up to 5 %": AppearanceVariation(occlusions=("bar", "ellipse"), occluded=(0.01, 0.05)),
}


def changed(config: GenerateConfig, shift: Variation) -> GenerateConfig:
    """The configuration of a dataset with one thing more that varies."""
    match shift:
        case PlantVariation():
            return replace(config, plant=shift)
        case LightingVariation():
            return replace(config, lighting=shift)
        case AppearanceVariation():
            return replace(config, appearance=shift)


def seen(config: GenerateConfig, designs: list[Design]) -> Frames:
    """The frames of some designs of the published system."""
    every = design_set(config, None)
    groups = [designs[i : i + GROUP] for i in range(0, len(designs), GROUP)]
    return concatenate([simulate_designs(config, every, group)[0] for group in groups])


def judge(estimator: OnnxEstimator, frames: Frames) -> dict[str, Any]:
    """Errors, intervals and trust on the frames of one shift."""
    reading, schema, true = estimator.read(frames.images, PROMISED), frames.schema, frames.labels
    found = score(schema, true, reading.forces)
    inside = evaluate_intervals(schema, true, reading.forces, {PROMISED: (reading.low, reading.high)})
    trusted = reading.ood_score <= 1
    of_trusted = score(schema, true[trusted], reading.forces[trusted]) if trusted.sum() > 1 else None
    return {
        "frames": len(frames),
        "r": found.r.mean,
        "r_lowest": float(np.nanmin([output.r for output in found.outputs])),
        "rms_percent": found.rms_percent.mean,
        "rmse": found.rmse.mean,
        "net_rmse": found.sums[0].rmse,
        "inside_percent": 100 * float(inside.at(PROMISED).mean()),
        "flagged_percent": 100 * float(np.mean(~trusted)),
        "net_rmse_trusted": of_trusted.sums[0].rmse if of_trusted else None,
    }


def run(data: Data, estimator: OnnxEstimator, shifts: Iterable[str] = SHIFTS) -> dict[str, dict[str, Any]]:
    """Name of each shift → what `judge` says."""
    config = config_of(data.manifest)
    index, _ = test_part(estimator.card, data)
    known = set(np.unique(data.frames.design[index])[::3].tolist())
    designs = [design for design in data.manifest.designs if design.number in known]
    found = {}
    for name in shifts:
        found[name] = judge(estimator, seen(changed(config, SHIFTS[name]), designs))
        print(name, found[name], flush=True)
    return found


def main() -> None:
    """Write the numbers as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--model", type=Path, default=DEFAULT_MODEL)
    parser.add_argument("--out", type=Path, default=RESULT)
    chosen = parser.parse_args()
    found = run(load(chosen.data), OnnxEstimator.load(chosen.model, threads=2))
    chosen.out.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
