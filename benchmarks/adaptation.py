"""A network adapted to cameras that have moved, with no, 10, 30 and 100 labels.

    exosight generate --out DATA --system index --per-scenario 4 --frames 30 --seed 77 \\
        --camera.width 256 --camera.height 256 --camera.metres-per-pixel 0.00055
    python -m benchmarks.adaptation DATA --write

Half of the exosuits are seen by one camera, at 64×64 pixels, and a network learns three sums of their contact
forces from it, as from a rig of one's own. The other half is seen by cameras that were turned by 12° to 25°,
brought nearer or farther by 12 % to 25 %, shifted by up to 12 % of a side and tilted, with less contrast and
with noise. Every network is judged on the same sequences, which nothing was learned from.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from exosight.app.adaptation import adapt
from exosight.app.bench import cpu_name
from exosight.app.data import Data, divided, load
from exosight.app.main import main as exosight
from exosight.control.estimator import OnnxEstimator
from exosight.evaluation import score

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "adaptation.json"
CAMERAS, LABELS = 4, (0, 10, 30, 100)
SIDE, SMALL = 256, 64
CHANNELS = {"proximal": (0, 2), "middle": (2, 4), "distal": (4, 7)}
"""Contacts whose forces are summed."""


def moved(rng: np.random.Generator) -> np.ndarray:
    """A homography of pixels."""
    corners = np.array([[40, 40], [216, 40], [216, 216], [40, 216]], np.float32)
    turn = np.deg2rad(rng.uniform(12, 25)) * rng.choice([-1, 1])
    scale = 1 + rng.uniform(0.12, 0.25) * rng.choice([-1, 1])
    matrix = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shift, tilt = rng.uniform(-30, 30, 2), rng.uniform(-15, 15, (4, 2))
    there = (corners - SIDE / 2) @ matrix.T + SIDE / 2 + shift + tilt
    return cv2.getPerspectiveTransform(corners, there.astype(np.float32))


def write_pictures(data: Data, rows: np.ndarray, seed: int | None, folder: Path) -> None:
    """Pictures and their table; of the former camera without a seed."""
    rng = np.random.default_rng(seed)
    folder.mkdir()
    homography = np.eye(3) if seed is None else moved(rng)
    lines = [",".join(["picture", "run", *(f"{name} [N]" for name in CHANNELS)])]
    for row in rows:
        seen = cv2.warpPerspective(
            data.frames.images[row], homography, (SIDE, SIDE), borderMode=cv2.BORDER_REPLICATE
        )
        small = cv2.resize(seen, (SMALL, SMALL), interpolation=cv2.INTER_AREA)
        if seed is not None:
            small = np.clip(0.85 * small + 12 + rng.normal(0, 2, small.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{row:05d}.png"), small)
        forces = (data.frames.labels[row, a:b].sum() for a, b in CHANNELS.values())
        lines.append(
            ",".join([f"{row:05d}.png", str(data.frames.design[row]), *(f"{f:.6f}" for f in forces)])
        )
    (folder / "forces.csv").write_text("\n".join(lines) + "\n")


def run(folder: Path) -> dict[str, Any]:
    """Accuracy of the network at its own camera, and at each other before and after."""
    data = load(folder)
    designs = np.random.default_rng(5).permutation(np.unique(data.frames.design))
    own = np.isin(data.frames.design, designs[: len(designs) // 2])
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        write_pictures(data, np.flatnonzero(own), None, place / "pictures")
        exosight(["import", str(place / "pictures"), "--out", str(place / "data")])
        exosight(["train", "--data", str(place / "data"), "--out", str(place / "run")])
        model = place / "run" / "model.onnx"
        former = load(place / "data")
        test = divided(former, "design", 0, None).test
        read = OnnxEstimator.load(model).estimate(former.frames.images[test])
        at_home = score(former.frames.schema, former.frames.labels[test], read).r.mean
        cameras = []
        for number in range(CAMERAS):
            write_pictures(data, np.flatnonzero(~own), number, place / f"pictures_{number}")
            exosight(["import", str(place / f"pictures_{number}"), "--out", str(place / f"data_{number}")])
            there = load(place / f"data_{number}")
            cameras.append([_adapted(there, model, count, place) for count in LABELS])
    return {"machine": cpu_name(), "r_at_its_own_camera": at_home, "cameras": cameras}


def _adapted(data: Data, model: Path, labels: int, place: Path) -> dict[str, Any]:
    began = time.perf_counter()
    split = divided(data, "design", 0, None)
    found = adapt(data, split, model, labels, "auto", 0, place, "adapted.onnx", lambda done, total: None)
    assert found.before is not None
    return {
        "labels": labels,
        "method": found.chosen.method,
        "registered": found.chosen.registered,
        "r_before": found.before.scores.r.mean,
        "r_after": found.after.scores.r.mean,
        "inside_90": float(found.after.inside.mean()),
        "flagged": found.after.flagged,
        "seconds": time.perf_counter() - began,
    }


def main() -> None:
    """Print the numbers, or write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--write", action="store_true", help="into docs/results/adaptation.json")
    chosen = parser.parse_args()
    text = json.dumps(run(chosen.data), indent=1) + "\n"
    if chosen.write:
        RESULTS.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
