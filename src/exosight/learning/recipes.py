"""The two ways to train: the paper's, and the modern one that is the default.

A recipe is constants and two pure functions of where the run stands and of its history, so a resumed run
needs no scheduler state to go on as if it had never stopped.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from exosight.learning.history import EpochRecord


@runtime_checkable
class Recipe(Protocol):
    """How a network is trained; adding a way to train is adding one of these to `RECIPES`."""

    @property
    def learning_rate(self) -> float:
        """Default of the largest learning rate."""
        ...

    @property
    def epochs(self) -> int:
        """Default number of epochs."""
        ...

    @property
    def batch(self) -> int:
        """Default number of images a step."""
        ...

    @property
    def precision(self) -> Literal["float32", "bfloat16"] | None:
        """The one it asks for; None: the fastest that the machine has."""
        ...

    @property
    def weight_decay(self) -> float:
        """Decoupled weight decay (AdamW); 0 is plain Adam."""
        ...

    @property
    def scales_outputs(self) -> bool:
        """Whether the loss measures each output in its own standard deviation, or all in their units."""
        ...

    @property
    def loss_corner(self) -> float:
        """Error at which the loss turns from a square to its absolute value; 0 is plain L1."""
        ...

    @property
    def augments(self) -> bool:
        """Whether the training images are moved, faded and made noisy at random, see `augmentation`."""
        ...

    @property
    def balances(self) -> bool:
        """Whether frames that load a rarely loaded contact come more often, see `training_data.balanced`."""
        ...

    @property
    def memory(self) -> float:
        """Share of the running average of the weights that a step leaves; 0: the last weights are kept."""
        ...

    @property
    def validate_every(self) -> int:
        """Epochs between validations."""
        ...

    def rate(self, peak: float, step: int, steps: int, history: Sequence[EpochRecord]) -> float:
        """Learning rate of a step, counted from 0 of `steps`, after the epochs in `history`."""
        ...

    def stalled(self, history: Sequence[EpochRecord]) -> bool:
        """Whether the history says to stop before the last epoch."""
        ...


@dataclass(frozen=True)
class Modern:
    """One-cycle AdamW: the rate rises over the first 30 % of the steps, then falls to nearly nothing.

    Plain L1 answers the median, which is zero for a contact that is rarely loaded: from 66 shapes, C7 was
    never found at all (r = 0 on unseen shapes, against 0.7 with squares below one standard deviation). Forces
    do not depend on where in the picture the exosuit is; moving it raised the mean r there from 0.83 to 0.86.

    Source: Smith and Topin, Super-convergence, doi 10.1117/12.2520589; branches as in PyTorch's OneCycleLR.
    """

    learning_rate: float = 3e-3
    epochs: int = 40
    batch: int = 128
    precision: Literal["float32", "bfloat16"] | None = None
    weight_decay: float = 0.01
    scales_outputs: bool = True
    loss_corner: float = 1.0
    augments: bool = True
    balances: bool = True
    memory: float = 0.999
    validate_every: int = 1

    def rate(self, peak: float, step: int, steps: int, history: Sequence[EpochRecord]) -> float:
        """peak/25 → peak → peak/250 000, both branches half a cosine wave."""
        start, end = peak / 25.0, peak / 25.0e4
        top = max(0.3 * steps - 1.0, 0.0)
        if step < top:
            return _cosine(start, peak, step / top)
        return _cosine(peak, end, (step - top) / max(steps - 1.0 - top, 1.0))

    def stalled(self, history: Sequence[EpochRecord]) -> bool:
        """Never: the cycle only makes sense whole."""
        return False


@dataclass(frozen=True)
class Paper:
    """Adam at 2e-4, a tenth of it on each plateau, until five validations in a row bring nothing better.

    A plateau is 10 epochs without a lower validation loss, counted from the last lower one or the last cut;
    the paper says "after at least 10 epochs" and leaves the rest open.
    """

    learning_rate: float = 2e-4
    epochs: int = 2000
    batch: int = 64
    precision: Literal["float32", "bfloat16"] | None = "float32"
    weight_decay: float = 0.0
    scales_outputs: bool = False
    loss_corner: float = 0.0
    augments: bool = False
    balances: bool = False
    memory: float = 0.0
    validate_every: int = 5
    plateau_epochs: int = 10
    patience: int = 5

    def rate(self, peak: float, step: int, steps: int, history: Sequence[EpochRecord]) -> float:
        """peak · 0.1^(plateaus so far)."""
        cuts, _ = self._replay(history)
        return peak * 0.1**cuts

    def stalled(self, history: Sequence[EpochRecord]) -> bool:
        """Whether the last five validations were all no better than an earlier one."""
        _, stale = self._replay(history)
        return stale >= self.patience

    def _replay(self, history: Sequence[EpochRecord]) -> tuple[int, int]:
        """Cuts of the learning rate so far, and validations since the best one."""
        best, cuts, stale, waiting_since = math.inf, 0, 0, 0
        for record in history:
            if record.validation_loss is None:
                continue
            if record.validation_loss < best:
                best, stale, waiting_since = record.validation_loss, 0, record.epoch
                continue
            stale += 1
            if record.epoch - waiting_since >= self.plateau_epochs:
                cuts, waiting_since = cuts + 1, record.epoch
        return cuts, stale


def _cosine(start: float, end: float, fraction: float) -> float:
    return end + (start - end) * (1.0 + math.cos(math.pi * fraction)) / 2.0


RECIPES: dict[str, Recipe] = {
    "modern": Modern(),
    "clean": Modern(augments=False, balances=False),
    "paper": Paper(),
}
