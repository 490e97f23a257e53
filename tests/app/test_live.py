"""`exosight live` and `exosight replay`: files as camera, a simulated exosuit, Ctrl-C, recordings."""

import json
import os
import re
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from exosight.app import live
from exosight.app.main import main
from exosight.control import (
    CONTROL_SHAPE,
    ControllerConfig,
    Guarded,
    Measurement,
    Scheduled,
    State,
    sources,
    tuning,
)
from exosight.control.estimator import Reading
from exosight.control.realtime import Step
from exosight.control.recording import read_recording
from exosight.control.sources import Frame
from exosight.exosuit.published import published
from exosight.system.system import System
from exosight.vision.ood_images import draw_ood_images

THUMB = Path(__file__).parents[2] / "examples" / "systems" / "thumb.toml"


@pytest.fixture(scope="module")
def known() -> ControllerConfig:
    """What `tune` finds for the published system; it solves for seconds."""
    return tuning.tune(published(CONTROL_SHAPE))


@pytest.fixture(autouse=True)
def tuned_once(monkeypatch: pytest.MonkeyPatch, known: ControllerConfig) -> None:
    tune = tuning.tune

    def remembered(system: System, *names: str | None, **options: float | None) -> ControllerConfig:
        if system.name != "published" or any(names):
            return tune(system, *names, **options)
        return replace(known, **{key: options[key] for key in ("rate", "period") if options.get(key)})

    monkeypatch.setattr(tuning, "tune", remembered)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thirty pictures that no network has learned from."""
    place = tmp_path_factory.mktemp("pictures")
    for i, image in enumerate(draw_ood_images("text", 30, 0)):
        cv2.imwrite(str(place / f"{i:02d}.png"), image)
    return place


def test_a_simulated_exosuit_is_pressed_recorded_and_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(
        [
            "live",
            "--seconds",
            "2.5",
            "--rate",
            "6",
            "--record",
            str(tmp_path / "run.h5"),
            "--json",
            str(tmp_path / "run.json"),
        ]
    )
    shown = capsys.readouterr()
    told = read_recording(tmp_path / "run.h5")
    assert f"u is back at 0 N after {len(told)} steps" in shown.err
    found = json.loads((tmp_path / "run.json").read_text())
    assert found["steps"] == len(told)
    assert found["steps"] + found["missed_periods"] == 15  # on a busy machine some are missed
    assert told.missed.sum() <= found["missed_periods"]
    assert set(told.target) == {0.25}  # half of the largest reading
    assert told.true[-1].sum() > 0.1
    assert [row["stage"] for row in found["timing"]] == [
        *("acquire", "estimate", "control", "actuate", "whole step")
    ]
    main(["replay", str(tmp_path / "run.h5"), "--json", "-"])
    shown = capsys.readouterr()
    assert "the same estimates, states and commands" in " ".join(shown.err.split())
    steps = json.loads(shown.out)["steps"]
    np.testing.assert_array_equal([step["command_replayed"] for step in steps], told.command)
    main(["replay", str(tmp_path / "run.h5")])
    assert "estimate" in capsys.readouterr().out


def test_two_cameras_are_read_recorded_and_replayed_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]
) -> None:
    run, both = tmp_path / "run.h5", ["--model", "shipped", "shipped"]
    main(["live", *both, "--seconds", "1.5", "--rate", "4", "--record", str(run)])
    told = read_recording(run)
    assert next(told.images()).shape == (256, 128)
    assert told.has_estimate.all()
    capsys.readouterr()
    main(["replay", str(run), *both])
    said = " ".join(capsys.readouterr().err.split())
    assert "the network of the recording: the same estimates, states and commands" in said
    assert "need" in refused("replay", run)
    assert "one source for each network" in refused("live", "--source", tmp_path, *both)


def test_pictures_that_are_not_trusted_move_nothing(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ["--rate", "100", "--send", "-", "--json", str(tmp_path / "run.json")]
    main(["live", "--source", str(folder), "--seconds", "0.2", *words])
    shown = capfd.readouterr()
    numbers, names, values, units = zip(*(line.split(" ") for line in shown.out.splitlines()), strict=True)
    found = json.loads((tmp_path / "run.json").read_text())
    assert list(map(int, numbers)) == list(range(found["steps"] + 2))  # before, at each step, at the end
    assert (set(names), set(map(float, values)), set(units)) == ({"u"}, {0.0}, {"N"})
    told = " ".join(shown.err.split())
    assert "an out-of-distribution image" in told
    assert "show the system as the training images do" in told
    assert "show the system" in found["guard"][0]["remedy"]


def test_the_log_says_the_state_its_reason_and_what_was_missed(known: ControllerConfig) -> None:
    """Released by a dark picture, then good pictures until the law may act again."""
    said: list[str] = []
    log, guarded = live.Log(said.append, known), Guarded(Scheduled(known))
    image = np.arange(4, dtype=np.uint8)[:, None] * np.full(4, 60, np.uint8)
    outputs = np.zeros((1, len(known.weights)), np.float32)
    reading = Reading(outputs, outputs, outputs, outputs, np.zeros(1, np.float32))
    for i in range(20):
        shown = np.zeros_like(image) if i < 10 else image + np.uint8(i)
        measurement = Measurement(shown, reading)
        changes, u = len(guarded.log), guarded.step(0.2, measurement)
        cause = guarded.log[-1].cause if len(guarded.log) > changes else ""
        times = np.full(4, 0.05)
        log.append(
            Step(
                float(i), 0.2, measurement, None, u, guarded.state, cause, times, 0.0, guarded.problem, i % 2
            )
        )
    lines = "\n".join(said)
    assert "a black or blank frame: uncover the lens" in lines
    assert lines.count("uncover the lens") == 1
    assert "holds: a black or blank frame" in lines
    assert "releases: a black or blank frame" in lines
    assert "loads slowly: until enough frames in a row were good" in lines
    assert "; missed periods: 1" in lines
    assert "10 of 30 periods of 100 ms were missed, as steps took 200 ms (median)" in log.end()
    assert log.summary()["missed_periods"] == 10


def test_periods_missed_at_the_end_are_counted_too(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def overrun(source, read, guarded, actuator, target, done) -> int:
        problem, times = guarded.problem, np.full(4, 0.2)
        for i in range(2):
            done(Step(float(i), 0.2, Measurement(), None, 0.0, State.NORMAL, "", times, 0.0, problem, 2 * i))
        return 3

    monkeypatch.setattr(live, "run_live", overrun)
    main(["live", "--source", str(folder), "--json", str(tmp_path / "run.json")])
    assert json.loads((tmp_path / "run.json").read_text())["missed_periods"] == 5
    told = " ".join(capsys.readouterr().err.split())
    assert "5 of 7 periods of 100 ms were missed, as steps took 800 ms (median)" in told


@pytest.mark.parametrize(
    ("option", "place", "complaint"),
    [
        ("--send", "nowhere/u", "nowhere is no folder"),
        ("--send", "there", "exists already"),
        ("--record", "nowhere/run.h5", "nowhere is no folder"),
        ("--record", "/proc/run.h5", "/proc/run.h5: cannot be written"),
        ("--json", "/proc/run.json", "/proc/run.json: cannot be written"),
    ],
)
def test_places_that_cannot_be_written_are_refused_before_the_controller_is_tuned(
    folder: Path,
    tmp_path: Path,
    option: str,
    place: str,
    complaint: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def never(*arguments: object, **options: object) -> None:
        raise AssertionError

    monkeypatch.setattr(tuning, "tune", never)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").write_text("precious")
    with pytest.raises(SystemExit) as end:
        main(["live", "--source", str(folder), option, place])
    assert end.value.code == 2
    assert complaint in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    assert (tmp_path / "there").read_text() == "precious"


def test_a_folder_of_results_below_a_file_is_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("precious")
    with pytest.raises(SystemExit) as end:
        main(["control", "--out", str(tmp_path / "file" / "out")])
    assert end.value.code == 2
    assert "out: cannot be made (Not a directory); name another folder" in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, "not a picture"])
def test_a_source_is_checked_before_the_controller_is_tuned(
    tmp_path: Path,
    content: str | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def never(*arguments: object, **options: object) -> None:
        raise AssertionError

    monkeypatch.setattr(tuning, "tune", never)
    if content is not None:
        (tmp_path / "a.png").write_text(content)
    with pytest.raises(SystemExit) as end:
        main(["live", "--source", str(tmp_path)])
    assert end.value.code == 2
    assert "picture" in capsys.readouterr().err


def test_a_target_that_is_out_of_reach_is_said_to_be(
    folder: Path, capfd: pytest.CaptureFixture[str], known: ControllerConfig
) -> None:
    main(["live", "--source", str(folder), "--seconds", "0.05", "--rate", "100", "--target", "3"])
    largest = known.loading.controlled.max()
    words = f"F_net reads at most {largest:.3f} N within the limits, less than the target"
    assert words in " ".join(capfd.readouterr().err.split())


def test_a_folder_that_ends_ends_the_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["live", "--source", str(folder), "--seconds", "60", "--rate", "200"])
    assert "after 30 steps" in capsys.readouterr().err


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_lets_go_first(
    tmp_path: Path,
    kind: signal.Signals,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    note = live.Log.append

    def stop(log: live.Log, step: Step) -> None:
        note(log, step)
        if log.steps == 8:
            os.kill(os.getpid(), kind)

    monkeypatch.setattr(live.Log, "append", stop)
    # Programs that a shell starts in the background are told to ignore SIGINT, test runners among them.
    outside = signal.signal(signal.SIGINT, signal.default_int_handler)
    before = signal.getsignal(kind)
    try:
        with pytest.raises(SystemExit) as end:
            main(["live", "--seconds", "20", "--record", str(tmp_path / "run.h5")])
        assert signal.getsignal(kind) is before
    finally:
        signal.signal(signal.SIGINT, outside)
    assert end.value.code == 128 + kind
    assert "u is back at 0 N after 8 steps" in capsys.readouterr().err
    told = read_recording(tmp_path / "run.h5")
    assert len(told) >= 7  # the eighth may have been on its way to the file
    assert told.command[-1] > 1


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--source", "nothing"], "source"),
        (["--source", "63"], "camera 63"),
        (["--send", "-"], "--source"),
        (["--crop", "0", "0", "9"], "--source"),
        (["--source", ".", "--actuator", "valve.csv"], "expected --send with --actuator"),
        (["--target", "-1"], "target"),
        (["--rate", "0"], "rate"),
        (["--r0", "0.02"], "r0"),
        (["--system", str(THUMB), "--r0", "0.01"], "--r0: an option of presets"),
        (["--system", str(THUMB)], "expected the sensors"),
        (["--system", "no_such_system"], "expected published, index, index-friction or a file"),
        (["--sensor", "C0"], "not estimated from images"),
        (["--channel", "v"], "got 'v'"),
        (["--source", ".", "--send", "-", "--json", "-"], "stdout"),
    ],
)
def test_wrong_use_is_told_in_one_sentence(
    words: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(["live", *words])
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert "Traceback" not in error


def test_a_recording_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "run.h5").write_text("precious")
    with pytest.raises(SystemExit):
        main(["live", "--record", str(tmp_path / "run.h5")])
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "run.h5").read_text() == "precious"
    with pytest.raises(SystemExit):
        main(["replay", str(tmp_path / "run.h5")])
    assert "damaged, or not a recording" in " ".join(capsys.readouterr().err.split())


def test_the_code_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With three pictures for a camera."""
    shown = [Frame(image, time.monotonic()) for image in draw_ood_images("text", 3, 0)]
    monkeypatch.setattr(sources, "camera", lambda number, width, height: iter(shown))
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "realtime.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    exec(compile(code, "realtime.md", "exec"), {})
    assert len(read_recording(tmp_path / "run.h5")) == 3
