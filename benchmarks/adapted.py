"""Networks on pictures of another set-up than the shipped one learned from, before and after adapting to it.

    exosight generate --out OTHER --per-scenario 125 --seed 7 --plant.joint-stiffness 1.5 1.5 \\
        --plant.link-length 1.05 1.05 --camera.metres-per-pixel 0.00105 --lighting.exosuit-shade 0.45 0.45
    exosight train --data OTHER --out adapted --epochs 4 --pretrained shipped
    exosight train --data OTHER --out anew --epochs 4
    python -m benchmarks.adapted OTHER adapted/model.onnx anew/model.onnx --name other

    exosight generate --out MANY --per-scenario 125 --seed 8 --appearance.shift 0.04 --appearance.roll 0.1 \\
        --appearance.zoom 0.08 --appearance.tilt 0.15 --appearance.distortion 0.05 --lighting.lamp 0.5 \\
        --lighting.finger-shade 0.55 0.8 --lighting.exosuit-shade 0.2 0.5
    exosight train --data MANY --out adapted --epochs 8 --pretrained shipped
    python -m benchmarks.adapted MANY adapted/model.onnx --name many

Stiffness and cameras that are never learned:

    exosight generate --out SOFT --per-scenario 125 --seed 9 --plant.young 0.5 2
    exosight train --data SOFT --out held_out --epochs 4 --pretrained shipped \\
        --protocol variation --held-out plant.young
    python -m benchmarks.adapted SOFT held_out/model.onnx --name stiffness

    exosight train --data MANY --out held_out --epochs 8 --pretrained shipped \\
        --protocol variation --held-out appearance.zoom
    python -m benchmarks.adapted MANY held_out/model.onnx --name cameras

The shipped one and those named are judged on the same frames: what was kept for testing from the first named.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.shifts import judge
from exosight.app.data import load
from exosight.app.provenance import test_part
from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.dataset.frames import take

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "accuracy"


def run(folder: Path, models: list[Path]) -> dict[str, dict[str, Any]]:
    """Name of each network's folder, and `shipped` → what it is judged to be."""
    data = load(folder)
    test, _ = test_part(OnnxEstimator.load(models[0]).card, data)
    kept = take(data.frames, test)
    places = {"shipped": DEFAULT_MODEL, **{path.parent.name: path for path in models}}
    return {name: judge(OnnxEstimator.load(path), kept) for name, path in places.items()}


def main() -> None:
    """Write the numbers as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("models", nargs="+", type=Path, help="model.onnx of a run")
    parser.add_argument("--name", required=True, help="of the file, adapted_NAME.json")
    chosen = parser.parse_args()
    path = RESULTS / f"adapted_{chosen.name}.json"
    path.write_text(json.dumps(run(chosen.data, chosen.models), indent=1) + "\n")


if __name__ == "__main__":
    main()
