from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from exosight.app.main import main
from exosight.control import OnnxEstimator
from exosight.control.estimator import DEFAULT_MODEL
from exosight.exosuit.simulation import simulate
from exosight.lab.pose_cache import PoseCache
from exosight.lab.settings import View
from exosight.lab.views import answer, exosuit_of, judge, network, path_of, photograph, see
from exosight.vision.ood_images import draw_ood_images


@pytest.fixture(scope="module")
def poses() -> PoseCache:
    return PoseCache()


def test_a_view_is_what_the_package_says_of_the_same_exosuit(poses: PoseCache) -> None:
    view = View(drive=(2.4,))
    seen = see(view, poses)
    (record,) = simulate(exosuit_of(view), [2.4]).records()
    # Converged to 1e-7 in the energy norm; the largest difference found was 4e-8 N.
    np.testing.assert_allclose(seen.pose.forces, record["forces"], atol=1e-6)
    read = OnnxEstimator.load(DEFAULT_MODEL).read(seen.image[None])
    np.testing.assert_array_equal(seen.reading.forces, read.forces)
    assert seen.state == ("normal", "picture and estimate can be trusted")


def test_arrows_are_the_forces_and_stand_on_the_spheres(poses: PoseCache) -> None:
    seen = see(View(drive=(3.0,)), poses)
    at, force = seen.pose.spheres, seen.pose.pushes
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), seen.pose.forces, atol=1e-12)
    np.testing.assert_allclose(at[::2], seen.pose.finger[:4], atol=1e-9)  # C0, C2, C4, C6: joints
    assert seen.pose.forces.max() > 0.05
    assert force[:, 2].max() <= 0  # the exosuit lies above the finger: it presses down


def test_the_path_passes_through_the_view(poses: PoseCache) -> None:
    view = View(drive=(4.0, 2.4))
    path = path_of(poses.get(exosuit_of(view)))
    assert path["u"][24] == 2.4
    assert path["unloading"][24] == pytest.approx(float(see(view, poses).pose.net_force), abs=1e-5)
    assert path["loading"][24] == pytest.approx(
        float(see(View(drive=(2.4,)), poses).pose.net_force), abs=1e-5
    )
    assert path["loading"][-1] == path["unloading"][-1]


@pytest.mark.parametrize(
    "changed",
    [
        {"corruption": "noise-low"},
        {"corruption": "contrast-high"},
        {"corruption": "blur"},
        {"corruption": "occlusion"},
        {"corruption": "background"},
        {"shift_x": 0.1},
        {"roll": 0.2},
        {"zoom": 1.2},
        {"tilt": 0.3},
    ],
    ids=str,
)
def test_camera_and_corruption_change_the_picture_and_nothing_else(poses: PoseCache, changed: dict) -> None:
    plain, other = (see(replace(View(), **each), poses) for each in ({}, changed))
    assert np.any(plain.image != other.image)
    np.testing.assert_array_equal(plain.rest.q, other.rest.q)
    np.testing.assert_array_equal(see(replace(View(), **changed), poses).image, other.image)


def test_a_picture_shifted_right_has_moved_right() -> None:
    clean = np.full((1, 128, 128), 235, np.uint8)
    clean[0, 40:80, 30:60] = 60
    moved = photograph(View(shift_x=0.125), clean)[0]
    np.testing.assert_array_equal(moved[:, 16:], clean[0, :, :-16])


def test_the_guard_tells_what_it_would_do() -> None:
    strange = draw_ood_images("text", 1, 0)[0]
    state, cause = judge(strange, network().read(strange[None]))
    assert state == "hold"
    assert "out-of-distribution image" in cause
    black = np.zeros((128, 128), np.uint8)
    assert judge(black, network().read(black[None])) == ("hold", "a black or blank frame")


def test_too_much_force_makes_the_guard_release(poses: PoseCache) -> None:
    seen = see(View(), poses)
    heavy = replace(
        seen.reading, forces=seen.reading.forces + np.float32(0.7), high=seen.reading.high + np.float32(1)
    )
    state, cause = judge(seen.image, heavy)
    assert state == "release"
    assert "presses with" in cause


def test_frames_that_datasets_drop_are_marked(poses: PoseCache) -> None:
    rolled = View(parameters=(0.0045, 0.004), length=0.11, drive=(4.0,))
    told = answer(rolled, exosuit_of(rolled), see(rolled, poses))
    assert told["notes"]
    assert not answer(View(), exosuit_of(View()), see(View(), poses))["notes"]


def test_the_command_writes_the_files_of_a_view(tmp_path: Path, poses: PoseCache) -> None:
    main(["lab", "--drive", "4", "2.4", "--young", "250e3", "--out", str(tmp_path / "view")])
    seen = see(View(drive=(4.0, 2.4), young=250e3), poses)
    image = cv2.imread(str(tmp_path / "view" / "picture.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, seen.image)
    rows = [line.split(",") for line in (tmp_path / "view" / "forces.csv").read_text().splitlines()]
    assert [row[0] for row in rows[1:]] == [*(f"C{i}" for i in range(8)), "F_net"]
    assert [float(row[1]) for row in rows[1:]] == pytest.approx(
        [*seen.pose.forces.tolist(), float(seen.pose.net_force)], abs=1e-5
    )
    assert len((tmp_path / "view" / "path.csv").read_text().splitlines()) == 42


def test_the_command_refuses_what_the_page_refuses(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["--family", "sine"], ["--drive", "9"], ["--parameters", "1", "2"]):
        with pytest.raises(SystemExit) as end:
            main(["lab", *words])
        assert end.value.code == 2
        assert capsys.readouterr().err.count("\n") == 1
