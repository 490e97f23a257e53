"""A network with earlier images and commands as inputs: what it finds, what it asks for, its export."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pydantic import ValidationError
from schemas import published_schema

from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.errors import InputError
from exosight.learning import TrainConfig, TrainingData, export_onnx, load_model, train
from exosight.learning.checkpoint import load_checkpoint
from exosight.learning.config import LONGEST_HISTORY
from exosight.learning.model_inputs import ModelInputs, stacked
from exosight.learning.training_data import stacks

HISTORY = 2
TRAINED = np.arange(192)
JUDGED = np.arange(192, 288)


@pytest.fixture(scope="module")
def moving() -> TrainingData:
    """A blob that goes left or right in paths of four frames: C1 is its way, which no single frame tells.

    C2 is where it is, and C3 is u, which no frame tells at all.
    """
    rng = np.random.default_rng(3)
    paths, count = 72, 4
    y, x = np.mgrid[:32, :32] / 32
    way = rng.choice([-1.0, 1.0], paths)
    place = rng.uniform(0.4, 0.6, paths)[:, None] + 0.06 * way[:, None] * (np.arange(count) - 1.5)
    place = place.ravel()[:, None, None]
    images = (255 * np.exp(-((x - place) ** 2 + (y - 0.5) ** 2) / 0.02)).astype(np.uint8)
    forces = np.zeros((len(images), 7), np.float32)
    u = rng.uniform(0, 4, len(images)).astype(np.float32)
    # The first of a path sees itself only: nothing tells its way.
    forces[:, 0] = np.where(np.arange(len(images)) % count == 0, 1.0, 1.0 + np.repeat(way, count))
    forces[:, 1] = place[:, 0, 0]
    forces[:, 2] = u
    places = np.arange(len(images))
    return TrainingData(
        *(published_schema(32, 32), images, forces, TRAINED, JUDGED, {"designs": 3}),
        commands=u[:, None],
        previous=np.where(places % count == 0, places, places - 1),
    )


PLAIN = TrainConfig(epochs=12, batch=16, threads=1, precision="float32")
KNOWING = replace(PLAIN, history=HISTORY, actuation=True)


@pytest.fixture(scope="module")
def knowing(moving: TrainingData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("history") / "run"
    train(KNOWING, moving, folder)
    return folder


def shown(samples: TrainingData, rows: np.ndarray) -> tuple[np.ndarray, ModelInputs]:
    """Images of some frames, and all that may be shown beside them."""
    assert samples.commands is not None
    seen = stacks(samples.previous, HISTORY, len(samples.images))[rows]
    return samples.images[rows], ModelInputs(samples.images[seen[:, 1:]], samples.commands[rows])


@pytest.fixture(scope="module")
def exported(knowing: Path, moving: TrainingData) -> Path:
    images, inputs = shown(moving, JUDGED)
    export_onnx(knowing, knowing / "model.onnx", images, moving.labels[JUDGED], inputs)
    return knowing / "model.onnx"


def error(estimated: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Mean absolute error of C1 to C3, in units of what a constant answer has."""
    usual = np.abs(true - np.median(true, axis=0)).mean(axis=0)[:3]
    return np.abs(estimated - true).mean(axis=0)[:3] / usual


def test_it_tells_what_one_image_cannot(knowing: Path, moving: TrainingData) -> None:
    """Which way it moves, and u: with the history or the u of another frame, it is as wrong as a constant."""
    truth = moving.labels[JUDGED]
    images, inputs = shown(moving, JUDGED)
    assert inputs.history is not None
    assert inputs.commands is not None
    other = np.random.default_rng(0).permutation(len(images))
    model = load_model(knowing)

    def answered(history: np.ndarray, commands: np.ndarray) -> np.ndarray:
        stack = stacked(images, ModelInputs(history, commands))
        with torch.inference_mode():
            return model(torch.from_numpy(stack).float() / 255, torch.from_numpy(commands))[0].numpy()

    assert error(answered(inputs.history, inputs.commands), truth).max() < 0.5
    assert error(answered(inputs.history[other], inputs.commands), truth)[0] > 0.9
    assert error(answered(inputs.history, inputs.commands[other]), truth)[2] > 0.9


