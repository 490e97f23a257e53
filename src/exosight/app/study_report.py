"""The report of a study: what its stages left behind, turned into sections."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata

import jax
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure

import exosight
from exosight.app import chapters
from exosight.app.pipeline import Data
from exosight.app.report import Report
from exosight.app.results import (
    DataSummary,
    Judgement,
    LoopRun,
    PathSummary,
    RobustnessSummary,
    SteeredLoop,
    TrainingRun,
)
from exosight.app.study_config import StudyConfig, to_text
from exosight.control import CONTROL_SHAPE, ControllerStudy, OnnxEstimator, Trial
from exosight.dataset import Split
from exosight.dataset.simulation import exosuit_of, load_path
from exosight.evaluation import figures
from exosight.exosuit.assembly import QUADRATURE, Exosuit, Pose, assemble, observe
from exosight.exosuit.shapes import FAMILIES, radius
from exosight.mechanics import drive, stack
from exosight.system.camera import Camera
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

    config: StudyConfig
    data: Data
    splits: Mapping[str, Split]
    """Protocol → division."""
    runs: Sequence[TrainingRun]
    judgements: Sequence[Judgement]
    robustness: RobustnessSummary
    steering: OnnxEstimator
    """The first network, for the overview."""
    loops: Sequence[SteeredLoop]


def build_report(results: Results, command: str) -> Report:
    """The whole page.

    command   the command line that makes the study again
    """
    seed = results.config.seed
    motion = _drive(exosuit_of(results.config.data, CONTROL_SHAPE), results.data.manifest.camera)
    versions = {name: metadata.version(name) for name in ("exosight", "jax", "numpy", "torch", "onnxruntime")}
    return Report(
        title="Contact forces of a soft finger exosuit, read from images",
        summary=(
            "A simulated study: exosuits bend a finger, a camera looks on, a network learns to read the "
            "contact forces off the pictures, and a controller uses it as its force sensor."
        ),
        sections=(
            chapters.introduction(_overview(motion, results.steering)),
            chapters.headline(results.runs, results.judgements, results.robustness, results.loops),
            chapters.motion(_path_summary(motion)),
            chapters.data_section(_data_summary(results)),
            chapters.learning(results.runs),
            chapters.accuracy(results.judgements),
            chapters.robustness_section(results.robustness),
            *(chapters.closed_loop(loop) for loop in results.loops),
            chapters.limits(),
            chapters.remake(command, to_text(results.config), seed, versions),
        ),
        footer=f"exosight {exosight.__version__}, seed {seed}",
    )


def steered_loop(name: str, folder: str, trials: ControllerStudy, shipped: bool) -> SteeredLoop:
    """The trials of one network in the terms of the report."""
    # The paper's own figure shows the poses of K_P = 1.
    shown = min(trials.step_responses, key=lambda trial: abs(trial.gain - 1)).record
    moments = np.linspace(0, len(shown.time) - 1, 6).round().astype(int)
    return SteeredLoop(
        name=name,
        folder=folder,
        shipped=shipped,
        steady=[_loop_run(trial) for trial in trials.steady_states],
        steps=[_loop_run(trial) for trial in trials.step_responses],
        poses=shown.images[moments],
        pose_times=shown.time[moments].tolist(),
    )


def _loop_run(trial: Trial) -> LoopRun:
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
    u: Float[np.ndarray, " steps"]
    """Actuation [N]."""
    pose: Pose
    images: UInt8[np.ndarray, "steps height width"]


def _drive(exosuit: Exosuit, camera: Camera) -> _Motion:
    u, _ = load_path(frames=101)
    robot = assemble(exosuit)
    found = drive([robot], u[:, None])
    pose: Pose = jax.tree.map(lambda leaf: np.asarray(leaf)[0], observe(stack([robot]), found.q))
    return _Motion(exosuit, u, pose, picture(exosuit, pose, camera))


def _path_summary(motion: _Motion) -> PathSummary:
    pose = motion.pose
    tips = np.asarray(pose.centreline[:, -1, ::2])
    return PathSummary(motion.u, np.asarray(pose.net_force), figures.find_snaps(tips), motion.images)


def _overview(motion: _Motion, estimator: OnnxEstimator) -> Figure:
    finger = motion.exosuit.finger
    rising = motion.u[: len(motion.u) // 2]
    moment = int(np.argmin(np.abs(rising - SHOWN_LOAD)))
    pose: Pose = jax.tree.map(lambda leaf: leaf[moment], motion.pose)
    image = motion.images[moment]
    centres = np.array([finger.centre_of_mass(link) for link in range(len(finger.lengths))])
    return figures.overview(
        np.asarray(pose.centreline[:, ::2]),
        radius(motion.exosuit.shape.surface, QUADRATURE.points),
        figures.sphere_centres(np.asarray(pose.finger[:, ::2]), centres),
        np.array(finger.sphere_radii()),
        image,
        np.asarray(pose.forces[1:]),
        estimator.estimate(image[None])[0].astype(float),
    )
