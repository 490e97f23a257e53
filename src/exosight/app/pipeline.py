"""From a dataset to a trained network: the steps that single commands and the study share."""

import json
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float32, Int, UInt8

from exosight.app.data import Data, load
from exosight.app.provenance import check_unseen, identity
from exosight.dataset import (
    Frames,
    Manifest,
    Split,
    read_manifest,
)
from exosight.dataset.frames import concatenate, previous, take
from exosight.dataset.stream import stream
from exosight.errors import InputError
from exosight.learning.config import TrainConfig
from exosight.learning.history import EpochRecord
from exosight.learning.model_file import ModelCard
from exosight.learning.model_inputs import HISTORY_SPACING, ModelInputs, command_change
from exosight.learning.outputs import auxiliary_units, auxiliary_values
from exosight.learning.process_group import SINGLE, ProcessGroup
from exosight.learning.training_data import FrameBlock, FrameBlocks, TrainingData, stacks
from exosight.system.camera import Camera

if TYPE_CHECKING:
    from exosight.learning import Pretrained  # needs PyTorch

MODEL = "model.onnx"
"""Name of the exported network in a run's folder."""


def check_training() -> None:
    """Raise InputError unless all that training needs is installed: before the data are made, not after."""
    from exosight.learning import export_onnx, train  # noqa: F401


def widened(data: Data, split: Split, extra_data: Iterable[Data]) -> tuple[Frames, Split]:
    """The frames of a dataset and of others, and its split with the others' among those to learn from.

    Frames of designs that the split keeps for validation or testing are left out of the others, whatever
    their numbers there. So is what is held out: every design of a family, every frame in which something
    varies that far.

    Raises InputError if system, camera or poses differ, or if what is held out does not vary in another.
    """
    parts, kept_keys = [data.frames], None
    for other in extra_data:
        theirs = other.manifest
        if theirs.camera != data.manifest.camera:
            raise InputError("train: expected datasets of one camera, got several; generate them alike")
        if kept_keys is None:
            kept = data.frames.design[np.concatenate([split.validation, split.test])]
            keys = _design_keys(data.manifest)
            kept_keys = {keys[number] for number in np.unique(kept).tolist()}
        own = _design_keys(theirs)
        others = [
            design.number
            for design in theirs.designs
            if own[design.number] not in kept_keys and theirs.families[design.family] != split.held_out
        ]
        chosen = np.isin(other.frames.design, others)
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


def _design_keys(manifest: Manifest) -> dict[int, Any]:
    """By its number, what identifies each design of a dataset; of a measured sequence its readings do."""
    if manifest.measured:
        return {design.number: design.parameters.get("sha256") for design in manifest.designs}
    from exosight.dataset.designs import config_of, design_set  # needs JAX

    designs = design_set(config_of(manifest), manifest.description)
    return {design.number: designs.key(design) for design in manifest.designs}


@dataclass(frozen=True)
class Sources:
    """What a network starts and learns from besides its dataset."""

    extra_data: Sequence[Path] = ()
    """folders of datasets to learn from as well, without what the split keeps for testing, see `widened`"""
    online_designs: int = 0
    """designs of each scenario simulated anew for each epoch, see `exosight.dataset.stream`"""
    pretrained: "Pretrained | None" = None
    """the network to start from, see `exosight.learning.load_pretrained`; None: random weights"""


DATASET_ONLY = Sources()
"""Nothing besides."""


