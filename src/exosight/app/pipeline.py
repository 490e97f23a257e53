"""From a dataset to a judged estimator: the steps that single commands and the study share."""

import json
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Int, UInt8
from pydantic import TypeAdapter

from exosight.dataset import (
    Columns,
    Frames,
    Manifest,
    Split,
    dataset_identity,
    make_split,
    read_frames,
    read_manifest,
    read_variation,
)
from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import concatenate, previous, take
from exosight.dataset.manifest import sampled_shapes
from exosight.dataset.stream import stream
from exosight.errors import InputError
from exosight.exosuit.scenarios import geometry
from exosight.learning.config import TrainConfig
from exosight.learning.history import EpochRecord
from exosight.learning.model_file import ModelCard
from exosight.learning.model_inputs import HISTORY_SPACING, ModelInputs
from exosight.learning.online_simulation import FrameBlock, FrameBlocks
from exosight.learning.process_group import SINGLE, ProcessGroup
from exosight.learning.samples import stacks
from exosight.system.camera import Camera

if TYPE_CHECKING:
    from exosight.learning import Pretrained  # needs PyTorch

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
    variation: Columns = field(default_factory=dict)
    """what was drawn for each frame, by name"""


def load(folder: Path) -> Data:
    """A dataset from disk; DataError if it is missing, incomplete or damaged."""
    return Data(read_manifest(folder), read_frames(folder), read_variation(folder))


def divided(data: Data, protocol: str, seed: int, held_out: str | None) -> Split:
    """Its frames for learning, validation and testing, see `exosight.dataset.make_split`."""
    return make_split(data.frames, protocol, seed, held_out, data.variation)


def check_training() -> None:
    """Raise InputError unless all that training needs is installed: before the data are made, not after."""
    from exosight.learning import export_onnx, train  # noqa: F401


def widened(data: Data, split: Split, extra_data: Iterable[Data]) -> tuple[Frames, Split]:
    """The frames of a dataset and of others, and its split with the others' among those to learn from.

    Frames of shapes that the split keeps for validation or testing are left out of the others, whatever
    their numbers and parameters there: shapes are the same where length and radii are. So is what is held
    out: every shape of a family, every frame in which something varies that far.

    Raises InputError if images or poses differ in size, or if what is held out does not vary in another.
    """
    shapes = {sampled.shape_id: geometry(sampled.shape) for sampled in sampled_shapes(data.manifest)}
    kept = data.frames.shape_id[np.concatenate([split.validation, split.test])]
    judged = {shapes[number] for number in np.unique(kept).tolist()}
    parts = [data.frames]
    for other in extra_data:
        mine, own = other.manifest, data.manifest
        if (mine.camera, mine.dofs) != (own.camera, own.dofs):
            raise InputError(
                "train: expected datasets of one camera and plant, got several; generate them alike"
            )
        others = [
            s.shape_id
            for s in sampled_shapes(mine)
            if geometry(s.shape) not in judged and s.shape.surface.family != split.held_out
        ]
        chosen = np.isin(other.frames.shape_id, others)
        if split.held_out and split.edge is not None:
            if split.held_out not in other.variation:
                raise InputError(
                    f"train: expected datasets in which {split.held_out} varies, got one in which it does "
                    "not; generate them alike"
                )
            chosen &= other.variation[split.held_out] < split.edge
        parts.append(take(other.frames, np.flatnonzero(chosen)))
    frames = concatenate(parts) if len(parts) > 1 else data.frames
    added = np.arange(len(data.frames), len(frames))
    return frames, replace(split, train=np.concatenate([split.train, added]))


