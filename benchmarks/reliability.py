"""Whether a network's probability of a large error follows its errors, and whether its causes are right.

    python -m benchmarks.reliability --data FOLDER --model index index-photo

reads clean pictures of a dataset that no network learned from (`exosight generate --system index
--per-scenario 6 --frames 20 --seed 902`), disturbed in ways that the calibration did not have, and writes
docs/results/reliability.json; with --photos FOLDER photo-like pictures as well (`--per-scenario 8 --frames 20
--seed 901 --photo`). With --fit FOLDER probability and causes are first fitted anew on the even designs of
another dataset (of photo-like pictures: `--per-scenario 30 --seed 101 --photo`) or of the same one, and
written into the network's file: what is measured are the odd designs.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.photographs import accuracy
from exosight.app.data import load
from exosight.control.estimator import NAMED_MODELS, OnnxEstimator, Reading
from exosight.dataset.frames import Frames, take
from exosight.evaluation.metrics import score
from exosight.evaluation.ood_detection import auroc
from exosight.learning.causes import UNRELATED
from exosight.learning.large_error import LIKELY, is_large
from exosight.learning.model_file import ModelCard
from exosight.vision.disturbances import HELD_OUT_DISTURBANCES, disturbed
from exosight.vision.ood_images import OOD_KINDS, draw_ood_images

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "reliability.json"
SEED = 50
"""Of the disturbances; those that the classifier learned from have seeds from 0."""
OTHERS = 200
"""Images of each kind without the device."""
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""Of the probabilities that are tabled together."""


def fit(model: Path, frames: Frames) -> None:
    """Probability and causes of a network's file, fitted anew."""
    import torch

    from exosight.learning import load_pretrained
    from exosight.learning.causes import CAUSES
    from exosight.learning.export import write_network
    from exosight.learning.model_inputs import ModelInputs, stacked
    from exosight.learning.pretrained import as_model
    from exosight.learning.reliability import fit_reliability

    pretrained = load_pretrained(model)
    card = pretrained.card
    images = stacked(frames.images, ModelInputs(commands=None))
    commands = frames.commands if card.actuation else None
    few = slice(None, 512)
    own = as_model(
        pretrained,
        torch.from_numpy(images[few]).float() / 255,
        None if commands is None else torch.from_numpy(commands[few]),
    )
    found = fit_reliability(own, pretrained.ood, card.schema, (images, commands), frames.labels)
    card = replace(card, large_error=found.large_error, causes=CAUSES if found.causes else ())
    write_network(model, own, pretrained.ood, card, found.causes)


def measure(model: Path, frames: Frames, photos: Frames | None) -> dict[str, Any]:
    """By disturbance: errors, how they are flagged, what they are put down to."""
    network = OnnxEstimator.load(model)
    card = network.card
    meant, weights = card.large_error, card.schema.weights("F_net")
    assert meant is not None
    sets = {"undisturbed": [("", frames.images)]}
    for k, (cause, ways) in enumerate(HELD_OUT_DISTURBANCES.items()):
        kinds = ["".join(way.backgrounds + way.occlusions) for way in ways]
        sets[cause] = [
            (kind, disturbed(frames.images, (way,), SEED + k)) for kind, way in zip(kinds, ways, strict=True)
        ]
    found: dict[str, Any] = {"large": meant.describe(card.schema), "sets": {}}
    every: list[tuple[Reading, np.ndarray]] = []
    for cause, parts in sets.items():
        for kind, images in parts:
            reading = network.read(images)
            large = is_large(meant, card.schema, reading.forces, frames.labels)
            every.append((reading, large))
            name = f"{cause}: {kind}" if kind else cause
            found["sets"][name] = _row(reading, large, frames.labels, card)
    found["disturbed"] = _follows(every, weights)
    found["other things"] = {}
    for kind in sorted(set(OOD_KINDS) - set(UNRELATED)):
        reading = network.read(draw_ood_images(kind, OTHERS, SEED, *card.schema.image_size[::-1]))
        assert reading.error_probability is not None
        flagged = round(float(np.mean(reading.error_probability > LIKELY)), 3)
        found["other things"][kind] = {
            "flagged": flagged,
            "ood": round(float(np.mean(reading.ood_score > 1)), 3),
        }
    if photos is not None:
        reading = network.read(photos.images)
        large = is_large(meant, card.schema, reading.forces, photos.labels)
        scores = score(card.schema, photos.labels, reading.forces)
        found["photo-like"] = _follows([(reading, large)], weights) | accuracy(scores)
    return found


def _follows(every: list[tuple[Reading, np.ndarray]], weights: np.ndarray) -> dict[str, Any]:
    """AUROC of a large error by each sign of it, and the share of large errors by their probability."""
    columns = ((r.error_probability, (r.high - r.low) @ weights, r.ood_score, bad) for r, bad in every)
    probability, width, score, large = (np.concatenate(each) for each in zip(*columns, strict=True))
    found: dict[str, Any] = {"frames": len(large), "large": round(float(large.mean()), 3)}
    for name, each in (("probability", probability), ("width", width), ("ood", score)):
        found[f"auroc_{name}"] = round(auroc(each[~large], each[large]), 3)
    bins = np.minimum(np.searchsorted(EDGES, probability, side="right") - 1, len(EDGES) - 2)
    found["calibration"] = [
        {
            "from": EDGES[b],
            "to": EDGES[b + 1],
            "frames": int(np.sum(bins == b)),
            "probability": round(float(probability[bins == b].mean()), 3),
            "large": round(float(large[bins == b].mean()), 3),
        }
        for b in np.unique(bins).tolist()
    ]
    return found


def _row(reading: Reading, large: np.ndarray, truth: np.ndarray, card: ModelCard) -> dict[str, Any]:
    assert reading.error_probability is not None
    flagged = reading.error_probability > LIKELY
    row: dict[str, Any] = {
        "frames": len(truth),
        **accuracy(score(card.schema, truth, reading.forces)),
        "large": round(float(large.mean()), 3),
        "flagged": round(float(flagged.mean()), 3),
        "ood": round(float(np.mean(reading.ood_score > 1)), 3),
    }
    unusual = flagged | (reading.ood_score > 1)
    if reading.causes is not None and unusual.any():
        named = reading.causes[unusual].argmax(axis=1)
        row["causes"] = {cause: round(float(np.mean(named == k)), 3) for k, cause in enumerate(card.causes)}
    return row


def _half(folder: Path, part: int) -> Frames:
    """The frames of every other design."""
    frames = load(folder).frames
    return take(frames, np.flatnonzero(frames.design % 2 == part))


def main() -> None:
    """Fit if asked, measure, write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--model", nargs="+", default=["index"])
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--fit", type=Path)
    given = parser.parse_args()
    odd = _half(given.data, 1)
    photos = load(given.photos).frames if given.photos else None
    found = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in given.model:
        path = NAMED_MODELS.get(name, Path(name))
        if given.fit:
            fit(path, _half(given.fit, 0))
        found[path.stem] = measure(path, odd, photos)
        print(json.dumps(found[path.stem], indent=1))
    RESULTS.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
