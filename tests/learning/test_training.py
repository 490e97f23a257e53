import errno
import os
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from schemas import published_schema
from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]

from exosight.errors import DataError, InputError
from exosight.learning import (
    EpochRecord,
    TrainConfig,
    TrainingData,
    TrainResult,
    load_model,
    read_history,
    train,
    training,
)
from exosight.learning.board import BOARD_NAME
from exosight.learning.checkpoint import CHECKPOINT_NAME, Checkpoint, load_checkpoint
from exosight.learning.training import Progress

Identity = dict[str, str | int | float]


class Killed(Exception):
    """Stands for a kill: nothing in the package knows this exception."""


def kill_after(step: int) -> Callable[[Progress], None]:
    def check(progress: Progress) -> None:
        if progress.step == step:
            raise Killed

    return check


def run(config: TrainConfig, data: TrainingData, folder: Path, identity: Identity, **options) -> TrainResult:
    return train(config, replace(data, identity=identity), folder, **options)


def without_seconds(history: tuple[EpochRecord, ...]) -> list[EpochRecord]:
    return [replace(record, seconds=0.0) for record in history]


def assert_same_to_the_last_bit(first: Checkpoint, second: Checkpoint) -> None:
    assert first.run == second.run
    assert replace(first.position, seconds=0.0) == replace(second.position, seconds=0.0)
    assert without_seconds(first.history) == without_seconds(second.history)
    assert first.tensors.keys() == second.tensors.keys()
    for name, tensor in first.tensors.items():
        assert torch.equal(tensor, second.tensors[name]), name


def test_light_network_learns_64_images_by_heart(tmp_path: Path, blobs: TrainingData, identity: Identity):
    run(TrainConfig(epochs=120, batch=16, threads=1, seed=1), blobs, tmp_path / "run", identity)
    with torch.inference_mode():
        forces = load_model(tmp_path / "run")(torch.from_numpy(blobs.images[:64, None]) / 255)[0].numpy()
    error = np.abs(forces - blobs.labels[:64]).mean(axis=0)
    # 480 steps with moves, noise and fading reach about 10 % of the spread; the median alone about 80 %.
    varying = [0, 1, 2, 3, 4, 6]
    assert (error[varying] < 0.25 * blobs.labels[:64, varying].std(axis=0)).all()
    assert error[5] < 1e-3
    # Both curves are of the forces alone: the further answers' share falls below zero as they are learned.
    last = read_history(tmp_path / "run")[-1]
    assert last.validation_loss is not None
    assert 0 < last.train_loss < 0.3 * read_history(tmp_path / "run")[0].train_loss


@pytest.mark.parametrize("step", [1, 12, 13, 15])
def test_a_killed_run_resumes_exactly(
    tmp_path: Path, trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity, step: int
):
    """Killed in the first epoch, just before the third one's checkpoint, just after it, and in the fourth."""
    with pytest.raises(Killed):
        run(small, blobs, tmp_path / "run", identity, progress=kill_after(step))
    run(small, blobs, tmp_path / "run", identity, resume=True)
    assert_same_to_the_last_bit(load_checkpoint(tmp_path / "run"), load_checkpoint(trained))
    assert without_seconds(read_history(tmp_path / "run")) == without_seconds(read_history(trained))


