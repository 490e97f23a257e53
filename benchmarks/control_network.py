"""The network of the loop, from the shipped one and pictures of a loop under stress.

    python -m benchmarks.control_data FOLDER
    python -m benchmarks.control_network FOLDER --epochs 12

writes `FOLDER/run/model.onnx`: it takes u beside the picture, and starts from the network that comes with the
package for `index`. Every tenth episode is kept for validation and calibration.
"""

import argparse
import hashlib
import json
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

from exosight.control.estimator import SHIPPED_MODELS
from exosight.exosuit.catalogue import nominal_system
from exosight.learning import TrainConfig, TrainingData, export_onnx, load_pretrained, train
from exosight.learning.model_inputs import ModelInputs
from exosight.learning.outputs import auxiliary_units, auxiliary_values
from exosight.learning.training import Progress


def learned(folder: Path) -> TrainingData:
    """Frames of nine in ten episodes to learn from, the others to validate on."""
    path = folder / "frames.npz"
    system = nominal_system("index")
    with np.load(path) as found:
        images, readings, commands, episode = (
            found[name] for name in ("images", "readings", "commands", "episode")
        )
    kept = episode % 10 == 9
    return TrainingData(
        schema=system.schema,
        images=images,
        labels=np.maximum(readings[:, system.schema.output_indices()], 0.0),
        train_index=np.flatnonzero(~kept),
        validation_index=np.flatnonzero(kept),
        identity={
            "about": "pictures of a loop under stress",
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "camera": json.dumps(asdict(system.camera)),
        },
        auxiliary=auxiliary_values(system.schema, readings, commands),
        auxiliary_units=auxiliary_units(system.schema),
        commands=commands,
    )


def main() -> None:
    """Train and export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--learning-rate", type=float, default=None)
    asked = parser.parse_args()
    data, run = learned(asked.folder), asked.folder / "run"
    config = TrainConfig(
        epochs=asked.epochs, learning_rate=asked.learning_rate, actuation=True, threads=1, device="cpu"
    )
    started = time.monotonic()

    def told(at: Progress) -> None:
        if at.step % 20 == 0:
            loss = at.latest and at.latest.validation_l1
            print(f"{time.monotonic() - started:.0f} s, step {at.step} of {at.steps}, {loss}", flush=True)

    train(config, data, run, pretrained=load_pretrained(SHIPPED_MODELS["index"]), progress=told)
    kept = data.validation_index
    assert data.commands is not None
    export_onnx(
        run, run / "model.onnx", data.images[kept], data.labels[kept], ModelInputs(None, data.commands[kept])
    )


if __name__ == "__main__":
    main()
