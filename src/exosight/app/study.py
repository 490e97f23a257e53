"""The study: data → networks → evaluation → closed loop → report, each stage kept on disk as it is done."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from exosight.app.console import progress, say
from exosight.app.control_command import run_with_progress, write_trials
from exosight.app.data import Data, load
from exosight.app.output import new_folder
from exosight.app.pipeline import MODEL, camera_of, check_training, fit
from exosight.app.report import write_report, write_tables
from exosight.app.results import LoopResult, NetworkResult, RobustnessSummary, SurfaceResult, TrainingRun
from exosight.app.study_config import CONFIG, PRESETS, RunConfig, StudyConfig, read_config, to_text
from exosight.app.study_report import Results, build_report
from exosight.control import CONTROL_SHAPE, OnnxEstimator, Trial, from_image, published_trials
from exosight.control.estimator import DEFAULT_MODEL, SHIPPED_MODELS
from exosight.control.simulated import SimulatedPlant
from exosight.dataset import Split, make_split
from exosight.dataset.config import GenerateConfig
from exosight.dataset.generation import generate
from exosight.dataset.load_paths import load_path
from exosight.dataset.manifest import MANIFEST
from exosight.errors import DataError, InputError
from exosight.evaluation import evaluate_robustness
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import NAME as INDEX
from exosight.exosuit.index import index
from exosight.exosuit.published import published
from exosight.files import write_new_file
from exosight.learning.config import resolve
from exosight.learning.history import EpochRecord
from exosight.learning.outputs import auxiliary_units
from exosight.learning.recipes import RECIPES, Recipe
from exosight.system.camera import Camera
from exosight.vision.corruptions import corrupt

REPORT = "report.html"
"""Name of the report in a study's folder."""

INDEX_NETWORK = "index_network"
"""Folder of the network that is trained on `index`."""

SHIPPED_NETWORK = "shipped network"
"""What a report calls the network that comes with the package."""


def run_study(config: StudyConfig, out: Path, *, resume: bool = False) -> Path:
    """Run a study in a new folder and return the path of its report.

    With `resume` the folder may hold the same study, stopped at any point: what is done is not done again.

    Raises DataError or InputError if the folder is in use, or holds another study.
    """
    check_training()
    folder = _open(config, out, resume)
    report = folder / REPORT
    if report.exists():
        return report
    data = _data(config.data, folder / "data")
    protocols = dict.fromkeys(run.protocol for run in config.runs)
    splits = {protocol: make_split(data.frames, protocol, config.seed) for protocol in protocols}
    networks = [
        _trained(run.name, run, data, splits[run.protocol], folder / run.folder) for run in config.runs
    ]
    first = networks[0].estimator
    say("evaluating on degraded images")
    robustness = _robustness(config, first, data, splits[config.runs[0].protocol].test)
    camera = camera_of(first.card)
    loops = _closed_loops(config, first, camera, folder)
    surfaces = _surfaces(config, camera, folder)
    say("writing the report")
    results = Results(
        config,
        data,
        splits,
        [network.run for network in networks],
        [network.result for network in networks],
        robustness,
        first,
        loops,
        _exosuit(config.data),
        surfaces,
    )
    page = build_report(results, _command(config, out))
    if not (folder / "tables").exists():
        with new_folder(folder / "tables") as place:
            write_tables(page, place)
    write_report(page, report)
    return report


def _open(config: StudyConfig, out: Path, resume: bool) -> Path:
    """The study's folder, new or resumed."""
    path = out / CONFIG
    if resume and path.exists():
        if read_config(path) != config:
            raise InputError(f"{out}: holds a study with another configuration; name a new folder")
        return out
    if out.exists() and not (resume and out.is_dir() and not any(out.iterdir())):
        remedy = "it holds no study" if resume else "or add --resume to go on with its study"
        raise DataError(f"{out}: exists already; name a new folder, {remedy}")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"{out}: cannot be made ({error.strerror}); name another folder") from error
    write_new_file(path, to_text(config).encode())
    return out


def _data(config: GenerateConfig, place: Path) -> Data:
    if not (place / MANIFEST).exists():
        with progress(f"simulating {config.system}", "shapes") as update:
            generate(config, place, update, resume=True)
    return load(place)


@dataclass(frozen=True)
class _Network:
    """A network that was trained, and what it estimates on the test part."""

    run: TrainingRun
    result: NetworkResult
    estimator: OnnxEstimator


def _trained(name: str, run: RunConfig, data: Data, split: Split, folder: Path) -> _Network:
    """Train a network in its folder, or go on with it, and estimate the test part."""
    with progress(f"training {name}", "steps") as update:
        history = fit(data, split, run.training, folder, resume=True, progress=update)
    estimator = OnnxEstimator.load(folder / MODEL, threads=2)
    result = _network_result(name, split, data, estimator)
    return _Network(_training_run(name, run, split, history, estimator), result, estimator)


