"""The state of a training run: made anew or taken from a checkpoint, and saved."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor, nn

from exosight.errors import InputError
from exosight.learning.checkpoint import (
    CHECKPOINT_NAME,
    MOMENTS,
    Position,
    RunIdentity,
    collect_tensors,
    load_checkpoint,
    restore_tensors,
    save_checkpoint,
)
from exosight.learning.history import HISTORY_NAME, EpochRecord, write_history
from exosight.learning.networks import Network
from exosight.learning.parallel import broadcast, check_identical, synchronised
from exosight.learning.process_group import ProcessGroup
from exosight.learning.recipes import RECIPES
from exosight.system.schema import difference
from exosight.validation import first_difference


class Run:
    """Everything that changes while a run goes on: exactly what its checkpoint holds."""

    def __init__(
        self,
        identity: RunIdentity,
        folder: Path,
        group: ProcessGroup,
        weights: Mapping[str, Tensor] | None = None,
    ):
        """`weights`: the first ones, if they are not to follow from the seed."""
        settings = identity.settings
        self.identity = identity
        self.folder = folder
        self.group = group
        self.recipe = RECIPES[settings.recipe]
        network = identity.build_network()
        if weights is not None:
            network.load_state_dict(weights)
            # Worked out on each machine: rounded as on the first.
            broadcast(
                group, (tensor for tensor in network.state_dict().values() if tensor.is_floating_point())
            )
        network = synchronised(group, network)
        # Channels last: a step takes 60 to 90 % of the time that it takes otherwise.
        self.network = network.to(memory_format=torch.channels_last).to(settings.device)  # pyright: ignore[reportCallIssue]
        self.scale = torch.tensor(identity.output_scale, dtype=torch.float32, device=settings.device)
        offset = identity.offset
        self.offset = (torch.zeros_like(self.scale) if offset is None else offset).to(settings.device)
        self.auxiliary_scale = torch.tensor(
            identity.auxiliary_scale, dtype=torch.float32, device=settings.device
        )
        # With no weight decay AdamW is Adam to the letter.
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=settings.learning_rate, weight_decay=self.recipe.weight_decay
        )
        for parameter in self.network.parameters():
            zeros = {moment: torch.zeros_like(parameter) for moment in MOMENTS}
            self.optimizer.state[parameter] = {"step": torch.zeros(()), **zeros}
        self.average = copy_of(self.network)
        self.best = copy_of(self.network)
        self.position = Position()
        self.history: tuple[EpochRecord, ...] = ()

    @property
    def best_loss(self) -> float:
        """The lowest validation loss so far, infinite before the first."""
        losses = (record.validation_loss for record in self.history)
        return min((loss for loss in losses if loss is not None), default=math.inf)

    def averaged(self) -> Network:
        """The network with the running average of its weights, which is what is validated and kept."""
        network = self.identity.build_network().to(self.identity.settings.device)
        network.load_state_dict(self.average)
        return network

    def save(self) -> None:
        """The first process writes checkpoint, then loss curves: of the two, the checkpoint decides."""
        if not self.group.first:
            return
        tensors = collect_tensors(self.network, self.average, self.best, self.optimizer)
        save_checkpoint(self.folder, self.identity, self.position, self.history, tensors)
        write_history(self.folder, self.history)


def open_run(
    identity: RunIdentity,
    folder: Path,
    resume: bool,
    group: ProcessGroup,
    weights: Mapping[str, Tensor] | None = None,
) -> Run:
    """Start a run in a folder that has none, or with `resume` take it up from the folder's checkpoint.

    weights   the first ones of a run that starts, if they are not to follow from the seed

    Raises InputError if the folder holds a run that is not to be, or cannot be, resumed, or if the processes
    of a group have different runs before them; DataError if its checkpoint is damaged.
    """
    run = Run(identity, folder, group, weights)
    if not (folder / CHECKPOINT_NAME).exists():
        if (folder / HISTORY_NAME).exists():
            raise InputError(
                f"{folder}: holds a {HISTORY_NAME} without its checkpoint; choose another folder"
            )
        _check_one_run(run)
        folder.mkdir(parents=True, exist_ok=True)
        run.save()
        return run
    if not resume:
        raise InputError(f"{folder}: already holds a training run; resume it or choose another folder")
    checkpoint = load_checkpoint(folder)
    if other := _difference_of_runs(checkpoint.run, identity):
        raise InputError(f"{folder}: holds another run ({other}); ask for the same or choose another folder")
    restore_tensors(checkpoint, run.network, run.average, run.best, run.optimizer)
    run.position, run.history = checkpoint.position, checkpoint.history
    _check_one_run(run)
    if group.first:
        # A run killed between the two files left a table one epoch short.
        write_history(folder, run.history)
    return run


def _check_one_run(run: Run) -> None:
    """That all processes have the same run before them, and have looked before the first writes."""
    check_identical(
        run.group,
        f"{run.identity} {run.position}",
        f"{run.folder}: the processes of this run differ in settings, data or checkpoint; start all with one "
        "command, on alike machines, with folders that all of them see",
    )


def copy_of(network: nn.Module) -> dict[str, Tensor]:
    """Copy a network's weights and running statistics."""
    return {name: tensor.detach().clone() for name, tensor in network.state_dict().items()}


def _difference_of_runs(there: RunIdentity, asked: RunIdentity) -> str | None:
    """How the system or anything else differs, in words; None if two runs are the same."""
    before, now = asdict(there), asdict(asked)
    del before["schema"], now["schema"]
    if other := difference(there.schema, asked.schema):
        return f"of another system: {other}"
    found = first_difference(before, now)
    if found is None:
        return None
    name, *values = found
    if name == "fingerprint":
        return "its frames or their split are others"
    has, wants = ("none" if value in ("", None) else value for value in values)
    return f"its {name} is {has}, asked for is {wants}"