@pytest.mark.parametrize("step", [14, 16])
def test_a_run_killed_within_a_long_epoch_loses_nothing_that_was_saved(
    tmp_path: Path,
    trained: Path,
    blobs: TrainingData,
    small: TrainConfig,
    identity: Identity,
    step: int,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    with pytest.raises(Killed):
        run(small, blobs, tmp_path / "run", identity, progress=kill_after(step))
    assert load_checkpoint(tmp_path / "run").position.step == step
    run(small, blobs, tmp_path / "run", identity, resume=True)
    assert_same_to_the_last_bit(load_checkpoint(tmp_path / "run"), load_checkpoint(trained))


def test_resuming_a_completed_run_changes_nothing(
    trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    before = (trained / CHECKPOINT_NAME).read_bytes()
    result = run(small, blobs, trained, identity, resume=True)
    assert (trained / CHECKPOINT_NAME).read_bytes() == before
    assert result.history == read_history(trained)
    assert result.best.validation_loss == min(record.validation_loss or 9.0 for record in result.history)


def test_resume_starts_a_run_where_there_is_none(
    tmp_path: Path, trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    run(small, blobs, tmp_path / "new" / "run", identity, resume=True)
    assert_same_to_the_last_bit(load_checkpoint(tmp_path / "new" / "run"), load_checkpoint(trained))


def test_another_seed_is_another_run(
    tmp_path: Path, trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    run(replace(small, seed=6), blobs, tmp_path / "run", identity)
    assert without_seconds(read_history(tmp_path / "run")) != without_seconds(read_history(trained))


def test_global_state_of_pytorch_is_left_alone(
    tmp_path: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    random, threads = torch.get_rng_state(), torch.get_num_threads()
    run(replace(small, epochs=1, threads=threads + 1), blobs, tmp_path / "run", identity)
    assert torch.equal(torch.get_rng_state(), random)
    assert torch.get_num_threads() == threads


def test_history_counts_epochs_steps_and_rates(trained: Path):
    history = read_history(trained)
    assert [record.epoch for record in history] == [1, 2, 3, 4, 5, 6]
    assert [record.step for record in history] == [4, 8, 12, 16, 20, 24]
    assert history[-1].learning_rate == pytest.approx(3e-3 / 25e4)
    assert all(record.validation_l1 is not None and record.validation_l1 > 0 for record in history)
    assert sorted(record.seconds for record in history) == [record.seconds for record in history]


def test_validation_losses_are_those_of_the_kept_network(trained: Path, blobs: TrainingData):
    checkpoint = load_checkpoint(trained)
    best = checkpoint.history[checkpoint.position.best_epoch - 1]
    with torch.inference_mode():
        forces = load_model(trained)(torch.from_numpy(blobs.images[64:, None]) / 255)[0].numpy()
    error = np.abs(forces - blobs.labels[64:])
    # Single precision, summed in another order.
    assert best.validation_l1 == pytest.approx(error.mean(), rel=1e-5)
    scaled = error / checkpoint.run.output_scale
    huber = np.where(scaled < 1, scaled**2 / 2, scaled - 0.5)
    assert best.validation_loss == pytest.approx(huber.mean(), rel=1e-5)


def test_paper_recipe_validates_every_fifth_epoch_and_stops_when_stalled(
    tmp_path: Path, blobs: TrainingData, identity: Identity, monkeypatch: pytest.MonkeyPatch
):
    scripted = iter([1.0, 0.8, 0.9, 0.8, 0.85, 0.9, 0.8, 0.1])
    monkeypatch.setattr(training, "_validate", lambda *_: (next(scripted), 0.5))
    config = TrainConfig(network="light", recipe="paper", threads=1, batch=64)
    result = run(config, blobs, tmp_path / "run", identity)
    validated = [record.epoch for record in result.history if record.validation_loss is not None]
    assert validated == [5, 10, 15, 20, 25, 30, 35]
    assert len(result.history) == 35
    assert result.best.epoch == 10
    rates = {record.epoch: record.learning_rate for record in result.history}
    assert [rates[epoch] for epoch in (1, 20, 21, 30, 31)] == pytest.approx([2e-4, 2e-4, 2e-5, 2e-5, 2e-6])
    assert load_checkpoint(tmp_path / "run").run.output_scale == (1.0,) * 7


def test_paper_network_trains(tmp_path: Path, identity: Identity):
    images = np.zeros((4, 128, 128), np.uint8)
    images[:, :, :64] = np.arange(4)[:, None, None] * 80
    schema = published_schema()
    samples = TrainingData(schema, images, np.ones((4, 7), np.float32), np.arange(3), np.arange(3, 4), {})
    result = run(TrainConfig(network="paper", epochs=2, threads=1), samples, tmp_path / "run", identity)
    assert result.best.epoch == 2
    assert result.history[0].validation_loss is None


def test_a_folder_that_holds_a_run_is_refused(
    trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    before = (trained / CHECKPOINT_NAME).read_bytes()
    with pytest.raises(InputError, match="already holds a training run"):
        run(small, blobs, trained, identity)
    assert (trained / CHECKPOINT_NAME).read_bytes() == before


def test_a_history_without_its_checkpoint_is_not_overwritten(
    tmp_path: Path, trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    (tmp_path / "history.csv").write_bytes((trained / "history.csv").read_bytes())
    with pytest.raises(InputError, match="without its checkpoint"):
        run(small, blobs, tmp_path, identity, resume=True)


def test_other_files_in_the_folder_are_left_alone(
    tmp_path: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    (tmp_path / "config.json").write_text("mine")
    run(replace(small, epochs=1), blobs, tmp_path, identity)
    assert (tmp_path / "config.json").read_text() == "mine"
    made = {"history.csv", CHECKPOINT_NAME, BOARD_NAME}
    assert {path.name for path in tmp_path.iterdir()} == {"config.json", *made}


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"learning_rate": 1e-3}, "its learning_rate is 0.003, asked for is 0.001"),
        ({"epochs": 7}, "its epochs is 6, asked for is 7"),
        ({"recipe": "paper"}, "its recipe is modern"),
        ({"seed": 4}, "its seed is 5"),
    ],
)
def test_resuming_another_configuration_is_refused(
    trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity, other: dict, message: str
):
    with pytest.raises(InputError, match=message):
        run(replace(small, **other), blobs, trained, identity, resume=True)


def test_resuming_with_other_data_is_refused(
    trained: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    with pytest.raises(InputError, match=r"its young is 300000\.0, asked for is 200000\.0"):
        run(small, blobs, trained, identity | {"young": 200e3}, resume=True)
    with pytest.raises(InputError, match="its note is none"):
        run(small, blobs, trained, identity | {"note": "more"}, resume=True)
    limited = replace(blobs.schema.sensors[1], name="C1_tip")
    other = replace(blobs.schema, sensors=(blobs.schema.sensors[0], limited, *blobs.schema.sensors[2:8]))
    with pytest.raises(
        InputError, match=r"of another system: expected the sensors C0, C1, .*, got C0, C1_tip"
    ):
        run(small, replace(blobs, schema=other), trained, identity, resume=True)
    images = blobs.images.copy()
    images[0, 0, 0] ^= 1
    with pytest.raises(InputError, match="frames or their split are others"):
        run(small, replace(blobs, images=images), trained, identity, resume=True)


def test_refused_frames_leave_no_folder(
    tmp_path: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    labels = blobs.labels.copy()
    labels[2, 2] = np.nan
    with pytest.raises(
        InputError, match="finite numbers, and forces of at least 0, got nan for C3 in frame 2"
    ):
        run(small, replace(blobs, labels=labels), tmp_path / "run", identity)
    with pytest.raises(InputError, match="share 1 frames"):
        run(small, replace(blobs, validation_index=np.array([0])), tmp_path / "run", identity)
    with pytest.raises(InputError, match="128×128"):
        run(replace(small, network="paper"), blobs, tmp_path / "run", identity)
    with pytest.raises(InputError, match="data_identity"):
        run(small, blobs, tmp_path / "run", {"young": float("nan")})
    assert not (tmp_path / "run").exists()


def test_a_loss_that_is_not_finite_ends_the_run_and_keeps_its_checkpoint(
    tmp_path: Path,
    blobs: TrainingData,
    small: TrainConfig,
    identity: Identity,
    monkeypatch: pytest.MonkeyPatch,
):
    losses = iter([(1.0, 1.0)] * 6)
    monkeypatch.setattr(training, "_step", lambda *_: next(losses, (float("nan"), 1.0)))
    with pytest.raises(InputError, match=r"loss is nan in epoch 2: training has diverged.*below 0\.003"):
        run(small, blobs, tmp_path / "run", identity)
    assert load_checkpoint(tmp_path / "run").position.epoch == 1


def test_progress_is_told_after_every_step(
    tmp_path: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
):
    told: list[Progress] = []
    run(replace(small, epochs=2), blobs, tmp_path / "run", identity, progress=told.append)
    assert [p.epoch for p in told] == [1, 1, 1, 1, 2, 2, 2, 2]
    assert [p.step for p in told] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert {(p.epochs, p.steps) for p in told} == {(2, 8)}
    assert told[3].latest is None
    assert told[4].latest == read_history(tmp_path / "run")[0]


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without a GPU")
def test_a_missing_gpu_is_said(tmp_path: Path, blobs: TrainingData, small: TrainConfig, identity: Identity):
    with pytest.raises(InputError, match="no GPU"):
        run(replace(small, device="cuda"), blobs, tmp_path / "run", identity)


def test_tensorboard_reads_the_curves_of_a_run_that_was_stopped(
    tmp_path: Path, blobs: TrainingData, small: TrainConfig, identity: Identity
) -> None:
    """Once each, in the format of its event files: length, checksum, record, checksum."""
    with pytest.raises(Killed):
        run(small, blobs, tmp_path / "run", identity, progress=kill_after(15))
    result = run(small, blobs, tmp_path / "run", identity, resume=True)
    found = {}
    for path in sorted((tmp_path / "run" / BOARD_NAME).glob("events.*")):
        content, at = path.read_bytes(), 0
        while at < len(content):
            (length,) = struct.unpack_from("<Q", content, at)
            event = Event.FromString(content[at + 12 : at + 12 + length])
            for value in event.summary.value:
                assert (value.tag, event.step) not in found
                found[value.tag, event.step] = value.simple_value
            at += 12 + length + 4
    expected = {(name, r.step): value for r in result.history for name, value in r.curves().items()}
    assert found == pytest.approx(expected, rel=1e-6)  # stored in single precision


# tensorboardX leaves the file open that it cannot flush.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_full_disk_ends_a_run_where_it_writes_its_curves(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    blobs: TrainingData,
    small: TrainConfig,
    identity: Identity,
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("tensorboardX.record_writer.RecordWriter.flush", full)
        with pytest.raises(DataError, match=r"tensorboard: cannot be written \(No space left.*make room"):
            run(small, blobs, tmp_path / "run", identity)
    whole = run(small, blobs, tmp_path / "whole", identity)
    result = run(small, blobs, tmp_path / "run", identity, resume=True)
    assert [r.train_loss for r in result.history] == [r.train_loss for r in whole.history]
