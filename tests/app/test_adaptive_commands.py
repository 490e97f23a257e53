"""The adaptive controller at the command line: the paper's trials on `index`, in real time, and refusals."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from exosight.app import control_command
from exosight.app.main import main
from exosight.control import CONTROL_SHAPE, ControllerConfig, tuning
from exosight.exosuit.index import index
from exosight.system.system import System


@pytest.fixture(scope="module")
def known() -> ControllerConfig:
    """What `tune` finds for `index`; it solves for seconds."""
    return tuning.tune(index(CONTROL_SHAPE))


@pytest.fixture(autouse=True)
def tuned_once(monkeypatch: pytest.MonkeyPatch, known: ControllerConfig) -> None:
    def remembered(
        system: System, *names: str | None, period: float = 0.1, **limits: None
    ) -> ControllerConfig:
        assert system.name == "index"
        assert not any((*names, *limits.values()))
        return replace(known, period=period)

    monkeypatch.setattr(tuning, "tune", remembered)
    monkeypatch.setattr(control_command, "tune", remembered)


def test_the_trials_of_the_paper_with_images(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--system", "index", "--controller", "adaptive", "--model", "index-control")
    main(["control", *words, "--json", "-"])
    *constant, step = json.loads(capsys.readouterr().out)["trials"]
    assert [trial["target"] for trial in constant] == [0.25, 0.30, 0.35]
    for trial in constant:
        # What the page states; u needs three or four steps of 1 N.
        assert trial["settling_steps"] <= 4
        assert trial["overshoot_percent"] < 5
        assert abs(trial["steady_state_error"]) < 0.05 * trial["target"]
    assert step["target"] == 0.2
    assert step["settling_steps"] <= 3
    # 2.5 N at 1 N a step, of which the last half newton presses hardly.
    assert step["release_time"] <= 0.2 + 1e-9


def test_a_run_in_real_time_replays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--system", "index", "--controller", "adaptive", "--model", "index-control")
    record, replayed = tmp_path / "run.h5", tmp_path / "run.json"
    main(["live", *words, "--seconds", "1.6", "--rate", "8", "--record", str(record)])
    main(["replay", str(record), "--model", "index-control", "--json", str(replayed)])
    told = " ".join(capsys.readouterr().err.split())
    assert "the network of the recording: the same estimates, states and commands" in told
    steps = json.loads(replayed.read_text())["steps"]
    assert {step["state"] for step in steps} == {"normal"}
    assert np.ptp([step["command"] for step in steps]) > 1.0


def test_it_has_no_gain(refused: Callable[..., str]) -> None:
    sentence = refused("control", "--system", "index", "--controller", "adaptive", "--gains", 2)
    assert sentence == (
        "control: expected --gains with the proportional law alone, got adaptive; leave them out"
    )


def test_the_trials_of_the_paper_with_a_learned_correction(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "trials"
    main(["control", "--system", "index", "--law", "index-policy", "--out", str(out), "--json", "-"])
    *constant, _ = json.loads(capsys.readouterr().out)["trials"]
    for trial in constant:
        # Its plant is the nominal one, where there is nothing to correct: the network adds a per cent or two.
        assert trial["settling_steps"] <= 4
        assert abs(trial["steady_state_error"]) < 0.05 * trial["target"]
    assert json.loads((out / "results.json").read_text())["config"]["controller"] == "index-policy.onnx"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ("control", "--controller", "guarded", "--law", "index-policy"),
            "control: expected the adaptive controller with --law, got guarded; leave --controller out",
        ),
        (
            ("stress", "--controllers", "adaptive", "--law", "index-policy"),
            "stress: expected the controller learned or unguarded with --law, got neither",
        ),
        (("control", "--law", "missing.onnx"), "missing.onnx: cannot be read"),
    ],
)
def test_a_law_that_does_not_apply_is_refused(
    words: tuple[str, ...], sentence: str, refused: Callable[..., str]
) -> None:
    assert refused(*words).startswith(sentence)
