"""Recordings: what is written is read and replays to the same numbers, killed or on a full disk too."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from recorded_run import MODEL, SHAPE, read, run

from exosight.control import (
    Adaptive,
    AdaptiveConfig,
    AuthorityConfig,
    ControllerConfig,
    GuardConfig,
    Guarded,
    Measurement,
    OnnxEstimator,
    Scheduled,
    State,
)
from exosight.control.estimator import DEFAULT_MODEL
from exosight.control.realtime import Step
from exosight.control.recording import STATES, Recorder, checksum, read_recording
from exosight.control.replay import replay
from exosight.errors import DataError, InputError
from exosight.vision.ood_images import draw_ood_images


def test_what_is_recorded_is_read(tmp_path: Path, straight_config: ControllerConfig) -> None:
    steps = run(tmp_path / "run.h5", straight_config)
    told = read_recording(tmp_path / "run.h5")
    assert len(told) == len(steps) == 47
    np.testing.assert_array_equal(told.command, [step.command for step in steps])
    np.testing.assert_array_equal(
        told.age[told.has_frame],
        [step.measurement.age for step in steps if step.measurement.image is not None],
    )
    np.testing.assert_array_equal(told.seconds, [step.seconds for step in steps])
    assert [STATES[i] for i in told.state] == [step.state for step in steps]
    assert [cause.decode() for cause in told.cause] == [step.cause for step in steps]
    assert np.flatnonzero(~told.has_frame).tolist() == [11, 12, 13]
    assert np.flatnonzero(~told.has_estimate).tolist() == [7, 11, 12, 13]
    assert np.isnan(told.true[11]).all()
    np.testing.assert_array_equal(told.true[20], np.full(7, 0.01 * 20))
    for i, image in enumerate(told.images()):
        if i not in (11, 12, 13):
            np.testing.assert_array_equal(image, steps[i].measurement.image)
    assert told.guard.uncertain_width == 0.5
    assert told.model == checksum(MODEL)
    np.testing.assert_array_equal(told.controller.unloading.outputs, straight_config.unloading.outputs)


def test_it_replays_to_the_same_numbers(tmp_path: Path, straight_config: ControllerConfig) -> None:
    run(tmp_path / "run.h5", straight_config)
    told = read_recording(tmp_path / "run.h5")
    assert {STATES[i] for i in told.state} >= {State.NORMAL, State.HOLD}  # the guard had something to do
    again = replay(told, read)
    np.testing.assert_array_equal(again.estimated, told.estimated)
    np.testing.assert_array_equal(again.command, told.command)
    np.testing.assert_array_equal(again.state, told.state)


def test_the_adaptive_controller_replays_with_its_settings(
    tmp_path: Path, straight_config: ControllerConfig
) -> None:
    asked = AdaptiveConfig(AuthorityConfig(slow_seconds=0.15, hold_seconds=0.25))  # frames 11 to 13 are lost
    run(tmp_path / "run.h5", straight_config, guarded=Adaptive(straight_config, asked))
    told = read_recording(tmp_path / "run.h5")
    assert told.adaptive == asked
    assert {STATES[i] for i in told.state} >= {State.NORMAL, State.SLOW, State.HOLD}
    again = replay(told, read)
    np.testing.assert_array_equal(again.command, told.command)
    np.testing.assert_array_equal(again.state, told.state)


def test_missed_periods_are_recorded_and_replayed(tmp_path: Path, straight_config: ControllerConfig) -> None:
    """Frames 0.2 s old that show the command held over three missed periods: good ones, if these count."""
    guarded = Guarded(Scheduled(straight_config))
    recorder = Recorder(tmp_path / "run.h5", SHAPE, guarded, Path(__file__))
    u = 0.0
    for i in range(6):
        image = np.zeros(SHAPE, np.uint8)
        image[0, i] = 180
        reading = read(image[None])
        measurement = Measurement(image, reading, 0.2, np.array([u]))
        u = guarded.step(0.3, measurement, missed=3)
        step = Step(0.4 * i, 0.3, measurement, None, u, guarded.state, "", np.zeros(4), 0.0, None, 3)
        recorder.append(step)
    recorder.close()
    told = read_recording(tmp_path / "run.h5")
    assert told.missed.tolist() == [3] * 6
    assert guarded.state is State.NORMAL
    again = replay(told, read)
    np.testing.assert_array_equal(again.command, told.command)
    np.testing.assert_array_equal(again.state, told.state)


def test_another_network_replays_to_other_numbers(tmp_path: Path, straight_config: ControllerConfig) -> None:
    run(tmp_path / "run.h5", straight_config)
    told = read_recording(tmp_path / "run.h5")
    again = replay(told, lambda images: read(np.minimum(images, 200) // 2))
    assert np.abs(again.command - told.command).max() > 0.1


def test_the_shipped_network_replays_to_the_same_numbers(
    tmp_path: Path, straight_config: ControllerConfig
) -> None:
    network, guarded = OnnxEstimator.load(DEFAULT_MODEL), Guarded(Scheduled(straight_config))
    pictures = draw_ood_images("text", 6, 0)
    recorder = Recorder(tmp_path / "run.h5", pictures.shape[1:], guarded, DEFAULT_MODEL)
    for number, image in enumerate(pictures):
        measurement = Measurement(image, network.read(image[None]), 0.01)
        u = guarded.step(0.2, measurement)
        recorder.append(Step(number / 10, 0.2, measurement, None, u, guarded.state, "", np.zeros(4), 0.0))
    recorder.close()
    told = read_recording(tmp_path / "run.h5")
    again = replay(told, network.read)
    np.testing.assert_array_equal(again.estimated, told.estimated)
    np.testing.assert_array_equal(again.state, told.state)


def test_a_file_is_not_overwritten(tmp_path: Path, straight_config: ControllerConfig) -> None:
    (tmp_path / "run.h5").write_text("precious")
    with pytest.raises(DataError, match="exists already"):
        Recorder(tmp_path / "run.h5", SHAPE, Guarded(Scheduled(straight_config)), Path(__file__))
    assert (tmp_path / "run.h5").read_text() == "precious"
    with pytest.raises(DataError, match="cannot be written"):
        Recorder(tmp_path / "no" / "run.h5", SHAPE, Guarded(Scheduled(straight_config)), Path(__file__))


def test_a_killed_process_leaves_its_whole_seconds(tmp_path: Path, straight_config: ControllerConfig) -> None:
    steps = run(tmp_path / "whole.h5", straight_config)
    guarded = Guarded(Scheduled(straight_config), GuardConfig(uncertain_width=0.5))
    recorder = Recorder(tmp_path / "run.h5", SHAPE, guarded, Path(__file__))
    for step in steps:
        recorder.append(step)
    shutil.copy(tmp_path / "run.h5", tmp_path / "killed.h5")  # what a kill would leave, the file being open
    recorder.close()
    told = read_recording(tmp_path / "killed.h5")
    assert len(told) == 40
    np.testing.assert_array_equal(told.command, [step.command for step in steps[:40]])


CHILD = """
import os, resource, signal, sys, time
from pathlib import Path
import numpy as np
from toy import controller
from exosight.control import Guarded, Scheduled, Measurement, State
from exosight.control.realtime import Step
from exosight.control.recording import Recorder, read_recording
from exosight.errors import DataError

