"""`exosight estimate --system FILE --loads TABLE`: network and model of a small rig, side by side."""

import json
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import tomli_w
from cards import made_up
from pictured_rig import vary

from exosight.app.main import main
from exosight.control.estimator import OnnxEstimator, Reading
from exosight.system.build import build
from exosight.system.file import describe, read_system_file
from exosight.system.simulation import simulate_path
from exosight.vision.scene import picture

LEVER = Path(__file__).parents[1] / "rig" / "identification" / "lever.toml"
COMMANDS = np.array([[20.0], [30.0]])
HALF = 0.01
"""Of the network's intervals [N]."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A folder with the system file, two pictures, a table with a third row, and the true readings."""
    folder = tmp_path_factory.mktemp("rig")
    values = read_system_file(LEVER)
    (folder / "my_rig.toml").write_text(tomli_w.dumps({**values, "vary": vary()}))
    system = build(describe(values))
    states = simulate_path(system, COMMANDS)
    axes = {name: np.asarray(axis) for name, axis in states.observation.axes.items()}
    for k, each in enumerate(picture(system, axes)):
        cv2.imwrite(str(folder / f"img_{k}.png"), each)
    (folder / "loads.csv").write_text("picture,p [kPa]\nimg_0.png,20\nimg_1.png,30\nimg_2.png,40\n")
    return folder, np.asarray(states.observation.readings)[:, 0]


@pytest.fixture
def network(rig: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A network that answers these numbers, one a picture."""
    answers: list[float] = []
    schema = build(describe(read_system_file(LEVER))).schema

    def read(images: np.ndarray, level: float) -> Reading:
        value = np.array([[answers.pop(0)]], np.float32)
        return Reading(value, value - HALF, value + HALF, value / value, np.zeros(1, np.float32))

    made = SimpleNamespace(card=made_up(96, 112, schema=schema), read=read, crop=None)
    monkeypatch.setattr(OnnxEstimator, "load", lambda *_, **__: made)
    return answers


def test_both_are_told_and_whether_they_agree(
    rig: tuple[Path, np.ndarray], network: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, true = rig
    network += [float(true[0]), float(true[1]) + 0.1]
    common = ["--system", str(folder / "my_rig.toml"), "--loads", str(folder / "loads.csv")]
    images = [str(folder / f"img_{k}.png") for k in range(2)]
    main(["estimate", *images, *common, "--json", "-"])
    first, second = (each["refined"] for each in json.loads(capsys.readouterr().out)["estimates"])
    for found, value in zip((first, second), true, strict=True):
        (row,) = found["sensors"]
        # Pictures without further noise, of the very model: within its own deviations.
        assert abs(row["value_N"] - value) < 3 * row["deviation_N"]
        assert found["outline_misfit_pixels"] < 0.1
    assert first["disagreement_score"] < 1 < second["disagreement_score"]
    assert second["sensors"][0]["difference_N"] == pytest.approx(0.1, abs=0.01)
    network += [float(true[1]) + 0.1]
    main(["estimate", images[1], *common])
    shown = capsys.readouterr()
    assert "do not trust these: network and model disagree" in shown.err


def test_what_does_not_fit_is_one_sentence(
    rig: tuple[Path, np.ndarray], network: list[float], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder, _ = rig
    system, loads, image = (str(folder / name) for name in ("my_rig.toml", "loads.csv", "img_0.png"))
    (tmp_path / "other.csv").write_text("picture,p [kPa]\nimg_7.png,20\n")
    cv2.imwrite(str(tmp_path / "img_0.png"), np.full((96, 96), 235, np.uint8))
    for options, reason in (
        (["--system", system], "expected --loads together with a system file"),
        (["--loads", loads], "expected --loads together with a system file"),
        (["--system", system, "--masks", system], "expected --loads together with a system file"),
        (
            ["--system", system, "--loads", str(tmp_path / "other.csv")],
            "expected a row for every picture, got none for",
        ),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["estimate", image, *options])
        assert ended.value.code == 2
        assert reason in capsys.readouterr().err
    network += [0.1]
    with pytest.raises(SystemExit):
        main(
            [
                "estimate",
                str(tmp_path / "img_0.png"),
                "--crop",
                "0",
                "0",
                "96",
                "--system",
                system,
                "--loads",
                loads,
            ]
        )
    assert "expected 112×96 pixels" in capsys.readouterr().err