def fit(
    data: Data,
    split: Split,
    config: TrainConfig,
    folder: Path,
    *,
    sources: Sources = DATASET_ONLY,
    resume: bool,
    progress: Callable[[int, int], None] = lambda done, total: None,
    group: ProcessGroup = SINGLE,
) -> tuple[EpochRecord, ...]:
    """Train a network, export it to `folder/model.onnx`, and return its loss curves.

    group   the processes that train together, see `exosight.learning.parallel`; the first exports
    """
    from exosight.learning import export_onnx, train
    from exosight.learning.ood import FEW

    start = sources.pretrained.card if sources.pretrained else None
    if start:
        check_unseen(start, data, split)
    about = {
        **identity(data, split, [read_manifest(folder) for folder in sources.extra_data], start),
        "online_designs": sources.online_designs,
    }
    frames, wider = widened(data, split, map(load, sources.extra_data))  # one at a time: they are large
    if config.history:
        about[HISTORY_SPACING] = _apart(data.frames)
    result = train(
        config,
        replace(
            training_data(frames, wider, about),
            online_blocks=_online_blocks(data, sources.online_designs) if sources.online_designs else None,
        ),
        folder,
        pretrained=sources.pretrained,
        resume=resume,
        progress=lambda at: progress(at.step, at.steps),
        group=group,
    )
    if group.first and not (folder / MODEL).exists():
        kept, own = split.validation, data.frames

        def seen(part: np.ndarray) -> tuple[np.ndarray, ModelInputs]:
            rows = stacked_rows(own, config.history)[part]
            return own.images[part], inputs(own.images, rows, own.commands[part], config)

        learned = seen(split.train) if len(kept) < FEW else None
        images, beside = seen(kept)
        export_onnx(folder, folder / MODEL, images, own.labels[kept], beside, learned)
    return result.history


def training_data(frames: Frames, split: Split, identity: dict[str, str | int | float]) -> TrainingData:
    """Frames as training takes them."""
    beside = auxiliary_values(frames.schema, frames.sensors, frames.commands)
    if frames.schema.measured:  # commands that never come near 0 would rule the loss
        beside = beside - beside[split.train].mean(axis=0)
    return TrainingData(
        schema=frames.schema,
        images=frames.images,
        labels=frames.labels,
        train_index=split.train,
        validation_index=split.validation,
        identity=identity,
        auxiliary=beside,
        auxiliary_units=auxiliary_units(frames.schema),
        commands=frames.commands,
        previous=previous(frames),
    )


def stacked_rows(frames: Frames, history: int) -> Int[np.ndarray, "frames stack"]:
    """The frames whose images a network takes for each: its own, then those before it, newest first."""
    return stacks(previous(frames), history, len(frames))


def inputs(
    images: UInt8[np.ndarray, "images height width"],
    rows: Int[np.ndarray, "frames stack"],
    commands: Float32[np.ndarray, "frames channels"],
    asked: ModelCard | TrainConfig,
) -> ModelInputs:
    """The inputs of a network beside the first of the images in each row."""
    return ModelInputs(images[rows[:, 1:]] if asked.history else None, commands if asked.actuation else None)


def _apart(frames: Frames) -> float:
    """The usual change of the commands from a frame to the next of its path, as `command_change` gives it.

    Raises InputError if no frame follows another.
    """
    steps = command_change(frames.schema, frames.commands[previous(frames)], frames.commands)
    if not steps.any():
        raise InputError(
            "history: expected frames along load paths, got none after another; train without history"
        )
    return round(float(np.median(steps[steps > 0])), 6)


def _online_blocks(data: Data, per_scenario: int) -> FrameBlocks:
    """Blocks of frames as those of the dataset, of designs that it does not have."""

    def blocks(first: int) -> Generator[FrameBlock, None, None]:
        from exosight.dataset.designs import config_of  # needs JAX

        manifest = data.manifest
        with stream(
            config_of(manifest),
            per_scenario,
            description=manifest.description,
            exclude=manifest.designs,
            start=first,
        ) as found:
            for frames in found:
                beside = auxiliary_values(frames.schema, frames.sensors, frames.commands)
                yield FrameBlock(frames.images, frames.labels, beside, frames.commands, previous(frames))

    return blocks


def camera_of(card: ModelCard) -> Camera:
    """The camera whose images a network learned from; InputError if its file does not name it."""
    try:
        return Camera(**json.loads(str(card.data["camera"])))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            "model: its file does not name the camera that it was trained for; train another"
        ) from error