def _training_run(
    name: str, run: RunConfig, split: Split, history: Sequence[EpochRecord], estimator: OnnxEstimator
) -> TrainingRun:
    from exosight.learning.networks import build_network

    schema = estimator.card.schema
    network = build_network(run.training.network, schema, len(auxiliary_units(schema)), 0)
    return TrainingRun(
        name=name,
        parameters=sum(p.numel() for p in network.parameters() if p.requires_grad),
        frames=len(split.train),
        history=history,
        loss="loss [force SD]" if _recipe(run).scales_outputs else "L1 loss [N]",
    )


def _recipe(run: RunConfig) -> Recipe:
    return RECIPES[resolve(run.training, "cpu", "float32").recipe]


def _network_result(name: str, split: Split, data: Data, estimator: OnnxEstimator) -> NetworkResult:
    frames = data.frames
    true, estimated = frames.labels[split.test], estimator.estimate(frames.images[split.test])
    return NetworkResult(name, frames.schema, true.astype(float), estimated.astype(float))


def _robustness(
    config: StudyConfig, estimator: OnnxEstimator, data: Data, test: np.ndarray
) -> RobustnessSummary:
    images = data.frames.images[test]
    cases = evaluate_robustness(
        data.frames.schema, estimator.estimate, images, data.frames.labels[test], config.seed
    )
    few = images[np.linspace(0, len(images) - 1, 4).astype(int)]
    examples = {case: few if case == "clean" else corrupt(few, case, config.seed) for case in cases}
    run = config.runs[0]
    return RobustnessSummary(run.name, cases, examples, _recipe(run).augments)


def _closed_loops(
    config: StudyConfig, first: OnnxEstimator, camera: Camera, folder: Path
) -> list[LoopResult]:
    """The paper's trials with the first network, and with the shipped one where it fits the camera."""
    run = config.runs[0]
    loops = [(run.name, run.folder, first, f"{run.folder}/{MODEL}", folder / "control")]
    shipped = OnnxEstimator.load(DEFAULT_MODEL, threads=2)
    if camera_of(shipped.card) == camera:
        place = folder / "control_shipped"
        loops.append((SHIPPED_NETWORK, "shipped", shipped, DEFAULT_MODEL.name, place))
    results = []
    for name, short, estimator, model, place in loops:
        seen_by = camera_of(estimator.card)
        system = published(_exosuit(config.data), seen_by)
        measure = from_image(estimator, system.schema)
        trials = run_with_progress(system, measure, published_trials())
        _keep_trials(trials, model, seen_by, place)
        results.append(LoopResult(name, short, short == "shipped", trials))
    return results


def _keep_trials(trials: Sequence[Trial], model: str, camera: Camera, place: Path) -> None:
    """The trials in a new folder, unless an earlier run has left it."""
    if not place.exists():
        with new_folder(place) as part:
            write_trials(trials, model, camera, part)


def _surfaces(config: StudyConfig, camera: Camera, folder: Path) -> SurfaceResult | None:
    """The exosuit of the closed loop on `index`: with the study's network, and the shipped one where it fits.

    None if there is neither.
    """
    system = index(_exosuit(config.data), camera)
    sensors: list[tuple[str, str, OnnxEstimator, str]] = []
    own = None
    if config.index is not None:
        data = _data(config.index.data(config.data), folder / "index_data")
        split = make_split(data.frames, config.index.protocol, config.seed)
        name = f"{config.index.name}, {INDEX}"
        own = _trained(name, config.index, data, split, folder / INDEX_NETWORK)
        sensors.append((name, "index", own.estimator, f"{INDEX_NETWORK}/{MODEL}"))
    shipped = OnnxEstimator.load(SHIPPED_MODELS[INDEX], threads=2)
    if camera_of(shipped.card) == camera:
        sensors.append((f"{SHIPPED_NETWORK}, {INDEX}", "index_shipped", shipped, SHIPPED_MODELS[INDEX].name))
    if not sensors:
        return None
    constant = [asked for asked in published_trials() if asked[1][-1] > 0]
    loops = []
    for name, short, estimator, model in sensors:
        trials = run_with_progress(system, from_image(estimator, system.schema), constant)
        _keep_trials(trials, model, camera, folder / f"control_{short}")
        loops.append(LoopResult(name, short, estimator is shipped, trials))
    plant, commands = SimulatedPlant(system), load_path(system.schema, frames=50, seed=0, number=0).commands
    net_force = np.array([plant.apply(row).reading(system.schema.controlled) for row in commands])
    return SurfaceResult(commands[:, 0], net_force, loops, own and own.run, own and own.result)


def _exosuit(config: GenerateConfig) -> Exosuit:
    """The exosuit of the closed loop, of the dataset's material."""
    return Exosuit(
        CONTROL_SHAPE, young=config.young, contact_stiffness=config.contact_stiffness, gap=config.gap
    )


def _command(config: StudyConfig, out: Path) -> str:
    """The command line that makes this study again in an empty place."""
    preset = next((name for name, known in PRESETS.items() if known == config), None)
    source = ["--preset", preset] if preset else ["--config", CONFIG]
    return shlex.join(["exosight", "study", *source, "--out", str(out)])
