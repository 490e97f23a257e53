"""What a study has found, as plain data: the material of its report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from exosight.control import Trial
from exosight.evaluation.metrics import Scores, score
from exosight.learning.history import EpochRecord
from exosight.system.schema import Schema


@dataclass(frozen=True)
class PathSummary:
    """One exosuit driven from 0 N up and back to 0 N in even steps."""

    u: Float[np.ndarray, " steps"]
    """Actuation [N]."""
    net_force: Float[np.ndarray, " steps"]
    """F_net [N]."""
    snaps: Bool[np.ndarray, " steps"]
    """Whether the pose jumped since the step before."""
    images: UInt8[np.ndarray, "steps height width"]


@dataclass(frozen=True)
class DataSummary:
    """What was simulated and how it was divided."""

    shapes: int
    dropped: Mapping[str, int]
    """Cause, in words → frames left out."""
    kept: Mapping[str, int]
    """Family of shapes → frames kept."""
    splits: Mapping[str, tuple[int, int, int]]
    """Name of the split → frames to learn from, to choose the best epoch, to test."""


@dataclass(frozen=True)
class TrainingRun:
    """One network that was trained."""

    name: str
    """Network and split: "light network, by shape"."""
    parameters: int
    frames: int
    """Frames learned from."""
    history: Sequence[EpochRecord]
    loss: str
    """The loss with its unit, for the axis: "L1 loss [N]"."""

    @property
    def minutes(self) -> float:
        """Time spent training [min]."""
        return self.history[-1].seconds / 60

    @property
    def best(self) -> EpochRecord:
        """The epoch whose network is kept: the lowest validation loss."""
        checked = [(r.validation_loss, r) for r in self.history if r.validation_loss is not None]
        return min(checked, key=lambda pair: pair[0])[1]


@dataclass(frozen=True)
class NetworkResult:
    """One trained network on frames that it has not learned from."""

    name: str
    """Network and split, as in its `TrainingRun`."""
    schema: Schema
    """Of the system whose sensors are estimated."""
    true: Float[np.ndarray, "frames outputs"]
    """What the estimated sensors read [their units]."""
    estimated: Float[np.ndarray, "frames outputs"]
    """[their units]"""

    @property
    def scores(self) -> Scores:
        """RMSE, RMS% and r."""
        return score(self.schema, self.true, self.estimated)


@dataclass(frozen=True)
class RobustnessSummary:
    """The estimator of the closed loop on degraded images."""

    name: str
    """Network and split, as in its `TrainingRun`."""
    cases: Mapping[str, Scores]
    """"clean" and each corruption → scores."""
    examples: Mapping[str, UInt8[np.ndarray, "frames height width"]]
    """The same few frames, "clean" and in each corruption."""
    learned: bool
    """Whether the network has learned from noisy and faded pictures."""


@dataclass(frozen=True)
class LoopResult:
    """The closed loop with one network as its force sensor."""

    name: str
    """Network and split, as in its `TrainingRun`, or "shipped network"."""
    folder: str
    """Where its time series lie in the study's folder, and what its tables are named after."""
    shipped: bool
    """Whether it is the network that comes with the package, not one trained here."""
    trials: Sequence[Trial]
    """The six of the paper."""

    @property
    def constant(self) -> list[Trial]:
        """Those with a constant target."""
        return [trial for trial in self.trials if not trial.released]

    @property
    def steps(self) -> list[Trial]:
        """The step responses: a target for a while, then 0 N."""
        return [trial for trial in self.trials if trial.released]


@dataclass(frozen=True)
class SurfaceResult:
    """The controller's exosuit on `index`, which the report shows beside `published`."""

    u: Float[np.ndarray, " steps"]
    """Actuation, from 0 N up and back [N]."""
    net_force: Float[np.ndarray, " steps"]
    """F_net [N]."""
    loops: Sequence[LoopResult]
    """The paper's constant targets, with this study's network and the shipped one, where there are any."""
    run: TrainingRun | None
    """This study's network on `index`, if it has one."""
    result: NetworkResult | None
    """That network on frames that it has not learned from."""
