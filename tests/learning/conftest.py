"""Small synthetic frames: one bright blob, whose place and size set the seven "forces"."""

from pathlib import Path

import numpy as np
import pytest
from schemas import published_schema

from exosight.learning import TrainConfig, TrainingData, train

IDENTITY: dict[str, str | int | float] = {"camera": "512 px/m", "shapes": 3, "young": 300e3}


@pytest.fixture(scope="session")
def blobs() -> TrainingData:
    """80 frames of 40×40, the smallest that training moves; forces follow from the picture alone, C6 is 0."""
    generator = np.random.default_rng(7)
    y, x = np.mgrid[:40, :40] / 40
    images = np.zeros((80, 40, 40), np.uint8)
    forces = np.zeros((80, 7), np.float32)
    for image, force in zip(images, forces, strict=True):
        a, b = generator.uniform(0.2, 0.8, 2)
        size = generator.uniform(0.3, 1.0)
        image[:] = 255 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / (0.02 * size))
        force[:] = [a, b, size, 0.2 * a * b, max(0.0, a - 0.5), 0.0, 2.0 * size]
    return TrainingData(
        *(published_schema(40, 40), images, forces, np.arange(64), np.arange(64, 80), IDENTITY),
        auxiliary=forces[:, :2].copy(),
        auxiliary_units=("N", "N"),
    )


@pytest.fixture(scope="session")
def small() -> TrainConfig:
    """A run of 6 epochs of 4 steps."""
    return TrainConfig(epochs=6, batch=16, threads=1, seed=5, precision="float32")


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory, blobs: TrainingData, small: TrainConfig) -> Path:
    """The folder of that run, never stopped."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    train(small, blobs, folder)
    return folder


@pytest.fixture
def identity() -> dict[str, str | int | float]:
    return dict(IDENTITY)
