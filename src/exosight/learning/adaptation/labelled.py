"""Pictures with what the sensors read."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, UInt8
from torch import Tensor

from exosight.learning.networks import SensorModel
from exosight.learning.ood import batches


@dataclass(frozen=True)
class Labelled:
    """Pictures with what the sensors read, a row a picture."""

    images: UInt8[np.ndarray, "frames stack height width"]
    """each with those before it, as many as are inputs of the network"""
    commands: Float32[np.ndarray, "frames channels"] | None
    """[the channels' units], for a network that has them as an input"""
    labels: Float32[np.ndarray, "frames outputs"]
    """[the sensors' units]"""
    sequence: Int[np.ndarray, " frames"]
    """number of the recording that each is of"""

    def __len__(self) -> int:
        return len(self.images)

    def take(self, rows: np.ndarray) -> "Labelled":
        """Some of them."""
        commands = None if self.commands is None else self.commands[rows]
        return Labelled(self.images[rows], commands, self.labels[rows], self.sequence[rows])

    def without(self, rows: np.ndarray) -> "Labelled":
        """All others."""
        return self.take(np.setdiff1d(np.arange(len(self)), rows))

    def tensors(
        self,
    ) -> tuple[Float[Tensor, "frames stack height width"], Float[Tensor, "frames channels"] | None]:
        """Pictures in [0, 1], and commands."""
        return torch.from_numpy(self.images).float() / 255, (
            None if self.commands is None else torch.from_numpy(self.commands)
        )


def joined(first: Labelled, second: Labelled) -> Labelled:
    """Both, one after the other."""
    commands = (
        None
        if first.commands is None or second.commands is None
        else np.concatenate([first.commands, second.commands])
    )
    return Labelled(
        np.concatenate([first.images, second.images]),
        commands,
        np.concatenate([first.labels, second.labels]),
        np.concatenate([first.sequence, second.sequence]),
    )


def folds(sequence: Int[np.ndarray, " frames"], count: int) -> list[Int[np.ndarray, " _"]]:
    """Rows that are left out together, in at most so many folds: whole sequences, or stretches of one."""
    names, sizes = np.unique(sequence, return_counts=True)
    if len(names) == 1:
        return list(np.array_split(np.arange(len(sequence)), min(count, len(sequence))))
    found: list[list[int]] = [[] for _ in range(min(count, len(names)))]
    for name in names[np.argsort(-sizes, kind="stable")]:
        min(found, key=len).extend(np.flatnonzero(sequence == name).tolist())
    return [np.sort(np.array(rows, np.intp)) for rows in found]


def features(model: SensorModel, data: Labelled) -> Float[Tensor, "frames features"]:
    """What the last layer gets."""
    with torch.no_grad():
        return torch.cat([model.network.features(*part) for part in batches(data.images, data.commands)])
