"""The checkpoint file: everything from which a killed run goes on exactly, and the best network so far.

One safetensors file: tensors `network.*` (now), `average.*` (of its weights so far), `best.*` (that of the
lowest validation loss), `optimizer.exp_avg.*` and `optimizer.exp_avg_sq.*` (Adam's moments); in its header,
as text, the JSON of the rest of `Checkpoint` and a SHA-256 over everything. Nothing in it is ever executed.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import pydantic
import pydantic_core
import safetensors.torch
import torch
from torch import Tensor, nn

import exosight
from exosight.errors import DataError, InputError
from exosight.files import check_format, read_file, replace_file
from exosight.learning.config import Settings
from exosight.learning.history import EpochRecord
from exosight.learning.networks import Network, SensorModel, build_network
from exosight.learning.outputs import nonnegative
from exosight.system.schema import Schema
from exosight.validation import first_fault

CHECKPOINT_NAME = "checkpoint.safetensors"
MOMENTS = ("exp_avg", "exp_avg_sq")
_FORMAT = 3
_LARGEST_FILE = 2**36  # bytes; of images of 4096×4096 pixels it has five times 2**30

Count = Annotated[int, pydantic.Field(ge=0, lt=2**53)]
Sum = Annotated[float, pydantic.Field(allow_inf_nan=False)]


@dataclass(frozen=True)
class RunIdentity:
    """What a run is: it goes on only where all of this is the same."""

    settings: Settings
    data_identity: dict[str, str | int | float]
    fingerprint: str
    """SHA-256 of what it learns from and which frames choose its best epoch"""
    schema: Schema
    """of the system: its estimated sensors are the outputs, its first camera gives the image size"""
    output_scale: tuple[float, ...]
    """what one unit of each output stands for [the sensor's unit]"""
    auxiliary_scale: tuple[float, ...]
    """what one unit of each auxiliary output stands for"""
    output_offset: tuple[float, ...] = ()
    """what an output of 0 stands for [the sensor's unit]; empty: 0"""

    @property
    def offset(self) -> Tensor | None:
        """What an output of 0 stands for [the sensor's unit], on the CPU; None: 0."""
        return torch.tensor(self.output_offset, dtype=torch.float32) if self.output_offset else None

    def build_network(self) -> Network:
        """The network with its first weights."""
        settings = self.settings
        return build_network(
            settings.network,
            self.schema,
            len(self.auxiliary_scale),
            settings.seed,
            settings.history,
            settings.actuation,
        )


@dataclass(frozen=True)
class Position:
    """Where a run stands."""

    epoch: Count = 0
    """epochs completed"""
    batch: Count = 0
    """steps done in the epoch under way"""
    step: Count = 0
    """steps since the start"""
    loss_sum: Sum = 0.0
    """sum of the output losses of the epoch's images so far"""
    seconds: Sum = 0.0
    """time spent training [s]"""
    best_epoch: Count = 0
    """the epoch whose network is kept as the best, 0 before the first validation"""
    complete: bool = False
    """whether the run has come to its end"""


@dataclass(frozen=True)
class Versions:
    """What wrote the checkpoint."""

    exosight: str
    torch: str


@dataclass(frozen=True)
class Checkpoint:
    """A run at one moment; `tensors` are on the CPU."""

    run: RunIdentity
    position: Position
    history: tuple[EpochRecord, ...]
    versions: Versions
    tensors: Mapping[str, Tensor]


@dataclass(frozen=True)
class _Header:
    format: int
    run: RunIdentity
    position: Position
    history: tuple[EpochRecord, ...]
    versions: Versions


_HEADER = pydantic.TypeAdapter(_Header)


def save_checkpoint(
    folder: Path,
    run: RunIdentity,
    position: Position,
    history: tuple[EpochRecord, ...],
    tensors: Mapping[str, Tensor],
) -> None:
    """Write the checkpoint of a run into its folder, whole or not at all."""
    versions = Versions(exosight.__version__, torch.__version__)
    header = json.dumps(asdict(_Header(_FORMAT, run, position, history, versions)), allow_nan=False)
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    data = safetensors.torch.save(plain, {"exosight": header, "sha256": _digest(header, plain)})
    replace_file(folder / CHECKPOINT_NAME, data)


def load_checkpoint(source: Path) -> Checkpoint:
    """Read a checkpoint file, or the one in a run's folder.

    Raises DataError if it is missing, truncated, damaged, of another format, or does not fit its own network.
    """
    path = source / CHECKPOINT_NAME if source.is_dir() else source
    data = read_file(path, _LARGEST_FILE, "expected a training run's checkpoint")
    try:
        tensors = safetensors.torch.load(data)
        texts = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
        written, digest = texts["exosight"], texts["sha256"]
        values = pydantic_core.from_json(written, allow_inf_nan=False)
        found = values["format"]
    except (safetensors.SafetensorError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            f"{path}: not a checkpoint of exosight, or damaged; train again or use a copy"
        ) from error
    if digest != _digest(written, tensors):
        raise DataError(f"{path}: damaged, its checksum does not fit its contents; train again or use a copy")
    check_format(path, "checkpoint", found, _FORMAT, "train again in a new folder")
    try:
        header = _HEADER.validate_python(values)
    except pydantic.ValidationError as error:
        raise DataError(
            f"{path}: written by another version of exosight ({first_fault(error)}); use that one"
        ) from error
    checkpoint = Checkpoint(header.run, header.position, header.history, header.versions, tensors)
    if problem := _contradiction(checkpoint):
        raise DataError(f"{path}: contradicts itself: {problem}; train again or use a copy")
    return checkpoint


def load_model(source: Path) -> SensorModel:
    """Rebuild the best network of a run, ready to use on the CPU.

    Raises DataError as `load_checkpoint` does, and if the run has not been validated yet.
    """
    checkpoint = load_checkpoint(source)
    if checkpoint.position.best_epoch == 0:
        raise DataError(f"{source}: the run stopped before its first validation; resume it")
    run = checkpoint.run
    network = run.build_network()
    network.load_state_dict(_part(checkpoint.tensors, "best."))
    scale = torch.tensor(run.output_scale, dtype=torch.float32)
    return SensorModel(network, scale, nonnegative(run.schema), run.offset).eval()


def collect_tensors(
    network: nn.Module,
    average: Mapping[str, Tensor],
    best: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
) -> dict[str, Tensor]:
    """Name every tensor of a run as the checkpoint file does."""
    tensors = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    tensors |= {f"average.{name}": tensor for name, tensor in average.items()}
    tensors |= {f"best.{name}": tensor for name, tensor in best.items()}
    for name, parameter in network.named_parameters():
        for moment in MOMENTS:
            tensors[f"optimizer.{moment}.{name}"] = optimizer.state[parameter][moment]
    return tensors


def restore_tensors(
    checkpoint: Checkpoint,
    network: nn.Module,
    average: Mapping[str, Tensor],
    best: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
) -> None:
    """Copy a checkpoint's tensors into the network, its copies and the optimiser, in place.

    In place, since a tensor laid out otherwise in memory may be summed in another order.
    """
    with torch.no_grad():
        for name, tensor in collect_tensors(network, average, best, optimizer).items():
            tensor.copy_(checkpoint.tensors[name])
        for state in optimizer.state.values():
            state["step"].fill_(checkpoint.position.step)


def _digest(header: str, tensors: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256(header.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"{name}{tensor.dtype}{tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def _contradiction(checkpoint: Checkpoint) -> str | None:
    """Say where the header and the tensors, or the header and itself, disagree; None where they do not."""
    run, position, history = checkpoint.run, checkpoint.position, checkpoint.history
    if not run.schema.outputs:
        return "its system has no sensor to estimate"
    if len(run.output_scale) != len(run.schema.outputs) or not _are_scales(run.output_scale):
        return f"output_scale is {run.output_scale}"
    if len(run.output_offset) not in (0, len(run.schema.outputs)) or not _are_offsets(run.output_offset):
        return f"output_offset is {run.output_offset}"
    if len(run.auxiliary_scale) > 1000 or not _are_scales(run.auxiliary_scale):
        return f"auxiliary_scale is {run.auxiliary_scale[:3]}, …"
    if [record.epoch for record in history] != list(range(1, position.epoch + 1)):
        return f"{position.epoch} epochs done, but {len(history)} in the history"
    validated = {record.epoch for record in history if record.validation_loss is not None}
    if position.best_epoch not in validated | {0}:
        return f"the position is {position}"
    try:
        # No memory is taken for the weights, however large an image size the header claims.
        with torch.device("meta"):
            network = run.build_network()
    except InputError as error:
        return str(error)
    optimizer = torch.optim.AdamW(network.parameters())
    for parameter in network.parameters():
        optimizer.state[parameter] = dict.fromkeys(MOMENTS, parameter)
    expected = collect_tensors(network, network.state_dict(), network.state_dict(), optimizer)
    if expected.keys() != checkpoint.tensors.keys():
        odd = sorted(expected.keys() ^ checkpoint.tensors.keys())[0]
        return f"{odd} is in only one of the {run.settings.network} network and the file"
    for name, tensor in checkpoint.tensors.items():
        if tensor.shape != expected[name].shape or tensor.dtype != expected[name].dtype:
            return f"{name} is {tensor.dtype} {tuple(tensor.shape)} in the file"
        if not tensor.isfinite().all():
            return f"{name} is not finite"
    return None


def _are_scales(scales: tuple[float, ...]) -> bool:
    """Whether single precision holds them and their products with answers."""
    return all(1e-20 <= x <= 1e20 for x in scales)


def _are_offsets(offsets: tuple[float, ...]) -> bool:
    return all(-1e20 <= x <= 1e20 for x in offsets)


def _part(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}
