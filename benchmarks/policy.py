"""The policy that comes with the package: it imitates a controller which knows plant and user.

    python -m benchmarks.policy_data FOLDER
    python -m benchmarks.policy FOLDER

writes `FOLDER/policy.onnx` from `FOLDER/rows.npz`: the correction of the adaptive controller's command
(`exosight.control.learned`). What is minimised is the error of the force as a share of the target, in its
absolute value beyond half of the settling band, with what is too much counted more than what is too little,
since what presses too hard overshoots. Every eighth episode is kept and its errors are shown.
"""

import argparse
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

import exosight
from benchmarks.policy_data import LARGEST, SYSTEM
from exosight.control.learned import INPUTS
from exosight.control.policy_file import Layers, PolicyCard, write_policy
from exosight.control.trials import CONTROL_SHAPE
from exosight.control.tuning import tune
from exosight.exosuit.catalogue import nominal_system

HIDDEN = (64, 64)
EPOCHS, BATCH, RATE, DECAY = 12, 256, 2e-3, 1e-3
NOISE = 0.1  # of the normalised inputs, against learning single episodes by heart
TOO_MUCH = 1.2  # weight of a force beyond the target
BAND = 0.05  # of the target, in which a force is settled
_SEED = 0


def loss_of(share: Tensor, rows: dict[str, Tensor], bound: float) -> Tensor:
    """Of every row; 1 at the edge of the band, more or less."""
    error = (bound * share.clamp(-1, 1) - rows["missing"]) * rows["worth"] / BAND
    loss = nn.functional.smooth_l1_loss(error, torch.zeros_like(error), beta=0.5, reduction="none")
    beyond = (share.abs() - 1).clamp(min=0).square()  # so that there is a slope back
    return torch.where(error > 0, TOO_MUCH * loss, loss).clamp(max=10) + 0.01 * beyond


def learn(found: dict[str, np.ndarray], bound: float) -> Layers:
    """Weights and biases of each layer, for inputs as they are."""
    torch.set_num_threads(1)
    torch.manual_seed(_SEED)
    kept = found["episode"] % 8 == 0
    mean, spread = found["inputs"][~kept].mean(axis=0), found["inputs"][~kept].std(axis=0) + 1e-3
    rows = {name: torch.from_numpy(np.asarray(found[name])).float() for name in ("missing", "worth")}
    rows["worth"] = rows["worth"].clamp(min=0.05)  # also where the path is flat
    rows["inputs"] = torch.from_numpy((found["inputs"] - mean) / spread).float()
    sizes = [len(INPUTS), *HIDDEN, 1]
    linear = [nn.Linear(a, b) for a, b in pairwise(sizes)]
    linear[-1].weight.data *= 0.1
    network = nn.Sequential(*[part for layer in linear for part in (layer, nn.ReLU())][:-1])
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    chosen = torch.from_numpy(np.flatnonzero(~kept))
    steps = EPOCHS * (len(chosen) // BATCH)
    for step in range(steps):
        if step % (len(chosen) // BATCH) == 0:
            batches = iter(chosen[torch.randperm(len(chosen))].split(BATCH))
        at = next(batches)
        for group in optimizer.param_groups:
            group["lr"] = RATE * 0.5 * (1 + math.cos(math.pi * step / steps))
        shown = rows["inputs"][at]
        share = network(shown + NOISE * torch.randn_like(shown))[:, 0]
        loss = loss_of(share, {name: values[at] for name, values in rows.items()}, bound).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    with torch.no_grad():
        correction = bound * network(rows["inputs"])[:, 0].clamp(-1, 1).numpy()
    for name, given in (("without", 0 * correction), ("with", correction)):
        error = np.abs((given - found["missing"]) * found["worth"])[kept]
        off, within = 100 * error.clip(max=1).mean(), 100 * np.mean(error < BAND)
        print(f"{name} correction: {off:.2f} % of the target off, {within:.0f} % within 5 %")
    arrays = [[p.detach().numpy().astype(float) for p in layer.parameters()] for layer in linear]
    (weight, bias), *others = arrays
    return [(weight / spread, bias - (weight / spread) @ mean), *((w, b) for w, b in others)]


def main() -> None:
    """Train and export."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    with np.load(folder / "rows.npz") as archive:
        found = dict(archive)
    config = tune(nominal_system(SYSTEM, CONTROL_SHAPE))
    card = PolicyCard(
        exosight_version=exosight.__version__,
        schema=config.schema,
        sensor=config.sensor,
        channel=config.channel,
        inputs=INPUTS,
        largest=LARGEST,
        period=config.period,
        training={
            "method": "imitation of the best command",
            "episodes": int(found["episode"].max()) + 1,
            "rows": len(found["missing"]),
            "epochs": EPOCHS,
            "seed": _SEED,
        },
    )
    write_policy(folder / "policy.onnx", card, learn(found, LARGEST * abs(config.driven.peak)))


if __name__ == "__main__":
    main()
