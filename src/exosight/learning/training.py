"""Training: frames in memory, a network out, a checkpoint and the loss curves in a folder along the way."""

import contextlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor, nn

from exosight.errors import InputError
from exosight.learning.augmentation import augment_batch
from exosight.learning.board import Board
from exosight.learning.checkpoint import Position, RunIdentity
from exosight.learning.config import Settings, TrainConfig, resolve
from exosight.learning.history import EpochRecord
from exosight.learning.losses import output_loss, training_loss
from exosight.learning.networks import SensorModel, answers
from exosight.learning.online_simulation import EpochData, epoch_data
from exosight.learning.outputs import nonnegative
from exosight.learning.parallel import (
    all_reduce_sum,
    broadcast,
    broadcast_block,
    choose_device,
    choose_precision,
)
from exosight.learning.pretrained import Pretrained, check_pretrained, first_weights
from exosight.learning.process_group import SINGLE, ProcessGroup
from exosight.learning.recipes import RECIPES
from exosight.learning.run import Run, open_run
from exosight.learning.training_data import (
    FrameBlock,
    TrainingData,
    balanced,
    check_training_data,
    epoch_batches,
    fingerprint,
    offset_of,
    scale_of,
    stacks,
)

CHECKPOINT_SECONDS = 30.0
"""Within a long epoch, the most work a killed run loses [s]; every epoch ends in a checkpoint anyway."""

_VALIDATION_BATCH = 256

_PRETRAINED_IMAGES = 512
"""How many set what a network to start from is normalised by."""


@dataclass(frozen=True)
class Progress:
    """Where a run is, reported after every step."""

    epoch: int
    """the one under way, from 1"""
    epochs: int
    """the last one at most"""
    step: int
    """steps done"""
    steps: int
    """steps in all, at most"""
    latest: EpochRecord | None
    """the last completed epoch"""


@dataclass(frozen=True)
class TrainResult:
    """A completed run; the network kept is that of the lowest validation loss."""

    folder: Path
    history: tuple[EpochRecord, ...]
    best: EpochRecord


def train(
    config: TrainConfig,
    data: TrainingData,
    folder: Path,
    *,
    pretrained: Pretrained | None = None,
    resume: bool = False,
    progress: Callable[[Progress], None] | None = None,
    group: ProcessGroup = SINGLE,
) -> TrainResult:
    """Train a network; with `resume`, go on exactly (on a CPU to the last bit) where a run was stopped.

    folder       gets `checkpoint.safetensors` and `history.csv`; other files in it are left alone
    pretrained   a network whose weights are the first, in place of random ones
    group        the processes that train together, each calling this alike; the first writes

    Raises InputError for frames that cannot be learned from, a folder that already holds a run, a run to be
    resumed that is another one, a network to start from that is of another kind, and a loss that is no longer
    finite; DataError for a damaged checkpoint.
    """
    device = choose_device(config.device)
    first = pretrained.sha256 if pretrained else ""
    pixels = math.prod(data.schema.image_size)
    settings = resolve(config, device, choose_precision(device), group.local_size, first, pixels)
    data = _needed(data, settings)
    check_training_data(data)
    _check_slices(len(data.train_index), settings.batch, group)
    identity = _identity(data, settings)
    with _compute(settings):
        weights = _first_weights(pretrained, identity, data) if pretrained else None
        run = open_run(identity, folder, resume, group, weights)
        if not run.position.complete:
            _run(run, data, progress if group.first else None)
    return TrainResult(folder, run.history, run.history[run.position.best_epoch - 1])


def _needed(data: TrainingData, settings: Settings) -> TrainingData:
    """The data without what this network has no input or output for; InputError if something is missing."""
    if settings.actuation and data.commands is None:
        raise InputError(
            "actuation: expected the commands of every image, got none; give commands, or leave actuation out"
        )
    if settings.history and data.previous is None:
        raise InputError(
            "history: expected the frame before each, got none; give previous, or leave history out"
        )
    if not settings.actuation:
        data = replace(data, commands=None)
    if not settings.history:
        data = replace(data, previous=None)
    return replace(data, auxiliary=None, auxiliary_units=()) if settings.network == "paper" else data


def _identity(data: TrainingData, settings: Settings) -> RunIdentity:
    index, sensors = data.train_index, data.schema.estimated
    scales = RECIPES[settings.recipe].scales_outputs
    own = (
        scale_of(data.labels[index], [sensor.unit for sensor in sensors]) if scales else np.ones(len(sensors))
    )
    offset = offset_of(data.labels[index], data.schema) if scales else ()
    beside = () if data.auxiliary is None else scale_of(data.auxiliary[index], data.auxiliary_units).tolist()
    return RunIdentity(
        settings=settings,
        data_identity=_plain(data.identity),
        fingerprint=fingerprint(data),
        schema=data.schema,
        output_scale=tuple(own.tolist()),
        output_offset=offset,
        auxiliary_scale=tuple(beside),
    )


