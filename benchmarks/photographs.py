"""Networks on path-traced pictures that none of them has seen, of exosuits of a seed that none learned from.

    python -m benchmarks.photographs --data FOLDER [--model index-photo]

draws 80 pictures each before a plain wall, textured desks and clutter with Mitsuba 3 into the folder (once;
some ten minutes), reads them with the networks, and writes docs/results/photographs.json.
No network may learn from them.
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from exosight.control.estimator import NAMED_MODELS, OnnxEstimator
from exosight.dataset.config import GenerateConfig
from exosight.dataset.designs import design_set, draw_designs
from exosight.dataset.frames import Frames, take
from exosight.dataset.simulation import simulate_designs
from exosight.evaluation.metrics import Scores, score
from exosight.evaluation.ood_detection import auroc
from exosight.learning.large_error import LIKELY
from exosight.system.camera import Camera
from exosight.system.observation import body_axes
from exosight.vision.photo import photo
from exosight.vision.renderer import Tube
from exosight.vision.scene import tubes

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "photographs.json"
PICTURE = RESULTS.parents[1] / "images" / "photographs.png"
CONFIG = GenerateConfig(system="index", per_scenario=8, frames=20, seed=4711)
"""Poses and forces of the pictures, and the clean pictures beside them."""
EACH = 80
"""Pictures of each kind."""
ACROSS = 8
"""Pictures in a row of the page's picture."""
LARGE = 0.05
"""Error of F_net that counts as large [N]."""


def poses() -> tuple[Frames, list[tuple[Tube, ...]], Camera]:
    """Frames of CONFIG, as many as there are pictures, with the bodies of each, and the camera."""
    designs = design_set(CONFIG, None)
    drawn = draw_designs(CONFIG, designs)
    frames, _ = simulate_designs(CONFIG, designs, drawn)
    frames = take(frames, np.random.default_rng(CONFIG.seed).choice(len(frames), 3 * EACH, replace=False))
    systems = [designs.build(drawn[number]) for number in frames.design.tolist()]
    bodies = [
        tubes(system, {name: np.asarray(axis) for name, axis in body_axes(system, q[None]).items()})
        for system, q in zip(systems, frames.pose, strict=True)
    ]
    return frames, bodies, designs.camera


def draw(folder: Path) -> None:
    """The pictures, as NUMBER.npy, with pictures.npz of all at the end; goes on where it was stopped."""
    from benchmarks.path_traced import KINDS, picture

    folder.mkdir(parents=True, exist_ok=True)
    frames, bodies, camera = poses()
    images = np.empty_like(frames.images)
    for k, (finger, exosuit) in enumerate(bodies):
        path = folder / f"{k:03d}.npy"
        if not path.exists():
            own = {
                "finger": (finger.centres[0], finger.radii[0]),
                "exosuit": (exosuit.centres[0], exosuit.radii[0]),
            }
            with tempfile.TemporaryDirectory() as meshes:
                rng = np.random.default_rng([CONFIG.seed, k])
                np.save(path, picture(rng, KINDS[k % 3], own, Path(meshes)))
        images[k] = np.load(path)
    learned = [
        photo(own, camera, frames.images[k : k + 1], (CONFIG.seed,), np.array([k]))[0]
        for k, own in enumerate(bodies[: 2 * ACROSS])
    ]
    rows = [*learned, *(images[k] for kind in range(3) for k in range(kind, 3 * ACROSS, 3))]
    grid = np.reshape(rows, (5, ACROSS, *images.shape[1:])).swapaxes(1, 2)
    cv2.imwrite(str(PICTURE), grid.reshape(5 * images.shape[1], -1))
    np.savez(
        folder / "pictures.npz",
        images=images,
        clean=frames.images,
        labels=frames.labels,
        kinds=np.array(KINDS)[np.arange(len(frames)) % 3],
    )


def accuracy(scores: Scores) -> dict[str, float]:
    """r and RMSE of F_net [-, N], mean r of the zones and r of the last one."""
    return {
        "r_net": round(scores.sums[0].r, 4),
        "rmse_net": round(scores.sums[0].rmse, 4),
        "r_zones": round(scores.r.mean, 4),
        "r_last": round(scores.outputs[-1].r, 4),
    }


def measure(model: Path, folder: Path) -> dict[str, Any]:
    """A network on each kind of picture, and on the clean ones of the same frames."""
    network = OnnxEstimator.load(model)
    schema = network.card.schema
    with np.load(folder / "pictures.npz") as file:
        images, clean, labels, kinds = (file[name] for name in ("images", "clean", "labels", "kinds"))
    found: dict[str, Any] = {}
    groups = {str(kind): (images[kinds == kind], labels[kinds == kind]) for kind in dict.fromkeys(kinds)}
    for name, (shown, truth) in (groups | {"all": (images, labels), "clean": (clean, labels)}).items():
        reading = network.read(shown)
        error = (reading.forces - truth) @ schema.weights("F_net")
        scores = score(schema, truth, reading.forces)
        held = (reading.low <= truth) & (truth <= reading.high)
        above = reading.forces > 0
        large = np.abs(error) > LARGE
        both = large.any() and not large.all()
        width = (reading.high - reading.low) @ schema.weights("F_net")
        probable = reading.error_probability
        assert probable is not None
        found[name] = {
            "frames": len(shown),
            **accuracy(scores),
            "r_but_last": round(float(np.mean([each.r for each in scores.outputs[:-1]])), 4),
            "pressed_last": int((truth[:, -1] > 0).sum()),
            "held": round(float(held[above].mean()), 3),
            "held_all": round(float(held.mean()), 3),
            "large": round(float(large.mean()), 3),
            "probability": round(float(probable.mean()), 3),
            "flagged": round(float(np.mean(probable > LIKELY)), 3),
            "ood": round(float(np.mean(reading.ood_score > 1)), 3),
            "auroc_probability": round(auroc(probable[~large], probable[large]), 3) if both else None,
            "auroc": round(auroc(reading.ood_score[~large], reading.ood_score[large]), 3) if both else None,
            "auroc_width": round(auroc(width[~large], width[large]), 3) if both else None,
        }
    return found


def main() -> None:
    """Draw what is missing, measure, write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--model", nargs="+", choices=list(NAMED_MODELS), default=["index"])
    given = parser.parse_args()
    if not (given.data / "pictures.npz").exists():
        draw(given.data)
    found = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for model in given.model:
        found[model] = measure(NAMED_MODELS[model], given.data)
        for kind, values in found[model].items():
            print(model, kind, values)
    RESULTS.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
