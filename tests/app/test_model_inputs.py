"""Networks that see earlier images and are told u, from `exosight train` to the closed loop."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cards import made_up

from exosight.app import pipeline
from exosight.app.data import Data, load
from exosight.app.evaluation import evaluate
from exosight.app.pipeline import Sources, fit
from exosight.app.provenance import identity
from exosight.control import OnnxEstimator
from exosight.control.estimator import Reading
from exosight.dataset import make_split, previous
from exosight.errors import InputError
from exosight.learning import TrainConfig, TrainingData
from exosight.learning.model_file import ModelCard
from exosight.learning.model_inputs import HISTORY_SPACING, ModelInputs
from exosight.vision.corruptions import corrupt

CONFIG = TrainConfig(epochs=1, batch=8, threads=1, history=2, actuation=True)


@pytest.fixture(scope="session")
def paths(data: Path) -> Data:
    """The made-up dataset, each design driven up 0, 0.5, 1 N and down to 0.5 N."""
    made_up = load(data)
    u = np.tile([0, 0.5, 1, 0.5], len(made_up.frames) // 4).astype(np.float32)
    return Data(made_up.manifest, replace(made_up.frames, commands=u[:, None]))


def card(paths: Data) -> ModelCard:
    """Of a network that has learned from that dataset."""
    split = make_split(paths.frames, "design", 0)
    size = paths.manifest.camera
    return made_up(size.height, size.width, data=identity(paths, split), history=2, actuation=True)


class Session:
    """Answers nothing but small forces that differ."""

    def run(self, _: list[str], given: dict[str, np.ndarray]) -> list[np.ndarray]:
        forces = np.tile(given["commands"] / 10 + given["image"].mean((1, 2, 3))[:, None], 7)
        return [forces, np.ones_like(forces), np.ones_like(forces) / 2, np.zeros(len(forces), np.float32)]


def test_evaluation_shows_each_frame_with_its_own_past(paths: Data, monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise belongs to an image: the same one looks the same whether it is new or history."""
    asked: list[tuple[np.ndarray, ModelInputs]] = []
    read = OnnxEstimator.read_levels

    def watched(
        self, images: np.ndarray, levels: Sequence[float], inputs: ModelInputs
    ) -> dict[float, Reading]:
        asked.append((images, inputs))
        return read(self, images, levels, inputs)

    monkeypatch.setattr(OnnxEstimator, "read_levels", watched)
    found = evaluate(OnnxEstimator(Session(), card(paths)), paths, seed=4)
    test = make_split(paths.frames, "design", 0).test
    assert len(found.true) == len(test)
    before = previous(paths.frames)
    clean = paths.frames.images
    noisy = clean.copy()
    noisy[test] = corrupt(clean[test], "noise-high", 4)
    shown = [pair for pair in asked if len(pair[0]) == len(test)]
    for pictures in (clean, noisy):
        (pair, *_) = [pair for pair in shown if np.array_equal(pair[0], pictures[test])]
        assert pair[1].history is not None
        assert np.array_equal(pair[1].history[:, 0], pictures[before[test]])
        assert np.array_equal(pair[1].history[:, 1], pictures[before[before[test]]])
        assert pair[1].commands is not None
        assert np.array_equal(pair[1].commands, paths.frames.commands[test])


def test_training_gets_the_paths_of_all_datasets_and_of_fresh_shapes(
    data: Path, paths: Data, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    given: dict = {}

    @contextmanager
    def stream(*_: object, **__: object) -> Iterator:
        yield iter([paths.frames] * 2)

    def kept(config: TrainConfig, data: TrainingData, *_: object, **__: object) -> SimpleNamespace:
        assert data.online_blocks is not None
        given.update(data=data, block=next(data.online_blocks(0)))
        return SimpleNamespace(history=())

    def exported(*arguments: Any) -> None:
        given["exported"] = arguments

    monkeypatch.setattr(pipeline, "stream", stream)
    monkeypatch.setattr(pipeline, "load", lambda _: paths)
    monkeypatch.setattr("exosight.learning.train", kept)
    monkeypatch.setattr("exosight.learning.export_onnx", exported)
    split = make_split(paths.frames, "design", 0)
    fit(paths, split, CONFIG, tmp_path / "run", sources=Sources([data], 1), resume=False)
    assert given["data"].identity[HISTORY_SPACING] == 0.5
    places = np.arange(len(given["data"].previous))
    assert len(places) > len(paths.frames)
    assert np.array_equal(given["data"].previous, np.where(places % 4 == 0, places, places - 1))
    assert len(given["data"].commands) == len(places)
    assert np.array_equal(given["block"].previous, previous(paths.frames))
    assert np.array_equal(given["block"].commands, paths.frames.commands)
    _, _, images, _, inputs, (learned, beside) = given["exported"]
    own, before = split.validation, previous(paths.frames)
    assert np.array_equal(learned, paths.frames.images[split.train])
    assert np.array_equal(beside.commands, paths.frames.commands[split.train])
    assert np.array_equal(images, paths.frames.images[own])
    assert np.array_equal(inputs.history[:, 1], paths.frames.images[before[before[own]]])
    assert np.array_equal(inputs.commands, paths.frames.commands[own])


def test_commands_that_show_one_image_refuse_it(
    paths: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    monkeypatch.setattr("exosight.control.estimator.open_model", lambda path, threads: (None, card(paths)))
    for words, expected in (
        (("estimate", tmp_path / "image.png"), "alone"),
        (("stress", "--episodes", 1), "with or without commands"),
    ):
        sentence = refused(*words, "--model", tmp_path / "model.onnx")
        assert "expected a network that reads one image" in sentence
        assert f"{expected}, got one that asks for history 2" in sentence


def test_the_paper_network_is_refused(data: Path, tmp_path: Path, refused: Callable[..., str]) -> None:
    options = ("--network", "paper", "--actuation")
    sentence = refused("train", "--data", data, "--out", tmp_path / "run", *options)
    assert sentence.startswith("the paper network has one image as its input and nothing else")


def test_frames_that_follow_no_path_have_no_past(paths: Data, tmp_path: Path) -> None:
    still = replace(paths.frames, commands=np.zeros_like(paths.frames.commands))
    split = make_split(still, "design", 0)
    with pytest.raises(InputError, match="expected frames along load paths, got none after another"):
        fit(Data(paths.manifest, still), split, CONFIG, tmp_path / "run", resume=False)
