"""What a user chooses about a study, and the two presets."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from exosight.dataset.config import GenerateConfig
from exosight.errors import DataError
from exosight.files import read_file
from exosight.learning.config import TrainConfig

CONFIG = "study.json"
"""Name of the configuration in a study's folder."""

SPLIT_WORDS = {"design": "shape", "frame": "frame"}
"""Designs of the published system are shapes of exosuits."""


def _of_one_image(training: TrainConfig) -> TrainConfig:
    if training.history or training.actuation:
        raise ValueError(
            "expected networks with one image as input: a study has neither history nor actuation"
        )
    return training


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class RunConfig:
    """One network to train."""

    protocol: Literal["design", "frame"]
    """How frames are divided."""
    training: Annotated[TrainConfig, AfterValidator(_of_one_image)]
    """Network and recipe."""

    @property
    def name(self) -> str:
        """Network and split, as the report calls it."""
        return f"{self.training.network} network, by {SPLIT_WORDS[self.protocol]}"

    @property
    def folder(self) -> str:
        """Its folder in the study's."""
        return f"{self.training.network}_{SPLIT_WORDS[self.protocol]}"


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class IndexConfig(RunConfig):
    """A network to train on `index`, and how many exosuits it learns from; else as the study's data."""

    per_scenario: Annotated[int, Field(ge=1)] | None = None
    """Exosuits of each scenario; None: as many as of the published system."""
    frames: Annotated[int, Field(ge=2)] | None = None
    """Frames of each; None: as many as of the published system."""

    def data(self, published: GenerateConfig) -> GenerateConfig:
        """What is simulated on `index`, given that of the published system."""
        return replace(
            published,
            system="index",
            per_scenario=self.per_scenario or published.per_scenario,
            frames=self.frames or published.frames,
        )


def _of_the_published_system(data: GenerateConfig) -> GenerateConfig:
    if data.system != GenerateConfig().system:
        raise ValueError("expected the published system: a study reproduces the paper")
    return data


def _all_different(runs: tuple[RunConfig, ...]) -> tuple[RunConfig, ...]:
    if len({run.name for run in runs}) < len(runs):
        raise ValueError("expected another network or another protocol for each run")
    return runs


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class StudyConfig:
    """A whole study; the first run is the sensor of the closed loop and is drawn in the figures."""

    data: Annotated[GenerateConfig, AfterValidator(_of_the_published_system)]
    """What is simulated: the published system."""
    runs: Annotated[tuple[RunConfig, ...], Field(min_length=1), AfterValidator(_all_different)]
    """What is trained on it."""
    index: IndexConfig | None = None
    """A network trained on exosuits with contact of surfaces, the preset `index`; None: none."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the splits and of the noise."""


PresetName = Literal["quick", "paper"]

PRESETS: dict[PresetName, StudyConfig] = {
    "quick": StudyConfig(
        data=GenerateConfig(per_scenario=10),
        runs=(
            RunConfig("design", TrainConfig(network="light", epochs=40)),
            RunConfig("frame", TrainConfig(network="light", epochs=10)),
        ),
        # As many frames of six times the exosuits: in as much training it learns more of exosuits not seen.
        index=IndexConfig("design", TrainConfig(network="light", epochs=40), per_scenario=60, frames=9),
    ),
    "paper": StudyConfig(
        data=GenerateConfig(per_scenario=125),
        runs=tuple(
            RunConfig(protocol, TrainConfig(network=network))
            for network in ("light", "paper")
            for protocol in ("design", "frame")
        ),
        index=IndexConfig("design", TrainConfig(network="light")),
    ),
}
"""quick: 110 shapes, minutes on a laptop; paper: all 1375 shapes and both networks."""

_ADAPTER = TypeAdapter(StudyConfig)
_LARGEST = 2**20  # bytes; it has some thousands


def to_text(config: StudyConfig) -> str:
    """The configuration as the JSON that `read_config` reads."""
    return _ADAPTER.dump_json(config, indent=1).decode() + "\n"


def read_config(path: Path) -> StudyConfig:
    """A configuration that a study saved; DataError if it cannot be used."""
    try:
        return _ADAPTER.validate_json(read_file(path, _LARGEST, f"expected a study's {CONFIG}"))
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(str(part) for part in fault["loc"]) or "file"
        raise DataError(f"{path}: not the configuration of a study ({place}: {fault['msg']})") from error