def _first_weights(pretrained: Pretrained, identity: RunIdentity, data: TrainingData) -> dict[str, Tensor]:
    """Those of the network to start from, normalised by images from all over the training part."""
    settings, index = identity.settings, data.train_index
    check_pretrained(pretrained, identity)
    chosen = index[np.linspace(0, len(index) - 1, min(len(index), _PRETRAINED_IMAGES)).astype(np.intp)]
    seen = stacks(data.previous, settings.history, len(data.images))[chosen]
    return first_weights(pretrained, identity, *_tensors(data.images[seen], data.commands, chosen, "cpu"))


def _run(run: Run, data: TrainingData, progress: Callable[[Progress], None] | None) -> None:
    """Take a run to its end, its curves into TensorBoard's files as well."""
    group, online_blocks = run.group, data.online_blocks
    with (
        contextlib.closing(online_blocks(run.position.epoch))
        if online_blocks and group.first
        else contextlib.nullcontext(repeat(None)) as blocks,
        contextlib.closing(Board(run.folder if group.first else None, run.position.step)) as board,
    ):
        while not run.position.complete:
            block = next(blocks)
            _run_epoch(run, data, broadcast_block(group, block) if online_blocks else block, progress)
            latest = run.history[-1]
            board.add(latest.curves(), latest.step)


def _run_epoch(
    run: Run, data: TrainingData, block: FrameBlock | None, progress: Callable[[Progress], None] | None
) -> None:
    """Take a run from where it stands to the end of its epoch."""
    settings, epoch = run.identity.settings, run.position.epoch + 1
    started = time.perf_counter() - run.position.seconds
    frames = epoch_data(data, block, settings.history, settings.seed, epoch)
    rate = _run_steps(run, frames, started, progress)
    loss = l1 = None
    if epoch % run.recipe.validate_every == 0 or epoch == settings.epochs:
        loss, l1 = _validate(run, data)
        _require_finite(loss, "validation loss", epoch, settings)
    record = EpochRecord(
        epoch=epoch,
        step=run.position.step,
        learning_rate=rate,
        train_loss=run.position.loss_sum / len(data.train_index),
        validation_loss=loss,
        validation_l1=l1,
        seconds=time.perf_counter() - started,
    )
    best_epoch = run.position.best_epoch
    if loss is not None and loss < run.best_loss:
        run.best, best_epoch = {name: x.clone() for name, x in run.average.items()}, epoch
    run.history = (*run.history, record)
    run.position = Position(
        epoch=epoch,
        step=record.step,
        seconds=record.seconds,
        best_epoch=best_epoch,
        complete=epoch == settings.epochs or run.recipe.schedule.should_stop(run.history),
    )
    run.save()


def _run_steps(
    run: Run, frames: EpochData, started: float, progress: Callable[[Progress], None] | None
) -> float:
    """Take the steps left in the epoch, with a checkpoint now and then; returns the last learning rate."""
    settings, epoch = run.identity.settings, run.position.epoch + 1
    rows = frames.rows
    if run.recipe.balances:
        loaded = frames.labels[:, nonnegative(run.identity.schema)] > 0
        rows = balanced(rows, loaded, settings.seed, epoch)
    batches = epoch_batches(rows, settings.batch, settings.seed, epoch)
    steps = settings.epochs * len(batches)
    latest = run.history[-1] if run.history else None
    # A resumed epoch may have no step left, yet its record names the rate of its last one.
    rate = run.recipe.schedule.rate(settings.learning_rate, max(run.position.step - 1, 0), steps, run.history)
    saved = time.perf_counter()
    for chosen in batches[run.position.batch :]:
        rate = run.recipe.schedule.rate(settings.learning_rate, run.position.step, steps, run.history)
        mine = run.group.part(chosen)
        images: np.ndarray = frames.images[frames.stacks[mine]]
        if run.recipe.augments:
            images = augment_batch(images, settings.seed, epoch, run.position.batch, run.group.rank)
        loss, of_outputs = _step(run, frames, mine, images, rate, len(mine) / len(chosen))
        _require_finite(loss, "loss", epoch, settings)
        now = time.perf_counter()
        run.position = replace(
            run.position,
            batch=run.position.batch + 1,
            step=run.position.step + 1,
            loss_sum=run.position.loss_sum + of_outputs * len(chosen),
            seconds=now - started,
        )
        if now - saved >= CHECKPOINT_SECONDS:
            run.save()
            saved = now
        if progress is not None:
            progress(Progress(epoch, settings.epochs, run.position.step, steps, latest))
    return rate