def identity(
    data: Data, split: Split, extra_data: Sequence[Manifest] = (), start: ModelCard | None = None
) -> dict[str, str | int | float]:
    """What a network remembers of its data: which dataset, which camera, which part of it, which others.

    extra_data  datasets learned from as a whole
    start       of the network that it goes on from, whose data count among the others
    """
    whole = dataset_identity(data.manifest)
    others = [(str(dataset_identity(other)["sha256"]), str(other.seed)) for other in extra_data]
    hashes, seeds = ([entry[i] for entry in others] for i in range(2))
    if start:
        hashes += [*_listed(start, "sha256"), *_listed(start, "extra_data")]
        seeds += [*_listed(start, "seed"), *_listed(start, "extra_data_seeds")]
    camera = whole.pop("camera")
    return {
        **whole,
        "camera": json.dumps(camera),
        "protocol": split.protocol,
        "split_seed": split.seed,
        "held_out": split.held_out or "",
        "extra_data": _joined(hashes, own=str(whole["sha256"])),
        "extra_data_seeds": _joined(seeds, own=str(whole["seed"])),
    }


def fit(
    data: Data,
    split: Split,
    config: TrainConfig,
    folder: Path,
    *,
    extra_data: Sequence[Path] = (),
    online_shapes: int = 0,
    pretrained: "Pretrained | None" = None,
    resume: bool,
    progress: Callable[[int, int], None] = lambda done, total: None,
    group: ProcessGroup = SINGLE,
) -> tuple[EpochRecord, ...]:
    """Train a network, export it to `folder/model.onnx`, and return its loss curves.

    extra_data     folders of datasets to learn from as well, without what `split` keeps for judging, see
                   `widened`
    online_shapes  shapes of each scenario simulated anew for each epoch, see `exosight.dataset.stream`
    pretrained     the network to start from, see `exosight.learning.load_pretrained`; None: random weights
    group          the processes that train together, see `exosight.learning.parallel`; the first exports
    """
    from exosight.learning import export_onnx, train

    if pretrained:
        _check_unseen(pretrained.card, data, split)
    start = pretrained.card if pretrained else None
    about = {
        **identity(data, split, [read_manifest(folder) for folder in extra_data], start),
        "online_shapes": online_shapes,
    }
    frames, wider = widened(data, split, map(load, extra_data))  # one at a time: they are large
    if config.history:
        about[HISTORY_SPACING] = _apart(data.frames)
    result = train(
        config,
        frames.images,
        frames.forces,
        wider.train,
        wider.validation,
        folder,
        about,
        auxiliary=auxiliary(frames),
        u=frames.u,
        previous=previous(frames),
        online_blocks=_online_blocks(data, online_shapes) if online_shapes else None,
        pretrained=pretrained,
        resume=resume,
        progress=lambda at: progress(at.step, at.steps),
        group=group,
    )
    if group.first and not (folder / MODEL).exists():
        kept = split.validation
        images, forces = data.frames.images, data.frames.forces[kept]
        seen = inputs(images, stacked_rows(data.frames, config.history)[kept], data.frames.u[kept], config)
        export_onnx(folder, folder / MODEL, images[kept], forces, seen)
    return result.history


def _check_unseen(pretrained: ModelCard, data: Data, split: Split) -> None:
    """Raise InputError if a network to start from is known to have learned from what is kept for judging."""
    mine, known = dataset_identity(data.manifest)["sha256"], pretrained.data
    there = known.get("protocol"), known.get("split_seed"), known.get("held_out") or None
    asked = split.protocol, split.seed, split.held_out
    seed = str(data.manifest.seed)
    # Of one seed a division is the same where as many exosuits are divided.
    alike = there == asked and known.get("shapes") == len(np.unique(data.frames.shape_id))
    if mine in _listed(pretrained, "extra_data"):
        problem = "learned from the whole of this dataset"
    elif known.get("sha256") == mine and there != asked:
        problem = f"learned from this dataset divided otherwise (by {there[0]}, split seed {there[1]})"
    elif seed in _listed(pretrained, "extra_data_seeds") or (
        seed in _listed(pretrained, "seed") and not alike
    ):
        problem = f"learned from exosuits of the same seed, {seed}"
    elif split.protocol == "family" and there[2] != split.held_out:
        problem = f"learned from the family {split.held_out}"
    else:
        return
    raise InputError(
        f"pretrained: expected a network that has not seen what is kept for testing, got one that {problem}; "
        "divide the data as it did, generate others with a --seed of their own, or start from another"
    )


