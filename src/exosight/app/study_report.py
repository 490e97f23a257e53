"""The report of a study: what its stages left behind, turned into sections."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

import exosight
from exosight.app import chapters
from exosight.app.pipeline import Data
from exosight.app.report import Report
from exosight.app.results import DataSummary, Judgement, LoopRun, PathSummary, RobustnessSummary, TrainingRun
from exosight.control import CONTROL_SHAPE, OnnxEstimator, Trial
from exosight.dataset import Split
from exosight.dataset.generation import load_path
from exosight.evaluation import figures
from exosight.exosuit.assembly import QUADRATURE, Exosuit, assemble, observe
from exosight.exosuit.shapes import FAMILIES, radius
from exosight.mechanics import follow, stack
from exosight.vision.camera import Camera
from exosight.vision.scene import picture

SHOWN_LOAD = 2.4
"""Load of the pose in the first figure [N]: the one at which the paper gives a net force."""

_DROPPED = {
    "not_converged": "no stable equilibrium found",
    "crosses_itself": "exosuit crosses itself",
    "tip_below_finger": "exosuit tip below the fingertip",
}


@dataclass(frozen=True)
class Results:
    """What a study found, stage by stage."""

    data: Data
    splits: Mapping[str, Split]
    """Protocol → division."""
    runs: Sequence[TrainingRun]
    judgements: Sequence[Judgement]
    robustness: RobustnessSummary
    steering: OnnxEstimator
    """The network that steers the closed loop."""
    trials: Sequence[Trial]
    """Constant targets, then step responses."""


def build_report(results: Results, command: str, config: str, seed: int) -> Report:
    """The whole page.

    command, config, seed   how the study was made, and is made again
    """
    motion = _Motion(Exosuit(CONTROL_SHAPE), results.data.manifest.camera)
    steady = [loop_run(trial) for trial in results.trials if trial.record.target[-1] > 0]
    steps = [loop_run(trial) for trial in results.trials if trial.record.target[-1] == 0]
    middle = next((trial for trial in results.trials[len(steady) :] if trial.gain == 1), results.trials[-1])
    moments = np.linspace(0, len(middle.record.time) - 1, 6).round().astype(int)
    versions = {name: metadata.version(name) for name in ("exosight", "jax", "numpy", "torch", "onnxruntime")}
    return Report(
        title="Contact forces of a soft finger exosuit, read from images",
        summary=(
            "A simulated study: exosuits bend a finger, a camera looks on, a network learns to read the "
            "contact forces off the pictures, and a controller uses it as its force sensor."
        ),
        sections=(
            chapters.introduction(_overview(motion, results.steering)),
            chapters.headline(results.runs, results.judgements, results.robustness, steady),
            chapters.motion(motion.summary()),
            chapters.data_section(_data_summary(results)),
            chapters.learning(results.runs),
            chapters.accuracy(results.judgements),
            chapters.robustness_section(results.robustness),
            chapters.closed_loop(
                steady, steps, middle.record.images[moments], [float(t) for t in middle.record.time[moments]]
            ),
            chapters.limits(),
            chapters.remake(command, config, seed, versions),
        ),
        footer=f"exosight {exosight.__version__}, seed {seed}",
    )


def loop_run(trial: Trial) -> LoopRun:
    """A trial in the terms of the report."""
    settled = trial.response.settling_steps
    return LoopRun(
        gain=trial.gain,
        trace=trial.record,
        settling_steps=int(settled) if np.isfinite(settled) else None,
        overshoot=trial.response.overshoot,
        steady_state_error=trial.response.steady_state_error,
    )


def _data_summary(results: Results) -> DataSummary:
    manifest, frames = results.data.manifest, results.data.frames
    return DataSummary(
        shapes=len(manifest.shapes),
        dropped={_DROPPED[cause]: count for cause, count in manifest.dropped.items()},
        kept={name.replace("_", " "): int(np.sum(frames.family == i)) for i, name in enumerate(FAMILIES)},
        splits={
            f"by {protocol}": (len(split.train), len(split.validation), len(split.test))
            for protocol, split in results.splits.items()
        },
    )


@dataclass(frozen=True)
class _Motion:
    """One exosuit driven 0 → 4 → 0 N, for the pictures."""

    exosuit: Exosuit
    camera: Camera
    u: np.ndarray = field(init=False)
    pose: Any = field(init=False)

    def __post_init__(self) -> None:
        u, _ = load_path(50)
        robot = assemble(self.exosuit)
        found = follow([robot], u[:, None])
        pose = jax.tree.map(lambda leaf: np.asarray(leaf)[0], observe(stack([robot]), found.q))
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "pose", pose)

    def summary(self) -> PathSummary:
        return PathSummary(
            u=self.u,
            net_force=self.pose.net_force,
            snaps=figures.find_snaps(self.pose.centreline[:, -1, ::2]),
            images=picture(self.exosuit, self.pose, self.camera),
        )


def _overview(motion: _Motion, estimator: OnnxEstimator) -> Figure:
    finger = motion.exosuit.finger
    rising = motion.u[: len(motion.u) // 2]
    moment = int(np.argmin(np.abs(rising - SHOWN_LOAD)))
    pose = jax.tree.map(lambda leaf: leaf[moment : moment + 1], motion.pose)
    image = picture(motion.exosuit, pose, motion.camera)
    centres = np.array([finger.centre_of_mass(link) for link in range(len(finger.lengths))])
    return figures.overview(
        pose.centreline[0, :, ::2],
        radius(motion.exosuit.shape.surface, QUADRATURE.points),
        figures.sphere_centres(pose.finger[0, :, ::2], centres),
        np.array(finger.sphere_radii()),
        image[0],
        pose.forces[0, 1:],
        estimator.estimate(image)[0].astype(float),
    )
