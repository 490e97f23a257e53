"""`exosight estimate` with the network that comes with the package."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from exosight.app.main import main
from exosight.control.estimator import DEFAULT_MODEL, SHIPPED_MODELS, OnnxEstimator
from exosight.control.simulated import SimulatedPlant
from exosight.exosuit.index import index, index_friction
from exosight.exosuit.published import Preset, published
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.system.system import System
from exosight.vision.ood_images import draw_ood_images

SHAPE = ExosuitShape(Linear(r0=0.01, r1=0.005), length=0.095)
"""The controller's: no frame of it was learned from."""


@pytest.fixture(scope="module")
def frames() -> tuple[np.ndarray, np.ndarray]:
    return _seen(published(SHAPE))


def _seen(system: System) -> tuple[np.ndarray, np.ndarray]:
    """Images up to 2.4 N, and what the estimated sensors read on them [N]."""
    plant = SimulatedPlant(system)
    plant.reset()
    found = [plant.apply(np.array([u])) for u in np.linspace(0, 2.4, 13)]
    readings = np.array([each.readings for each in found])[:, plant.schema.output_indices()]
    return np.stack([each.image for each in found]), readings


def test_forces_of_an_unseen_exosuit_are_near_the_true_ones(frames: tuple[np.ndarray, np.ndarray]) -> None:
    images, forces = frames
    read = OnnxEstimator.load(DEFAULT_MODEL).read(images)
    error = read.forces - forces
    # Its card states 0.006 N RMSE over many exosuits; for a single one, several times that.
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.all(read.ood_score < 1)


@pytest.mark.parametrize("preset", [index, index_friction])
def test_presets_have_networks_of_their_own(
    preset: Preset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    system = preset(SHAPE)
    images, forces = _seen(system)
    cv2.imwrite(str(tmp_path / "pose.png"), images[-1])
    main(["estimate", str(tmp_path / "pose.png"), "--system", system.name, "--json", "-"])
    (found,) = json.loads(capsys.readouterr().out)["estimates"]
    # As above: its card states some 0.005 N RMSE over many exosuits; of a net force, a few times that.
    assert found["F_net_N"] == pytest.approx(forces[-1].sum(), abs=0.03)
    assert found["ood_score"] < 1


def test_the_command_tells_what_the_estimator_reads(
    tmp_path: Path, frames: tuple[np.ndarray, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    images, _ = frames
    path = tmp_path / "pose.png"
    cv2.imwrite(str(path), images[-1])
    main(["estimate", str(path), "--json", "-"])
    (found,) = json.loads(capsys.readouterr().out)["estimates"]
    read = OnnxEstimator.load(DEFAULT_MODEL).read(images[-1:])
    assert [row["contact"] for row in found["contacts"]] == ["C1", "C2", "C3", "C4", "C5", "C6", "C7"]
    assert [row["force_N"] for row in found["contacts"]] == pytest.approx(read.forces[0].tolist(), abs=1e-6)
    assert [row["low_N"] for row in found["contacts"]] == pytest.approx(read.low[0].tolist(), abs=1e-6)
    assert found["F_net_N"] == pytest.approx(float(read.forces.sum()), abs=1e-5)
    main(["estimate", str(path)])
    shown = capsys.readouterr()
    assert f"F_net {read.forces.sum():.3f} N" in shown.out  # a result, which a pipe is to carry
    assert "do not trust" not in shown.out + shown.err


def test_a_picture_of_something_else_is_not_trusted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "text.png"
    cv2.imwrite(str(path), draw_ood_images("text", 1, 0)[0])
    main(["estimate", str(path)])
    shown = capsys.readouterr()
    assert "do not trust these: probability" in shown.out + shown.err


def test_what_is_no_picture_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("not a picture")
    with pytest.raises(SystemExit):
        main(["estimate", str(tmp_path / "notes.txt")])
    assert "not a picture that can be read" in capsys.readouterr().err


def test_a_picture_that_cannot_be_read_does_not_stop_the_others(
    tmp_path: Path, frames: tuple[np.ndarray, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.png").write_text("not a picture")
    cv2.imwrite(str(tmp_path / "good.png"), frames[0][-1])
    words = [str(tmp_path / name) for name in ("bad.png", "none.png", "good.png")]
    with pytest.raises(SystemExit) as end:
        main(["estimate", *words, "--json", "-"])
    assert end.value.code == 2
    shown = capsys.readouterr()
    found = json.loads(shown.out)
    assert [each["image"] for each in found["estimates"]] == words[2:]
    assert [each["image"] for each in found["failures"]] == words[:2]
    assert "not a picture" in found["failures"][0]["reason"]
    assert "2 of 3 pictures could not be read" in shown.err


def test_a_crop_takes_the_part_that_shows_the_system(
    tmp_path: Path, frames: tuple[np.ndarray, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    wide = np.pad(frames[0][-1], ((0, 0), (20, 30)))
    cv2.imwrite(str(tmp_path / "wide.png"), wide)
    cv2.imwrite(str(tmp_path / "own.png"), frames[0][-1])
    found = []
    for words in (["wide.png", "--crop", "20", "0", "128"], ["own.png"]):
        main(["estimate", str(tmp_path / words[0]), *words[1:], "--json", "-"])
        found.append(json.loads(capsys.readouterr().out)["estimates"][0]["F_net_N"])
    assert found[0] == found[1]
    with pytest.raises(SystemExit):
        main(["estimate", str(tmp_path / "wide.png")])
    assert "--crop 25 0 128" in capsys.readouterr().err


def test_no_picture_at_all_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["estimate"])
    assert "estimate" in capsys.readouterr().err


def test_a_system_without_a_network_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["estimate", "image.png", "--system", "indx"])
    assert "system: expected published, index, index-friction, got 'indx'" in capsys.readouterr().err


def test_the_models_and_their_weights_are_small() -> None:
    assert all(path.stat().st_size < 5e6 for path in SHIPPED_MODELS.values())
