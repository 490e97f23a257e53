"""A tiny study from end to end: stopped, resumed, finished, and left alone."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from exosight.app.main import main
from exosight.app.report import Report
from exosight.app.study import _closed_loops, _surfaces
from exosight.app.study_config import PRESETS, IndexConfig, RunConfig, StudyConfig, read_config, to_text
from exosight.control import OnnxEstimator, trials
from exosight.control.estimator import DEFAULT_MODEL
from exosight.dataset import generation, read_manifest
from exosight.dataset.config import GenerateConfig
from exosight.errors import DataError
from exosight.exosuit.variation import PlantVariation
from exosight.learning.config import TrainConfig
from exosight.system.camera import Camera

TINY = StudyConfig(
    data=GenerateConfig(
        per_scenario=1,
        frames=5,
        seed=3,
        plant=PlantVariation(young=(2.5, 2.7)),  # plain silicone winds up, at three times the solver's steps
        camera=Camera(metres_per_pixel=0.0044, width=32, height=32),
    ),
    runs=(
        RunConfig("design", TrainConfig(epochs=2, batch=8, threads=1)),
        RunConfig("frame", TrainConfig(epochs=1, batch=8, threads=1)),
    ),
    index=IndexConfig("design", TrainConfig(epochs=1, batch=8, threads=1), frames=6),
)


@pytest.fixture(scope="module", autouse=True)
def short_trials():
    """Steps enough for every figure and measure; six compiled robots at a time, as other tests have them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trials, "STEADY_STATE_STEPS", 4)
        patch.setattr(trials, "STEP_SECONDS", 0.4)
        patch.setattr(generation, "DESIGNS_PER_CHUNK", 6)
        yield