def _listed(card: ModelCard, entry: str) -> list[str]:
    """What a network remembers of its data, one by one."""
    found = str(card.data.get(entry, ""))
    return found.split(", ") if found else []


def _joined(entries: Iterable[str], own: str) -> str:
    """Each once, without what is told of the dataset itself."""
    return ", ".join(entry for entry in dict.fromkeys(entries) if entry != own)


def stacked_rows(frames: Frames, history: int) -> Int[np.ndarray, "frames stack"]:
    """The frames of a dataset that a network sees of each: its own, then those before it, newest first."""
    return stacks(previous(frames), history, len(frames))


def inputs(
    images: UInt8[np.ndarray, "images height width"],
    rows: Int[np.ndarray, "frames stack"],
    u: Float32[np.ndarray, " frames"],
    asked: ModelCard | TrainConfig,
) -> ModelInputs:
    """What a network asks for beside the first of the images in each row."""
    return ModelInputs(images[rows[:, 1:]] if asked.history else None, u if asked.actuation else None)


def _apart(frames: Frames) -> float:
    """The usual change of u from a frame to the next of its path [N]; InputError if none follows another."""
    steps = np.abs(frames.u - frames.u[previous(frames)])
    if not steps.any():
        raise InputError(
            "history: expected frames along paths of u, got none after another; train without history"
        )
    return round(float(np.median(steps[steps > 0])), 6)


def _online_blocks(data: Data, per_scenario: int) -> FrameBlocks:
    """Blocks of frames as those of the dataset, of shapes that it does not have."""

    def blocks(first: int) -> Generator[FrameBlock, None, None]:
        known = TypeAdapter(GenerateConfig).validate_python(data.manifest.config)
        with stream(
            replace(known, per_scenario=per_scenario), exclude=sampled_shapes(data.manifest), start=first
        ) as found:
            for frames in found:
                yield FrameBlock(frames.images, frames.forces, auxiliary(frames), frames.u, previous(frames))

    return blocks


def auxiliary(frames: Frames) -> Float32[np.ndarray, "frames 5"]:
    """What a network learns to tell beside the forces: the finger's joint angles [rad], u and F_net [N]."""
    angles = frames.pose[:, -HINGES:]
    return np.column_stack([angles, frames.u, frames.forces.sum(axis=1)]).astype(np.float32)


def test_part(card: ModelCard, data: Data) -> tuple[Int[np.ndarray, " frames"], str]:
    """The frames that a network may be judged on, and what they are.

    Of the dataset that it learned from, the test part of its own split; of any other, all frames, and a word
    of warning where it has learned from them, or may have.
    """
    mine = dataset_identity(data.manifest)["sha256"]
    if mine in _listed(card, "extra_data"):
        return np.arange(len(data.frames)), "all frames of a dataset that the network has learned from"
    if card.data.get("sha256") != mine:
        seed, doubt = str(data.manifest.seed), ""
        if seed in _listed(card, "seed") + _listed(card, "extra_data_seeds"):
            doubt = f", of whose exosuits the network may know some, as it learned from seed {seed}"
        return np.arange(len(data.frames)), f"all frames of another dataset{doubt}"
    try:
        protocol, seed = str(card.data["protocol"]), int(card.data["split_seed"])
        held_out = str(card.data["held_out"]) or None
    except (KeyError, ValueError) as error:
        raise InputError("model: its file does not tell which part of the data it learned from") from error
    name = f"{protocol} ({held_out})" if held_out else protocol
    return divided(data, protocol, seed, held_out).test, f"test part by {name}"


def camera_of(card: ModelCard) -> Camera:
    """The camera whose images a network learned from; InputError if its file does not tell."""
    try:
        return Camera(**json.loads(str(card.data["camera"])))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("model: its file does not tell which camera it was trained for") from error
