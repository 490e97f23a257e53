"""The network of the loop, from the shipped one and pictures of a loop under stress.

    python -m benchmarks.control_data FOLDER
    python -m benchmarks.control_network FOLDER

writes `FOLDER/run/model.onnx`: it takes u beside the picture. It starts from the network that comes with the
package for `index`, or from another one (`--start`). Where that does not take u, the two layers behind the
convolutions learn anew first, with u, from what these make of every picture (computed once, in a minute or
two); then all learn for some epochs. Every tenth episode is kept for validation and calibration.
"""

import argparse
import hashlib
import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from exosight.control.estimator import model_path
from exosight.exosuit.catalogue import nominal_system
from exosight.learning import Pretrained, TrainConfig, TrainingData, export_onnx, load_pretrained, train
from exosight.learning.augmentation import augment_batch
from exosight.learning.losses import training_loss
from exosight.learning.model_inputs import ModelInputs
from exosight.learning.networks import Network, answers, build_network
from exosight.learning.outputs import auxiliary_units, auxiliary_values, nonnegative
from exosight.learning.pretrained import unfold
from exosight.learning.training_data import scale_of

_HEAD = 4  # layers from the features' on: linear, commands, rectified, linear
_BATCH, _SEED = 512, 0


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


def features(network: Network, data: TrainingData) -> Tensor:
    """What the convolutions make of every picture: those to learn from augmented, the others as they are."""
    convolutions = nn.Sequential(*list(network)[:-_HEAD]).eval()
    augmented = np.isin(np.arange(len(data.images)), data.train_index)
    parts = []
    with torch.inference_mode():
        for start in range(0, len(data.images), 128):
            images = data.images[start : start + 128, None]
            plain = images.astype(np.float32) / 255
            chosen = augmented[start : start + 128, None, None, None]
            shown = np.where(chosen, augment_batch(images, _SEED, 0, start), plain)
            parts.append(convolutions(torch.from_numpy(shown)))
            if start % 2560 == 0:
                print(start, len(data.images), flush=True)
    return torch.cat(parts)


def learn(network: Network, seen: Tensor, data: TrainingData, first: Pretrained, epochs: int) -> None:
    """Train the layers behind the convolutions."""
    assert data.commands is not None
    assert data.auxiliary is not None
    linear, embedding, rectified, last = list(network)[-_HEAD:]
    commands = torch.from_numpy(data.commands)
    labels = (torch.from_numpy(data.labels) - first.offset) / first.scale
    auxiliary = torch.from_numpy(
        data.auxiliary / scale_of(data.auxiliary[data.train_index], data.auxiliary_units)
    ).float()
    weights = [w for layer in (linear, embedding, last) for w in layer.parameters()]
    optimizer = torch.optim.AdamW(weights, lr=2e-3, weight_decay=0.01)
    order, forces = np.random.default_rng(_SEED), nonnegative(data.schema)
    kept = torch.from_numpy(data.validation_index)

    def answered(rows: Tensor) -> Tensor:
        return last(rectified(embedding(linear(seen[rows]), commands[rows])))

    for epoch in range(epochs):
        for group in optimizer.param_groups:
            group["lr"] = 2e-3 * 0.5 * (1 + math.cos(math.pi * epoch / epochs))
        shuffled = torch.from_numpy(order.permutation(data.train_index))
        for rows in shuffled.split(_BATCH):
            found = answers(answered(rows), network.outputs)
            loss, _ = training_loss(found, labels[rows], auxiliary[rows], forces, 0.3)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        if epoch % 10 == 9 or epoch == epochs - 1:
            with torch.no_grad():
                values = answers(answered(kept), network.outputs).values * first.scale + first.offset
            error = values.clamp(min=0).sum(1) - torch.from_numpy(data.labels)[kept].sum(1)
            print(f"epoch {epoch + 1}: F_net RMSE {1e3 * error.square().mean().sqrt():.1f} mN", flush=True)


def with_commands(first: Pretrained, data: TrainingData, cache: Path, epochs: int) -> Pretrained:
    """The same convolutions, with layers behind them that have learned to use u."""
    assert data.commands is not None
    assert data.auxiliary is not None
    network = build_network("light", data.schema, data.auxiliary.shape[1], _SEED, actuation=True)
    rows = data.train_index[:: len(data.train_index) // 256]
    shown = torch.from_numpy(data.images[rows, None].astype(np.float32) / 255)
    unfold(first, network, shown, torch.from_numpy(data.commands[rows]))
    if not cache.exists():
        torch.save(features(network.eval(), data), cache)
    learn(network, torch.load(cache), data, first, epochs)
    head = {
        name: tensor.detach()
        for name, tensor in network.state_dict().items()
        if int(name.split(".")[0]) >= len(list(network)) - _HEAD
    }
    kept_layers = {
        n: w for n, w in first.weights.items() if int(n.split(".")[0]) < len(list(network)) - _HEAD
    }
    return replace(first, card=replace(first.card, actuation=True), weights=kept_layers | head)


def main() -> None:
    """Train and export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--start", type=Path, help="a network or its name; default: the one of index")
    parser.add_argument("--head-epochs", type=int, default=30, help="of the last two layers")
    parser.add_argument("--epochs", type=int, default=6, help="of all layers")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    data, first = learned(asked.folder), load_pretrained(model_path(asked.start, "index"))
    assert data.commands is not None
    if not first.card.actuation:
        first = with_commands(first, data, asked.folder / "features.pt", asked.head_epochs)
    run, kept = asked.folder / "run", data.validation_index
    config = TrainConfig(epochs=asked.epochs, actuation=True, threads=1, device="cpu")
    train(config, data, run, pretrained=first)
    export_onnx(
        run, run / "model.onnx", data.images[kept], data.labels[kept], ModelInputs(None, data.commands[kept])
    )


if __name__ == "__main__":
    main()
