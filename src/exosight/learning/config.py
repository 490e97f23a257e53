"""What a user chooses about a training run; usable without PyTorch."""

import dataclasses
from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from exosight.cpu import cores
from exosight.errors import InputError
from exosight.learning.recipes import RECIPES

NetworkName = Literal["light", "paper"]
RecipeName = Literal["modern", "clean", "paper"]
Precision = Literal["float32", "bfloat16"]

LONGEST_HISTORY = 8
"""Earlier images that a network may see at most."""

LARGE = 256**2
"""Pixels of an image from which on a step has fewer of them by default."""

PRETRAINED_SHARE = 1 / 3
"""Share of the recipe's learning rate for a network that does not start from random weights: what is known is
lost again at a high rate (docs/log.md)."""

Epochs = Annotated[int, Field(ge=1, le=100_000)]
LearningRate = Annotated[float, Field(gt=0, le=1)]
Batch = Annotated[int, Field(ge=4, le=65_536)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
History = Annotated[int, Field(ge=0, le=LONGEST_HISTORY)]
Threads = Annotated[int, Field(ge=1, le=1024)]

_RECIPE_OF_NETWORK: dict[NetworkName, RecipeName] = {"light": "modern", "paper": "paper"}


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class TrainConfig:
    """One training run: the network brings its recipe, the recipe its epochs and learning rate."""

    network: NetworkName = "light"
    """light: 39 M multiply-adds an image, made for a CPU; paper: the published network, 78,847 parameters"""
    recipe: RecipeName | None = None
    """modern: one-cycle AdamW, rare contacts more often, images moved, faded, noisy; clean: as they are;
    paper: Adam until a plateau, on images as they are; default: modern for light, paper for paper"""
    epochs: Epochs | None = None
    """passes over the training part; default: the recipe's (paper: at most, it stops when it stalls)"""
    learning_rate: LearningRate | None = None
    """largest learning rate; default: the recipe's, a third of it with --pretrained"""
    batch: Batch | None = None
    """images a step; default: the recipe's, fewer of more than 256×256 pixels"""
    seed: Seed = 0
    """decides the first weights and the order of the images"""
    history: History = 0
    """earlier images of the same system that are inputs of the light network beside the one it reads"""
    actuation: bool = False
    """whether the commands of all channels are an input of the light network as well"""
    threads: Threads | None = None
    """CPU threads; default: one a core. Another count rounds differently in the last digit"""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """where to train; auto: the GPU where there is one"""
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """of the convolutions' arithmetic; auto: bfloat16 where the processor has it and the recipe allows"""


@dataclasses.dataclass(frozen=True)
class Settings:
    """A `TrainConfig` with every default spelled out, as a checkpoint keeps it."""

    pretrained: str
    """SHA-256 of the network that it started from; empty where the first weights were random. It comes first
    as it decides defaults of others, so that it is what is named where two runs differ."""
    network: NetworkName
    recipe: RecipeName
    epochs: Epochs
    learning_rate: LearningRate
    batch: Batch
    seed: Seed
    threads: Threads
    device: Literal["cpu", "cuda"]
    precision: Precision
    history: History
    actuation: bool


def resolve(
    config: TrainConfig,
    device: Literal["cpu", "cuda"],
    precision: Precision,
    local_size: int = 1,
    pretrained: str = "",
    pixels: int = 0,
) -> Settings:
    """Spell out the defaults.

    device, precision   what `auto` means on this machine, as PyTorch reports
    local_size          processes that share the cores of this machine, itself included
    pretrained          SHA-256 of the network to start from, if there is one
    pixels              of an image: of large ones a step has fewer by default

    Raises InputError if the paper's network is to have more inputs than the image.
    """
    if config.network == "paper" and (config.history or config.actuation):
        raise InputError(
            "the paper network has one image as its input and nothing else, got "
            f"history {config.history} and actuation {config.actuation}; use the light one"
        )
    recipe = config.recipe or _RECIPE_OF_NETWORK[config.network]
    share = PRETRAINED_SHARE if pretrained else 1
    return Settings(
        network=config.network,
        recipe=recipe,
        epochs=config.epochs or RECIPES[recipe].epochs,
        learning_rate=config.learning_rate or share * RECIPES[recipe].learning_rate,
        batch=config.batch or _batch(RECIPES[recipe].batch, pixels),
        seed=config.seed,
        threads=config.threads or max(1, cores() // local_size),
        device=device,
        precision=RECIPES[recipe].precision or precision if config.precision == "auto" else config.precision,
        history=config.history,
        actuation=config.actuation,
        pretrained=pretrained,
    )


def _batch(images: int, pixels: int) -> int:
    """The recipe's, or as many as take the memory of that number at 256×256 pixels: with 128, about 2 GiB."""
    return min(images, max(4, images * LARGE // max(pixels, 1)))