def _step(
    run: Run, frames: EpochData, chosen: np.ndarray, images: np.ndarray, rate: float, part: float
) -> tuple[float, float]:
    """Take one step on the recipe's loss, of which these images are a part.

    returns  the loss before it, and that of the outputs alone
    """
    settings = run.identity.settings
    for group in run.optimizer.param_groups:
        group["lr"] = rate
    run.network.train()
    run.optimizer.zero_grad()
    low = settings.precision == "bfloat16"
    with torch.autocast(settings.device, torch.bfloat16, enabled=low):
        output = run.network(*_tensors(images, frames.commands, chosen, settings.device))
    losses = training_loss(
        answers(output.float(), run.network.outputs),
        (torch.from_numpy(frames.labels[chosen]).to(settings.device) - run.offset) / run.scale,
        torch.from_numpy(frames.auxiliary[chosen]).to(settings.device) / run.auxiliary_scale,
        nonnegative(run.identity.schema),
        run.recipe.smooth_l1_beta,
    )
    loss, own = (part * each for each in losses)
    loss.backward()
    gradients = (weight.grad for weight in run.network.parameters() if weight.grad is not None)
    all_reduce_sum(run.group, [loss, own, *gradients])
    run.optimizer.step()
    _update_average(run)
    whole, of_outputs = torch.stack([loss, own]).tolist()
    return whole, of_outputs


def _update_average(run: Run) -> None:
    """Move the running average of the weights; fast at first, when what it holds is far from trained."""
    steps = run.position.step
    decay = min(run.recipe.ema_decay, (1 + steps) / (10 + steps))
    with torch.no_grad():
        for name, tensor in run.network.state_dict().items():
            average = run.average[name]
            if tensor.dtype.is_floating_point:
                average.lerp_(tensor, 1 - decay)
            else:
                average.copy_(tensor)


def _validate(run: Run, data: TrainingData) -> tuple[float, float]:
    """The recipe's loss and the mean absolute error [the outputs' units] as they would be in use."""
    # On CPUs the statistics of batch normalisation differ between the processes.
    broadcast(run.group, (tensor for tensor in run.average.values() if tensor.is_floating_point()))
    offset = run.offset if run.identity.output_offset else None
    model = SensorModel(run.averaged(), run.scale, nonnegative(run.identity.schema), offset).eval()
    settings, index = run.identity.settings, data.validation_index
    seen = stacks(data.previous, settings.history, len(data.images))
    totals = torch.zeros(2, dtype=torch.float64)
    with torch.inference_mode():
        for start in range(0, len(index), _VALIDATION_BATCH)[run.group.rank :: run.group.size]:
            chosen = index[start : start + _VALIDATION_BATCH]
            truth = torch.from_numpy(data.labels[chosen]).to(settings.device)
            values, _, _ = model(*_tensors(data.images[seen[chosen]], data.commands, chosen, settings.device))
            loss = output_loss(values / run.scale, truth / run.scale, run.recipe.smooth_l1_beta)
            l1 = nn.functional.l1_loss(values, truth)
            totals += torch.tensor([loss.item(), l1.item()], dtype=torch.float64) * len(chosen)
    all_reduce_sum(run.group, [totals])
    loss, l1 = (totals / len(index)).tolist()
    return loss, l1


def _tensors(
    images: UInt8[np.ndarray, "batch stack height width"] | Float32[np.ndarray, "batch stack height width"],
    commands: Float32[np.ndarray, "frames channels"] | None,
    chosen: np.ndarray,
    device: str,
) -> tuple[Float[Tensor, "batch stack height width"], Float[Tensor, "batch channels"] | None]:
    """A batch of images in [0, 1] and the commands of the chosen frames; grays stay uint8 until here."""
    tensor = torch.from_numpy(images).to(device)
    if images.dtype == np.uint8:
        tensor = tensor.float().div_(255.0)
    return tensor, None if commands is None else torch.from_numpy(commands[chosen]).to(device)


def _check_slices(frames: int, batch: int, group: ProcessGroup) -> None:
    """Raise InputError if a slice may be of a single image, which would upset batch normalisation."""
    smallest = frames // -(-frames // batch)
    if smallest < 2 * group.size:
        raise InputError(
            f"batch: expected at least two images for each of {group.size} processes, got steps of "
            f"{smallest}; choose a larger batch or fewer processes"
        )


def _require_finite(loss: float, name: str, epoch: int, settings: Settings) -> None:
    if not math.isfinite(loss):
        raise InputError(
            f"the {name} is {loss} in epoch {epoch}: training has diverged; start again in a new folder "
            f"with a learning rate below {settings.learning_rate:g}"
        )


def _plain(identity: Mapping[str, str | int | float]) -> dict[str, str | int | float]:
    """Return the identity as its JSON reads back, so that a resumed run compares equal."""
    for name, value in identity.items():
        if not isinstance(value, str | int | float) or (
            isinstance(value, float) and not math.isfinite(value)
        ):
            raise InputError(f"data_identity: expected text or a finite number for {name}, got {value!r}")
    return json.loads(json.dumps(dict(identity)))


@contextlib.contextmanager
def _compute(settings: Settings) -> Iterator[None]:
    """Use the wanted threads and reproducible kernels, and put the global settings back afterwards."""
    threads = torch.get_num_threads()
    torch.set_num_threads(settings.threads)
    try:
        with torch.backends.cudnn.flags(enabled=True, benchmark=False, deterministic=True):
            yield
    finally:
        torch.set_num_threads(threads)