def test_export_agrees_with_the_network(exported: Path, knowing: Path) -> None:
    rng = np.random.default_rng(1)
    images = rng.integers(0, 256, (70, 32, 32), np.uint8)
    inputs = ModelInputs(
        rng.integers(0, 256, (70, HISTORY, 32, 32), np.uint8), rng.uniform(0, 4, (70, 1)).astype("f4")
    )
    assert inputs.commands is not None
    estimator = OnnxEstimator.load(exported)
    assert estimator.card.inputs == {"image": [1 + HISTORY, 32, 32], "commands": [1]}
    assert (estimator.card.history, estimator.card.actuation) == (HISTORY, True)
    assert estimator.card.input.startswith(
        "gray image, float32 in 0…1, (batch, 3, height, width), the newest"
    )
    found = estimator.read(images, inputs=inputs)
    with torch.inference_mode():
        stack = torch.from_numpy(stacked(images, inputs)).float() / 255
        forces, _, contact = load_model(knowing)(stack, torch.from_numpy(inputs.commands))
    # Batch normalisation is folded into the convolutions, so float32 rounds elsewhere.
    np.testing.assert_allclose(found.forces, forces.numpy(), atol=1e-5)
    # C1 alone touches in some frames and not in others, so the file has shifted its odds.
    np.testing.assert_allclose(found.contact[:, 1:], contact.numpy()[:, 1:], atol=1e-5)


def test_without_what_it_asks_for_it_says_what_to_give(
    exported: Path, knowing: Path, moving: TrainingData, tmp_path: Path
) -> None:
    estimator = OnnxEstimator.load(exported)
    images, inputs = shown(moving, JUDGED[:4])
    expected = r"expects history uint8 \(4, 2, 32, 32\) and commands \(u \[N\]\) float32 \(4, 1\), got "
    for wrong, got in (
        (ModelInputs(), "no history and no commands;"),
        (replace(inputs, commands=None), r"history uint8 \(4, 2, 32, 32\) and no commands;"),
        (replace(inputs, history=images[:, None]), r"history uint8 \(4, 1, 32, 32\) and commands"),
    ):
        with pytest.raises(InputError, match=expected + got):
            estimator.read(images, inputs=wrong)
    with pytest.raises(InputError, match="commands: expected finite numbers"):
        estimator.read(images, inputs=replace(inputs, commands=np.full((4, 1), np.nan, np.float32)))
    with pytest.raises(InputError, match=r"reads one image alone, .* history 2 and actuation True; give"):
        OnnxEstimator.load(exported, alone=True)
    with pytest.raises(InputError, match=r"got no history and no commands"):
        export_onnx(knowing, tmp_path / "model.onnx", images, moving.labels[JUDGED[:4]])
    assert not (tmp_path / "model.onnx").exists()


def test_a_network_of_one_image_is_shown_nothing_else() -> None:
    """That of the package was made before networks could see more."""
    estimator = OnnxEstimator.load(DEFAULT_MODEL, alone=True)
    assert estimator.card.inputs == {"image": [1, 128, 128]}
    with pytest.raises(
        InputError, match=r"expects no history and no commands, got no history and commands float32 \(1, 1\)"
    ):
        estimator.read(
            np.zeros((1, 128, 128), np.uint8), inputs=ModelInputs(commands=np.zeros((1, 1), np.float32))
        )


@pytest.mark.parametrize(
    ("options", "told"), [({"history": 1}, "previous"), ({"actuation": True}, "commands")]
)
def test_training_needs_what_the_network_is_to_see(
    moving: TrainingData, tmp_path: Path, options: dict, told: str
) -> None:
    with pytest.raises(InputError, match=f"got none; give {told}"):
        train(replace(PLAIN, **options), replace(moving, **{told: None}), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("options", [{"history": 1}, {"actuation": True}])
def test_the_paper_network_sees_one_image(moving: TrainingData, tmp_path: Path, options: dict) -> None:
    with pytest.raises(InputError, match="the paper network has one image as its input and nothing else"):
        train(TrainConfig(network="paper", **options), moving, tmp_path / "run")


def test_there_is_an_end_to_the_past() -> None:
    with pytest.raises(ValidationError):
        TrainConfig(history=LONGEST_HISTORY + 1)


def test_a_stopped_run_goes_on_exactly(moving: TrainingData, tmp_path: Path) -> None:
    class Killed(Exception):
        pass

    def kill(at) -> None:
        if at.step == 8:  # within the first of two epochs of twelve steps
            raise Killed

    config = replace(KNOWING, epochs=2)
    train(config, moving, tmp_path / "whole")
    with pytest.raises(Killed):
        train(config, moving, tmp_path / "stopped", progress=kill)
    train(config, moving, tmp_path / "stopped", resume=True)
    whole, stopped = (load_checkpoint(tmp_path / name).tensors for name in ("whole", "stopped"))
    assert all(torch.equal(tensor, stopped[name]) for name, tensor in whole.items())
    with pytest.raises(InputError, match="its history is 2, asked for is 1"):
        train(replace(config, history=1), moving, tmp_path / "stopped", resume=True)
