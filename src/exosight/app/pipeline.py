"""From a dataset to a judged estimator: the steps that single commands and the study share."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int

from exosight.dataset import Frames, Manifest, Split, dataset_identity, make_split, read_frames, read_manifest
from exosight.errors import InputError
from exosight.learning.config import TrainConfig
from exosight.learning.history import EpochRecord
from exosight.learning.model_file import ModelCard
from exosight.vision.camera import Camera

HINGES = 3
"""Coordinates of a pose that are joint angles: the last."""

AUXILIARY = HINGES + 2
"""How many numbers a light network learns to tell beside the forces."""

MODEL = "model.onnx"
"""Name of the exported network in a run's folder."""


@dataclass(frozen=True)
class Data:
    """A dataset in memory."""

    manifest: Manifest
    frames: Frames


def load(folder: Path) -> Data:
    """A dataset from disk; DataError if it is missing, incomplete or damaged."""
    return Data(read_manifest(folder), read_frames(folder))


def check_training() -> None:
    """Raise InputError unless all that training needs is installed: before the data are made, not after."""
    from exosight.learning import export_onnx, train  # noqa: F401


def identity(data: Data, split: Split) -> dict[str, str | int | float]:
    """What a network remembers of its data: which dataset, which camera, which part of it."""
    whole = dataset_identity(data.manifest)
    camera = whole.pop("camera")
    return {
        **whole,
        "camera": json.dumps(camera),
        "protocol": split.protocol,
        "split_seed": split.seed,
        "held_out": split.held_out or "",
    }


def fit(
    data: Data,
    split: Split,
    config: TrainConfig,
    folder: Path,
    *,
    resume: bool,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[EpochRecord, ...]:
    """Train a network, export it to `folder/model.onnx`, and return its loss curves."""
    from exosight.learning import export_onnx, train

    result = train(
        config,
        data.frames.images,
        data.frames.forces,
        split.train,
        split.validation,
        folder,
        identity(data, split),
        auxiliary=auxiliary(data.frames),
        resume=resume,
        progress=lambda at: progress(at.step, at.steps),
    )
    if not (folder / MODEL).exists():
        kept = split.validation
        export_onnx(folder, folder / MODEL, data.frames.images[kept], data.frames.forces[kept])
    return result.history


def auxiliary(frames: Frames) -> Float32[np.ndarray, "frames 5"]:
    """What a network learns to tell beside the forces: the finger's joint angles [rad], u and F_net [N]."""
    angles = frames.pose[:, -HINGES:]
    return np.column_stack([angles, frames.u, frames.forces.sum(axis=1)]).astype(np.float32)


def test_part(card: ModelCard, data: Data) -> tuple[Int[np.ndarray, " frames"], str]:
    """The frames that a network may be judged on, and what they are.

    Of the dataset that it learned from, the test part of its own split; of any other, all frames.
    """
    if card.data.get("sha256") != dataset_identity(data.manifest)["sha256"]:
        return np.arange(len(data.frames)), "all frames of another dataset"
    try:
        protocol, seed = str(card.data["protocol"]), int(card.data["split_seed"])
        held_out = str(card.data["held_out"]) or None
    except (KeyError, ValueError) as error:
        raise InputError("model: its file does not tell which part of the data it learned from") from error
    return make_split(data.frames, protocol, seed, held_out).test, f"test part by {protocol}"


def camera_of(card: ModelCard) -> Camera:
    """The camera whose images a network learned from; InputError if its file does not tell."""
    try:
        return Camera(**json.loads(str(card.data["camera"])))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("model: its file does not tell which camera it was trained for") from error
