"""Two processes that train one network, on CPUs: what they share, what they write, and how they end."""

import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
import torch.distributed as dist
from safetensors.torch import load_file

from exosight.errors import InputError
from exosight.learning import TrainingData, read_history
from exosight.learning.board import BOARD_NAME
from exosight.learning.checkpoint import CHECKPOINT_NAME, Checkpoint, load_checkpoint
from exosight.learning.parallel import join
from exosight.learning.process_group import SINGLE, ProcessGroup

PROGRAM = Path(__file__).with_name("two_processes.py")


class Runs(NamedTuple):
    """What the program did."""

    folder: Path
    codes: dict[tuple[str, int], int]
    """of (run, process)"""

    def sentences(self, name: str) -> list[str]:
        """All that the two processes of a run said."""
        return [line for rank in (0, 1) for line in self.text(name, rank).splitlines()]

    def text(self, name: str, rank: int) -> str:
        return (self.folder / f"{name}.{rank}.txt").read_text()

    def checkpoint(self, name: str) -> Checkpoint:
        return load_checkpoint(self.folder / name)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, blobs: TrainingData) -> Runs:
    if not (hasattr(os, "fork") and dist.is_available() and dist.is_gloo_available()):
        pytest.skip("needs fork, and a PyTorch with gloo")
    try:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
    except OSError as error:
        pytest.skip(f"needs a free port of this machine: {error}")
    folder = tmp_path_factory.mktemp("two_processes")
    np.savez(folder / "samples.npz", **{n: x for n, x in vars(blobs).items() if isinstance(x, np.ndarray)})
    words = [sys.executable, str(PROGRAM), str(folder)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    done = subprocess.run(words, env=env, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    return Runs(folder, {(name, int(rank)): int(code) for name, rank, code in lines})


def test_steps_of_two_processes_are_those_of_one(runs: Runs) -> None:
    """Without batch normalisation and random moves; slices of 7 and 6 images or 6 and 6; fresh frames."""
    assert runs.codes["plain", 0] == runs.codes["plain", 1] == 0, runs.sentences("plain")
    one, two = (load_file(runs.folder / name / CHECKPOINT_NAME) for name in ("plain1", "plain2"))
    assert one.keys() == two.keys()
    for name, tensor in one.items():
        # Single precision, summed in another order; Adam divides by the gradients, which magnifies it.
        assert torch.allclose(tensor, two[name], rtol=1e-4, atol=1e-6), name
    histories = [read_history(runs.folder / name) for name in ("plain1", "plain2")]
    assert [record.step for record in histories[0]] == [5, 10, 15]
    for first, second in zip(*histories, strict=True):
        assert second.curves() == pytest.approx(first.curves(), rel=1e-5)


def test_the_second_process_writes_nothing(runs: Runs) -> None:
    assert list((runs.folder / "plain2_second").rglob("*")) == []


def test_a_run_of_two_processes_leaves_what_one_leaves(runs: Runs) -> None:
    """And nothing of its group: exit code 3 says that."""
    assert [runs.codes["whole", rank] for rank in (0, 1)] == [0, 0]
    assert runs.sentences("whole") == []
    folder = runs.folder / "whole"
    assert {path.name for path in folder.iterdir()} == {CHECKPOINT_NAME, "history.csv", BOARD_NAME}
    assert len(list((folder / BOARD_NAME).iterdir())) == 1
    assert len(read_history(folder)) == 3


def test_a_killed_run_of_two_processes_resumes_exactly(runs: Runs) -> None:
    """With batch normalisation and random moves; the process that writes is killed in the second epoch."""
    assert [runs.codes["killed", rank] for rank in (0, 1)] == [-9, 2]
    assert len(runs.sentences("killed")) == 1
    assert "another process of this run ended before its time" in runs.text("killed", 1)
    assert [runs.codes["resumed", rank] for rank in (0, 1)] == [0, 0]
    whole, resumed = runs.checkpoint("whole"), runs.checkpoint("killed")
    assert replace(whole.position, seconds=0.0) == replace(resumed.position, seconds=0.0)
    curves = [[record.curves() for record in run.history] for run in (whole, resumed)]
    assert curves[0] == curves[1]
    for name, tensor in whole.tensors.items():
        assert torch.equal(tensor, resumed.tensors[name]), name


def test_a_process_that_fails_ends_both_with_its_sentence(runs: Runs) -> None:
    assert [runs.codes["failed", rank] for rank in (0, 1)] == [2, 2]
    assert runs.sentences("failed") == ["the sixth step is one too many"]
    assert runs.checkpoint("failed").position.epoch == 1


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("at_odds", "the processes of this run differ in settings, data or checkpoint"),
        ("too_small", "expected at least two images for each of 2 processes, got steps of 3"),
    ],
)
def test_what_both_refuse_is_said_once_and_nothing_is_written(runs: Runs, name: str, sentence: str) -> None:
    assert [runs.codes[name, rank] for rank in (0, 1)] == [2, 2]
    (said,) = runs.sentences(name)
    assert sentence in said
    assert not (runs.folder / name).exists()


def test_slices_are_the_whole_batch_in_order_and_nearly_equal() -> None:
    batch = np.arange(14) * 3
    parts = [ProcessGroup(rank, 4).part(batch) for rank in range(4)]
    assert [len(part) for part in parts] == [4, 4, 3, 3]
    assert (np.concatenate(parts) == batch).all()
    assert (SINGLE.part(batch) == batch).all()


def test_without_torchrun_a_process_is_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    with join("cpu") as group:
        assert group == SINGLE
    assert group.first
    assert not dist.is_initialized()


def test_a_world_that_cannot_be_met_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    for name in ("RANK", "MASTER_ADDR", "MASTER_PORT"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match=r"cannot meet .*RANK.*start them with torchrun"), join("cpu"):
        pass
