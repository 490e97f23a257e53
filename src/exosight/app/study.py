"""The study: data → networks → judgement → closed loop → report, each stage kept on disk as it is done."""

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from exosight.app.commands.control import name_of, run_trials, summary, time_series
from exosight.app.console import progress, say
from exosight.app.pipeline import MODEL, Data, camera_of, fit, judge, load
from exosight.app.report import write_report, write_tables
from exosight.app.results import Judgement, RobustnessSummary, TrainingRun
from exosight.app.study_report import Results, build_report
from exosight.control import OnnxEstimator, Trial, from_image
from exosight.dataset import Split, make_split
from exosight.dataset.files import write_new_file
from exosight.dataset.generation import GenerateConfig, generate
from exosight.errors import DataError, InputError
from exosight.evaluation import evaluate_robustness
from exosight.learning.config import TrainConfig
from exosight.learning.history import EpochRecord
from exosight.vision.corruptions import corrupt

CONFIG, REPORT = "study.json", "report.html"
SPLIT_WORDS = {"shape": "by shape", "frame": "by frame"}


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class RunConfig:
    """One network to train."""

    protocol: Literal["shape", "frame"]
    """How frames are divided."""
    training: TrainConfig
    """Network and recipe."""

    @property
    def name(self) -> str:
        """Network and split, as the report calls it."""
        return f"{self.training.network} network, {SPLIT_WORDS[self.protocol]}"

    @property
    def folder(self) -> str:
        """Its folder in the study's."""
        return f"{self.training.network}_{self.protocol}"


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class StudyConfig:
    """A whole study; the first run steers the closed loop and is drawn in the figures."""

    data: GenerateConfig
    """What is simulated."""
    runs: Annotated[tuple[RunConfig, ...], Field(min_length=1, max_length=16)]
    """What is trained on it."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the splits and of the noise."""


PRESETS: dict[str, StudyConfig] = {
    "quick": StudyConfig(
        data=GenerateConfig(per_scenario=10),
        runs=(
            RunConfig("shape", TrainConfig(network="light", epochs=40)),
            RunConfig("frame", TrainConfig(network="light", epochs=40)),
        ),
    ),
    "paper": StudyConfig(
        data=GenerateConfig(per_scenario=125),
        runs=tuple(
            RunConfig(protocol, TrainConfig(network=network))
            for network in ("light", "paper")
            for protocol in ("shape", "frame")
        ),
    ),
}
"""quick: 110 shapes, minutes on a laptop; paper: all 1375 shapes and both networks."""

_ADAPTER = TypeAdapter(StudyConfig)


def read_config(path: Path) -> StudyConfig:
    """A configuration that a study saved; DataError if it cannot be used."""
    try:
        return _ADAPTER.validate_json(path.read_bytes())
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); expected a study's {CONFIG}") from error
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(str(part) for part in fault["loc"]) or "file"
        raise DataError(f"{path}: not the configuration of a study ({place}: {fault['msg']})") from error


def run_study(config: StudyConfig, out: Path, command: Sequence[str], *, resume: bool = False) -> Path:
    """Run a study in a new folder and return the path of its report.

    With `resume` the folder may hold the same study, stopped at any point: what is done is not done again.

    command   the words of the command line that the report shows

    Raises DataError or InputError if the folder is in use, or holds another study.
    """
    folder = _open(config, out, resume)
    report = folder / REPORT
    if report.exists():
        return report
    data = _data(config, folder)
    splits = {
        p: make_split(data.frames, p, config.seed) for p in dict.fromkeys(r.protocol for r in config.runs)
    }
    trained, judgements, estimators = [], [], []
    for run in config.runs:
        split, place = splits[run.protocol], folder / run.folder
        with progress(f"training the {run.name}", "steps") as update:
            history = fit(data, split, run.training, place, resume=True, progress=update)
        estimator = OnnxEstimator.load(place / MODEL, threads=2)
        true, estimated = judge(estimator, data, split.test)
        trained.append(_training_run(run, split, history))
        judgements.append(Judgement(run.name, true.astype(float), estimated.astype(float)))
        estimators.append(estimator)
    steering, test = estimators[0], splits[config.runs[0].protocol].test
    say("judging the estimate on degraded images")
    robustness = _robustness(config, steering, data, test)
    trials = run_trials(camera_of(steering.card), from_image(steering))
    _write_trials(trials, folder / "control")
    say("writing the report")
    results = Results(data, splits, trained, judgements, robustness, steering, trials)
    page = build_report(results, shlex.join(command), (folder / CONFIG).read_text(), config.seed)
    write_tables(page, folder / "tables")
    write_report(page, report)
    return report


def _open(config: StudyConfig, out: Path, resume: bool) -> Path:
    """The study's folder, new or resumed."""
    text = json.dumps(_ADAPTER.dump_python(config, mode="json"), indent=1) + "\n"
    path = out / CONFIG
    if out.exists() and not (resume and (path.exists() or not any(out.iterdir()))):
        raise DataError(f"{out}: exists already; name a new folder, or add --resume to go on with its study")
    if path.exists():
        if read_config(path) != config:
            raise InputError(f"{out}: holds a study with another configuration; name a new folder")
        return out
    out.mkdir(parents=True, exist_ok=True)
    write_new_file(path, text.encode())
    return out


def _data(config: StudyConfig, folder: Path) -> Data:
    place = folder / "data"
    if not (place / "manifest.json").exists():
        # What a stopped run left is incomplete, and named so that nobody takes it for a dataset.
        number = 0
        while (partial := folder / f"data_incomplete_{number}").exists():
            number += 1
        with progress("simulating", "shapes") as update:
            generate(config.data, partial, update)
        partial.rename(place)
    return load(place)


def _training_run(run: RunConfig, split: Split, history: Sequence[EpochRecord]) -> TrainingRun:
    from exosight.learning.networks import build_network

    network = build_network(run.training.network, (128, 128), 0)
    modern = run.training.network == "light"
    return TrainingRun(
        name=run.name,
        parameters=sum(p.numel() for p in network.parameters() if p.requires_grad),
        frames=len(split.train),
        history=history,
        loss="L1 loss [force SD]" if modern else "L1 loss [N]",
    )


def _robustness(
    config: StudyConfig, estimator: OnnxEstimator, data: Data, test: np.ndarray
) -> RobustnessSummary:
    images = data.frames.images[test]
    cases = evaluate_robustness(estimator.estimate, images, data.frames.forces[test], config.seed)
    few = images[np.linspace(0, len(images) - 1, 4).astype(int)]
    examples = {case: few if case == "clean" else corrupt(few, case, config.seed) for case in cases}
    return RobustnessSummary(config.runs[0].name, cases, examples)


def _write_trials(trials: Sequence[Trial], folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for trial in trials:
        path = folder / f"{name_of(trial)}.csv"
        if not path.exists():
            write_new_file(path, time_series(trial).encode())
    path = folder / "results.json"
    if not path.exists():
        results = [summary(trial) for trial in trials]
        write_new_file(path, json.dumps(results, indent=1, allow_nan=False).encode())