path = Path(sys.argv[1])

def record(told, side=128):
    recorder = Recorder(path, (side, side), Guarded(Scheduled(controller())), Path(sys.argv[2]))
    rng = np.random.default_rng(0)
    try:
        for i in range(20000):
            measurement = Measurement(rng.integers(1, 256, (side, side), dtype=np.uint8))
            recorder.append(Step(i / 10, 0.2, measurement, None, 0.0, State.NORMAL, "", np.zeros(4), 0.0))
            if i % 10 == 9:
                told(i + 1)
    finally:
        recorder.close()

def is_whole(steps):
    found = read_recording(path)
    assert len(found) >= steps, (len(found), steps)
    assert np.array_equal(found.time, np.arange(len(found)) / 10)
    assert all(image.any() for image in found.images())
"""

FULL_DISK = """
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for most in (100_000, 300_000, 2_000_000):
    flushed = [0]
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    try:
        record(flushed.append)
    except DataError as error:
        print(error)
    if path.exists():
        is_whole(flushed[-1])
        path.unlink()
    assert not list(path.parent.iterdir())
print("rows", flushed[-1])
"""

KILLED = """
for pause in np.random.default_rng(1).uniform(0.05, 0.2, 40):
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        record(lambda steps: os.write(write, steps.to_bytes(4)), side=1)
    os.close(write)
    flushed = os.read(read, 4)  # until then the file has no name
    time.sleep(pause)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while more := os.read(read, 4):
        flushed = more
    is_whole(int.from_bytes(flushed))
    path.unlink()
