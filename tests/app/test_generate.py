"""`exosight generate`: what it prints and writes, and how it goes on."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from exosight.app.main import main
from exosight.dataset import generation, read_frames
from exosight.dataset.config import GenerateConfig
from exosight.dataset.frames import Frames
from exosight.exosuit.scenarios import SampledShape
from exosight.exosuit.shapes import FAMILIES

OPTIONS = ["--per-scenario", "1", "--frames", "2", "--camera.width", "6", "--camera.height", "4"]


def simulated(
    config: GenerateConfig, shapes: list[SampledShape], done: Callable[[int], None]
) -> tuple[Frames, dict[str, int]]:
    """One blank frame of each shape, and one that is left out."""
    done(len(shapes))
    count = len(shapes)
    frames = Frames(
        images=np.zeros((count, config.camera.height, config.camera.width), np.uint8),
        forces=np.zeros((count, 7), np.float32),
        u=np.zeros(count, np.float32),
        pose=np.zeros((count, 25)),
        shape_id=np.array([shape.shape_id for shape in shapes], np.int32),
        family=np.array([list(FAMILIES).index(shape.shape.surface.family) for shape in shapes], np.int8),
        scenario=np.array([shape.scenario for shape in shapes], np.int8),
        loading=np.ones(count, np.int8),
    )
    return frames, {"not_converged": 0, "crosses_itself": count, "tip_below_finger": 0}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generation, "simulate_shapes", simulated)


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What is told of a command that is refused: one sentence."""
    with pytest.raises(SystemExit) as end:
        main(["generate", *words])
    assert end.value.code == 2
    told = capsys.readouterr().err.splitlines()
    return told[-1]


def test_counts_are_told_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    counts = tmp_path / "counts.json"
    main(["generate", "--out", str(tmp_path / "data"), *OPTIONS, "--json", str(counts)])
    told = capsys.readouterr().err
    assert "wrote 11 frames of 11 shapes" in told
    assert "dropped, crosses itself: 11" in told
    assert json.loads(counts.read_text())["dropped"]["crosses_itself"] == 11
    assert len(read_frames(tmp_path / "data")) == 11


def test_a_second_run_needs_resume_and_then_mends(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path / "data"), *OPTIONS]
    main(["generate", *words])
    chunk = tmp_path / "data" / "chunk_0000.h5"
    content = chunk.read_bytes()
    chunk.write_bytes(content[:100])
    assert "exists already; name a new folder, or add --resume" in refused(words, capsys)
    assert chunk.read_bytes() == content[:100]
    main(["generate", *words, "--resume"])
    assert chunk.read_bytes() == content


def test_another_configuration_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--out", str(tmp_path / "data"), *OPTIONS]
    main(["generate", *words])
    assert "(seed 0 there, 5 here)" in refused([*words, "--resume", "--seed", "5"], capsys)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--workers", "0"], "--workers: input should be greater than or equal to 1, got 0"),
        (["--scheduler", "nonsense://x"], "scheduler nonsense://x: cannot be reached"),
    ],
)
def test_wrong_places_to_work_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    pytest.importorskip("distributed")
    assert told in refused(["--out", str(tmp_path / "data"), *OPTIONS, *words], capsys)
