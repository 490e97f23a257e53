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
from exosight.app.data import Data
from exosight.app.report import Report
from exosight.app.results import (
    DataSummary,
    LoopResult,
    NetworkResult,
    PathSummary,
    RobustnessSummary,
    SurfaceResult,
    TrainingRun,
)
from exosight.app.study_config import SPLIT_WORDS, StudyConfig, to_text
from exosight.control import OnnxEstimator
from exosight.dataset import Split
from exosight.dataset.load_paths import load_path
from exosight.evaluation import figures
from exosight.evaluation.naming import contacts
from exosight.exosuit.assembly import QUADRATURE, ROD, Exosuit
from exosight.exosuit.published import published
from exosight.exosuit.shapes import radius
from exosight.mechanics import drive
from exosight.system.camera import Camera
from exosight.system.observation import Observation, observe
from exosight.system.system import System, stack_systems
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
    network_results: Sequence[NetworkResult]
    robustness: RobustnessSummary
    estimator: OnnxEstimator
    """The first network, for the overview."""
    loops: Sequence[LoopResult]
    exosuit: Exosuit
    """That of the closed loop, for the pictures of how it moves."""
    surfaces: SurfaceResult | None
    """The same exosuit on `index`, if there is a network for it."""

    @property
    def all_runs(self) -> list[TrainingRun]:
        """Of both systems."""
        return [*self.runs, *([self.surfaces.run] if self.surfaces and self.surfaces.run else [])]

    @property
    def all_results(self) -> list[NetworkResult]:
        """Of both systems."""
        own = self.surfaces.result if self.surfaces else None
        return [*self.network_results, *([own] if own else [])]

    @property
    def all_loops(self) -> list[LoopResult]:
        """Of both systems."""
        return [*self.loops, *(self.surfaces.loops if self.surfaces else [])]


def build_report(results: Results, command: str) -> Report:
    """The whole page.

    command   the command line that makes the study again
    """
    seed = results.config.seed
    camera = results.data.manifest.camera
    assert camera is not None  # a study's data are simulated
    motion = _drive(results.exosuit, camera)
    schema = motion.system.schema
    path = _path_summary(motion)
    versions = {name: metadata.version(name) for name in ("exosight", "jax", "numpy", "torch", "onnxruntime")}
    return Report(
        title="Contact forces of a soft finger exosuit, estimated from images",
        summary=(
            "A simulation study: exosuits bend a finger, a network is trained to estimate the contact forces "
            "from camera images, and a controller uses it as its force sensor."
        ),
        sections=(
            chapters.introduction(_overview(motion, results.estimator), schema),
            chapters.headline(results.all_runs, results.all_results, results.robustness, results.all_loops),
            chapters.motion(path),
            chapters.data_section(_data_summary(results)),
            chapters.learning(results.all_runs, schema.outputs),
            chapters.accuracy(results.network_results),
            chapters.robustness_section(results.robustness),
            *(chapters.closed_loop(loop) for loop in results.loops),
            *(
                [chapters.contact_models(path, results.surfaces, results.loops)]
                if results.surfaces is not None
                else []
            ),
            chapters.limits(),
            chapters.remake(command, to_text(results.config), seed, versions),
        ),
        footer=f"exosight {exosight.__version__}, seed {seed}",
    )


def _data_summary(results: Results) -> DataSummary:
    manifest, frames = results.data.manifest, results.data.frames
    return DataSummary(
        shapes=len(manifest.designs),
        dropped={_DROPPED[cause]: count for cause, count in manifest.dropped.items()},
        kept={
            name.replace("_", " "): int(np.sum(frames.family == i))
            for i, name in enumerate(manifest.families)
        },
        splits={
            f"by {SPLIT_WORDS[protocol]}": (len(split.train), len(split.validation), len(split.test))
            for protocol, split in results.splits.items()
        },
    )


@dataclass(frozen=True)
class _Motion:
    """One exosuit driven 0 → 4 → 0 N, for the pictures."""

    exosuit: Exosuit
    system: System
    u: Float[np.ndarray, " steps"]
    """Command [N]."""
    seen: Observation
    """With one batch dimension: the steps."""
    images: UInt8[np.ndarray, "steps height width"]


def _drive(exosuit: Exosuit, camera: Camera) -> _Motion:
    system = published(exosuit, camera)
    commands = load_path(system.schema, frames=50, seed=0, number=0).commands
    found = drive([system.robot], system.loads(commands))
    seen = jax.tree.map(lambda leaf: np.asarray(leaf)[0], observe(stack_systems([system]), found.q))
    return _Motion(exosuit, system, commands[:, 0], seen, picture(system, seen.axes))


def _path_summary(motion: _Motion) -> PathSummary:
    schema, seen = motion.system.schema, motion.seen
    tips = np.asarray(seen.axes[ROD][:, -1, ::2])
    net_force = np.asarray(seen.readings[:, schema.index(schema.controlled)])
    return PathSummary(motion.u, net_force, figures.find_snaps(tips), motion.images)


def _overview(motion: _Motion, estimator: OnnxEstimator) -> Figure:
    schema = motion.system.schema
    rising = motion.u[: len(motion.u) // 2]
    moment = int(np.argmin(np.abs(rising - SHOWN_LOAD)))
    seen: Observation = jax.tree.map(lambda leaf: leaf[moment], motion.seen)
    image = motion.images[moment]
    true = seen.readings[schema.output_indices()].tolist()
    estimated = estimator.estimate(image[None])[0].astype(float).tolist()
    rod_radii = radius(motion.exosuit.shape.surface, QUADRATURE.points)
    return figures.overview(
        figures.Outline(np.asarray(seen.axes[ROD])[:, ::2], rod_radii),
        figures.Outline(np.asarray(seen.places)[:, ::2], np.array(motion.exosuit.finger.sphere_radii())),
        contacts(schema),
        image,
        dict(zip(schema.outputs, zip(true, estimated, strict=True), strict=True)),
    )