"""


def child(program: str, tmp_path: Path) -> str:
    """What a program prints that records in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD + program, str(tmp_path / "run.h5"), __file__],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},  # `toy` lies beside the tests
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_full_disk_is_told_of_once_and_keeps_what_was_written(tmp_path: Path) -> None:
    """A limit on the size of files stands in for the disk: at the start, in the first second, and later."""
    *told, rows = child(FULL_DISK, tmp_path).splitlines()
    assert len(told) == 3
    assert all("run.h5: cannot be written (File too large)" in line for line in told)
    assert ["it keeps the steps before" in line for line in told] == [False, False, True]
    assert int(rows.removeprefix("rows ")) > 50


def test_a_kill_in_the_middle_of_writing_keeps_every_flushed_second(tmp_path: Path) -> None:
    child(KILLED, tmp_path)


@pytest.mark.parametrize("keep", [0, 100, 3000])
def test_a_damaged_file_is_refused(tmp_path: Path, straight_config: ControllerConfig, keep: int) -> None:
    run(tmp_path / "run.h5", straight_config)
    (tmp_path / "cut.h5").write_bytes((tmp_path / "run.h5").read_bytes()[:keep])
    with pytest.raises(DataError, match="damaged"):
        read_recording(tmp_path / "cut.h5")


def test_another_file_is_refused(tmp_path: Path, straight_config: ControllerConfig) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["time"] = [0.0]
    with pytest.raises(DataError, match="not a recording"):
        read_recording(tmp_path / "other.h5")
    with pytest.raises(DataError, match="no such file"):
        read_recording(tmp_path / "missing.h5")


@pytest.mark.parametrize("name", ["command", "images", "controller/output_limits"])
def test_a_file_that_lacks_something_is_refused(
    tmp_path: Path, straight_config: ControllerConfig, name: str
) -> None:
    run(tmp_path / "run.h5", straight_config)
    with h5py.File(tmp_path / "run.h5", "a") as file:
        del file[name]
        file[name] = h5py.ExternalLink("elsewhere.h5", "/secret")
    with pytest.raises(DataError, match="damaged"):
        read_recording(tmp_path / "run.h5")


def test_a_run_without_a_step_leaves_nothing(tmp_path: Path, straight_config: ControllerConfig) -> None:
    Recorder(tmp_path / "run.h5", SHAPE, Guarded(Scheduled(straight_config)), Path(__file__)).close()
    assert list(tmp_path.iterdir()) == []


def test_a_network_of_another_size_is_refused(tmp_path: Path, straight_config: ControllerConfig) -> None:
    run(tmp_path / "run.h5", straight_config)
    with pytest.raises(InputError, match="images"):
        replay(read_recording(tmp_path / "run.h5"), OnnxEstimator.load(DEFAULT_MODEL).read)


def test_a_recording_of_an_earlier_format_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "old.h5", "w") as file:
        file.attrs["format"] = "exosight recording 2"
    with pytest.raises(
        DataError, match="recording format 2, this exosight reads format 5; record the run again"
    ):
        read_recording(tmp_path / "old.h5")
