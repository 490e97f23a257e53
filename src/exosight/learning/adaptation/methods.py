"""What of a network may change: nothing, gain and offset of each output, the last layer, or all layers."""

import copy
import math
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from exosight.learning.adaptation.labelled import Labelled, features, folds
from exosight.learning.networks import SensorModel, answers

Method = Literal["none", "affine", "last", "all"]
METHODS: tuple[Method, ...] = ("none", "affine", "last", "all")
"""From the one with the fewest parameters to the one with the most."""

FEWEST_FOR_ALL = 20
"""Labels below which all layers are left alone: with ten, that was always worse than the last layer alone."""

_RIDGES = tuple(10.0**power for power in range(-4, 3))
"""Of the last layer, in units of the features' mean variance times the labels."""
_HELD = 0.1
"""What holds gains at 1: as much as a tenth of a label whose output is one scale from its mean."""
_STEPS, _BATCH, _RATE, _DECAY = 300, 32, 1e-3, 0.01
_TURN, _MOVE, _BLURRED = math.radians(3), 0.03, 0.5
"""How far pictures are turned [rad], moved and scaled [share of a side] while all layers learn, and the
share of them that is blurred. Measured on two moved cameras: twice as far is no better (docs/log.md)."""


def fit(method: Method, start: SensorModel, data: Labelled, seed: int) -> SensorModel:
    """The network after one method of `METHODS`; the one given is left as it was.

    data   as the network sees it
    """
    model = copy.deepcopy(start)
    if method == "affine":
        _fit_affine(model, data)
    if method in ("last", "all"):
        _fit_last(model, data)
    if method == "all":
        _fit_all(model, data, seed)
    return model


def scaled(model: SensorModel, data: Labelled) -> Float[Tensor, "frames outputs"]:
    """Labels in units of the network's outputs."""
    labels = torch.from_numpy(data.labels)
    return (labels if model.offset is None else labels - model.offset) / model.scale


@torch.no_grad()
def _fit_affine(model: SensorModel, data: Labelled) -> None:
    """Gain and offset of each output by least squares, the gain held near 1 where labels are few."""
    last, outputs = model.network.last, model.network.outputs
    found = answers(last(features(model, data)), outputs).values.double()
    wanted = scaled(model, data).double()
    centre, target = found.mean(0), wanted.mean(0)
    spread = ((found - centre) ** 2).sum(0)
    gain = (((found - centre) * (wanted - target)).sum(0) + _HELD) / (spread + _HELD)
    last.weight[:outputs] *= gain[:, None].float()
    last.bias[:outputs] = (gain * (last.bias[:outputs] - centre) + target).float()


@torch.no_grad()
def _fit_last(model: SensorModel, data: Labelled) -> None:
    """Ridge regression of what the former layer leaves, its ridge by leaving out sequences in turn.

    With n labels, features centred on their mean (n, f) = U S Vᵀ and residuals R, rows g that are left out
    together are missed by (1 − H)gg⁻¹ (R − H R)g, H = 1/n + U S²/(S² + λ) Uᵀ (Golub, Heath and Wahba,
    doi 10.1080/00401706.1979.10489751, for one row).
    """
    last, outputs = model.network.last, model.network.outputs
    found = features(model, data)
    left = (scaled(model, data) - answers(last(found), outputs).values).double()
    found = found.double()
    mean, centre = found.mean(0), left.mean(0)
    u, s, vt = torch.linalg.svd(found - mean, full_matrices=False)
    whole = (s**2).sum() / found.shape[1] + 1e-12
    parts = folds(data.sequence, len(data)) if len(data) > 1 else []

    def missed(ridge: float) -> float:
        rest = (
            torch.eye(len(found), dtype=found.dtype)
            - (u * (s**2 / (s**2 + ridge * whole))) @ u.T
            - 1 / len(found)
        )
        total = 0.0
        for rows in map(torch.from_numpy, parts):
            total += float((torch.linalg.solve(rest[rows][:, rows], (rest @ left)[rows]) ** 2).sum())
        return total

    ridge = min(_RIDGES, key=missed)
    change = vt.T @ ((s / (s**2 + ridge * whole))[:, None] * (u.T @ (left - centre)))
    last.weight[:outputs] += change.T.float()
    last.bias[:outputs] += (centre - mean @ change).float()


def _fit_all(model: SensorModel, data: Labelled, seed: int) -> None:
    """AdamW on pictures turned, moved, scaled and blurred at random.

    The last layer has been fitted first: Kumar et al., Fine-tuning can distort pretrained features, arXiv
    2202.10054. The normalisation stays as it was, as a few pictures do not tell it.
    """
    network, wanted = model.network, scaled(model, data)
    rng = np.random.default_rng([seed, len(data)])
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY)
    for step in range(_STEPS):
        done = step / _STEPS
        rate = done / 0.2 if done < 0.2 else 0.5 * (1 + math.cos(math.pi * (done - 0.2) / 0.8))
        optimiser.param_groups[0]["lr"] = _RATE * rate
        rows = rng.choice(len(data), _BATCH, replace=len(data) < _BATCH)
        images, commands = data.take(rows).tensors()
        found = answers(network(_varied(images, rng), commands), network.outputs).values
        loss = nn.functional.smooth_l1_loss(found, wanted[torch.from_numpy(rows)])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


def _varied(
    images: Float[Tensor, "batch stack height width"], rng: np.random.Generator
) -> Float[Tensor, "batch stack height width"]:
    """Each stack turned, moved and scaled as a whole, and some of them blurred over 3×3 pixels."""
    count = len(images)
    turn, scale = rng.uniform(-_TURN, _TURN, count), 1 + rng.uniform(-_MOVE, _MOVE, count)
    cos, sin = scale * np.cos(turn), scale * np.sin(turn)
    move = 2 * rng.uniform(-_MOVE, _MOVE, (2, count))
    maps = np.moveaxis(np.array([[cos, -sin, move[0]], [sin, cos, move[1]]]), -1, 0)
    places = nn.functional.affine_grid(
        torch.from_numpy(maps).float(), list(images.shape), align_corners=False
    )
    found = nn.functional.grid_sample(images, places, padding_mode="border", align_corners=False)
    blurred = nn.functional.avg_pool2d(nn.functional.pad(found, (1, 1, 1, 1), mode="replicate"), 3, 1)
    chosen = torch.from_numpy(rng.random(count) < _BLURRED)
    return torch.where(chosen[:, None, None, None], blurred, found)