def stopped(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def times(folder: Path) -> dict[str, int]:
    return {str(p.relative_to(folder)): p.stat().st_mtime_ns for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def history(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, dict[str, int]]]:
    """The folder of a study stopped while simulating, before its second network, and before its closed loop.

    With the files that it held after each of these, and in the end.
    """
    place = tmp_path_factory.mktemp("studies")
    config = place / "tiny.json"
    config.write_text(to_text(TINY))
    folder = place / "tiny"
    first = ["study", "--config", str(config), "--out", str(folder)]
    again = ["study", "--out", str(folder), "--resume"]
    held = {}
    for stage, where, words in (
        ("simulating", "exosight.dataset.generation.solve_designs", first),
        ("second network", "exosight.app.study._network_result", again),
        ("closed loop", "exosight.app.study.run_with_progress", again),
    ):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(where, stopped)
            with pytest.raises(SystemExit) as end:
                main(words)
        assert end.value.code == 130
        held[stage] = times(folder)
    main(again)
    held["end"] = times(folder)
    return folder, held


def test_incomplete_data_are_gone_on_with(history: tuple[Path, dict]) -> None:
    folder, held = history
    assert set(held["simulating"]) == {"study.json", "data/job.json", "data/.lock"}
    assert "data/manifest.json" in held["second network"]
    assert read_manifest(folder / "data").seed == 3


def test_what_is_done_is_not_done_again(history: tuple[Path, dict]) -> None:
    """No file that one attempt left is written by the next; loss curves alone are written with each."""
    _, held = history
    stages = list(held.values())
    for before, after in pairwise(stages):
        assert before.items() - after.items() <= {
            (name, at) for name, at in before.items() if name.endswith("history.csv")
        }


def test_results_appear_when_they_are_complete(history: tuple[Path, dict]) -> None:
    _, held = history
    assert "light_shape/model.onnx" in held["second network"]
    assert "light_frame/model.onnx" not in held["second network"]
    assert "light_frame/model.onnx" in held["closed loop"]
    assert not any(name.startswith("control") for name in held["closed loop"])
    assert "report.html" not in held["closed loop"]
    assert {"control/results.json", "tables/headline.csv", "report.html"} <= set(held["end"])
    assert not any(".part" in name for name in held["end"])


def test_study_stopped_just_before_its_report_is_resumed(
    history: tuple[Path, dict], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables and trials are there already, and are left as they are."""
    folder = tmp_path / "copy"
    shutil.copytree(history[0], folder)
    (folder / "report.html").unlink()
    before = times(folder)
    short = Report("short", "", (), "")
    monkeypatch.setattr("exosight.app.study.build_report", lambda results, command: short)
    main(["study", "--out", str(folder), "--resume"])
    after = times(folder)
    assert after.keys() - before.keys() == {"report.html"}
    assert {name for name, _ in before.items() - after.items()} <= {
        f"{name}/history.csv" for name in ("light_shape", "light_frame", "index_network")
    }


def test_shipped_network_steers_where_it_fits_the_camera(tmp_path: Path) -> None:
    shipped = OnnxEstimator.load(DEFAULT_MODEL)
    own, other = _closed_loops(TINY, shipped, Camera(), tmp_path)
    assert (own.shipped, other.shipped) == (False, True)
    assert {"control", "control_shipped"} == {path.name for path in tmp_path.iterdir()}
    # The same network and plant: the same loop.
    np.testing.assert_array_equal(own.constant[0].record.command, other.constant[0].record.command)


def test_the_same_exosuit_on_smooth_surfaces_stands_beside(tmp_path: Path) -> None:
    without = replace(TINY, index=None)
    assert _surfaces(without, TINY.data.camera, tmp_path) is None  # the shipped network has another camera
    found = _surfaces(without, Camera(), tmp_path)
    assert found is not None
    assert found.run is found.result is None
    (shipped,) = found.loops
    assert shipped.shipped
    assert [float(trial.record.target[0]) for trial in shipped.trials] == [0.25, 0.30, 0.35]
    assert {trial.record.schema.system for trial in shipped.trials} == {"index"}
    assert "control_index_shipped" in {path.name for path in tmp_path.iterdir()}
    top = int(np.argmax(found.u))
    assert found.u[top] == 4.0
    # Where the targets lie the force rises without a jump, and without friction falls the same way.
    rising, falling = found.net_force[: top + 1], found.net_force[top:][::-1]
    targets = rising < 0.36
    assert 0 < np.diff(rising[targets]).max() < 0.05
    np.testing.assert_allclose(falling[targets], rising[targets], atol=5e-3)


def test_network_of_the_study_on_smooth_surfaces_is_its_own(history: tuple[Path, dict]) -> None:
    folder, held = history
    assert {"index_data/manifest.json", "index_network/model.onnx"} <= set(held["end"])
    data = read_manifest(folder / "index_data")
    assert (data.config["system"], data.seed) == ("index", TINY.data.seed)
    assert (data.config["per_scenario"], data.config["frames"]) == (TINY.data.per_scenario, 6)
    trial = json.loads((folder / "control_index" / "results.json").read_text())
    assert trial["config"]["model"] == "index_network/model.onnx"
    headline = json.loads((folder / "tables" / "headline.json").read_text())
    assert "light network, by shape, index" in json.dumps(headline)


def test_finished_study_is_returned_as_it_is(
    history: tuple[Path, dict], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = history
    before = times(folder)
    main(["study", "--out", str(folder), "--resume"])
    assert capsys.readouterr().out == f"The report is {folder / 'report.html'}\n"
    assert times(folder) == before


def test_another_study_does_not_go_into_its_folder(
    history: tuple[Path, dict], refused: Callable[..., str]
) -> None:
    folder, _ = history
    before = times(folder)
    sentence = refused("study", "--out", folder, "--resume", "--preset", "quick")
    assert "holds a study with another configuration" in sentence
    assert "exists already" in refused("study", "--out", folder)
    assert times(folder) == before


def test_folder_holds_the_configuration_that_makes_it_again(history: tuple[Path, dict]) -> None:
    folder, _ = history
    assert read_config(folder / "study.json") == TINY
    trial = json.loads((folder / "control" / "results.json").read_text())
    assert trial["config"]["model"] == "light_shape/model.onnx"
    assert trial["config"]["camera"]["width"] == 32
    assert len(trial["trials"]) == 6


def test_report_tells_how_it_was_made_and_needs_nothing_else(history: tuple[Path, dict]) -> None:
    folder, _ = history
    page = (folder / "report.html").read_text()
    assert f"exosight study --config study.json --out {folder}" in page
    assert "&#34;per_scenario&#34;: 1" in page
    assert page.count("data:image/svg+xml;base64,") >= 10
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    for run in TINY.runs:
        assert run.name in page


def test_control_command_writes_what_a_study_writes(
    history: tuple[Path, dict], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = history
    model = folder / "light_shape" / "model.onnx"
    main(["control", "--model", str(model), "--out", str(tmp_path / "control"), "--json", "-"])
    answer = json.loads(capsys.readouterr().out)
    assert {path.name for path in (tmp_path / "control").iterdir()} == {
        path.name for path in (folder / "control").iterdir()
    }
    written = json.loads((tmp_path / "control" / "results.json").read_text())
    assert written["trials"] == answer["trials"]
    # The same plant, camera, network and law give the same numbers.
    assert answer["trials"] == json.loads((folder / "control" / "results.json").read_text())["trials"]


def test_presets_are_those_that_the_help_promises() -> None:
    assert PRESETS["quick"].data.per_scenario * 11 == 110
    assert PRESETS["paper"].data.per_scenario * 11 == 1375
    assert {run.training.network for run in PRESETS["quick"].runs} == {"light"}
    assert {run.training.network for run in PRESETS["paper"].runs} == {"light", "paper"}


def test_configuration_survives_its_file(tmp_path: Path) -> None:
    for config in PRESETS.values():
        (tmp_path / "study.json").write_text(to_text(config))
        assert read_config(tmp_path / "study.json") == config


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: c.pop("runs"), "runs: Field required"),
        (lambda c: c["runs"].clear(), "runs: Tuple should have at least 1 item"),
        (lambda c: c["runs"].append(c["runs"][0]), "another network or another protocol for each run"),
        (lambda c: c["runs"][0]["training"].update(history=1), "networks with one image as input"),
        (lambda c: c["data"].update(per_scenario=0), r"data.per_scenario: Input should be greater than"),
        (lambda c: c["data"].update(system="thumb.toml"), "expected the published system"),
        (lambda c: c["data"].update(shapes=3), r"data.shapes: Unexpected keyword argument"),
    ],
)
def test_configuration_that_makes_no_study_is_refused(tmp_path: Path, change: Callable, said: str) -> None:
    values = json.loads(to_text(TINY))
    change(values)
    path = tmp_path / "study.json"
    path.write_text(json.dumps(values))
    with pytest.raises(DataError, match=said):
        read_config(path)
