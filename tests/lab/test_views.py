from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from example_systems import THUMB

from exosight.app.main import main
from exosight.control import OnnxEstimator
from exosight.control.estimator import DEFAULT_MODEL
from exosight.control.simulated import SimulatedPlant
from exosight.lab.estimates import judge
from exosight.lab.pictures import camera_image
from exosight.lab.saving import pose_csv
from exosight.lab.settings import CameraSettings, PathSettings, View
from exosight.lab.system import LabSystem
from exosight.lab.views import answer, compute_view, path_answer, path_of
from exosight.vision.ood_images import draw_ood_images
from exosight.vision.renderer import BACKGROUND


def told_path(settings: PathSettings, lab: LabSystem) -> dict:
    return path_answer(settings, path_of(settings, lab), lab.cached(settings.view), lab)


@pytest.mark.parametrize("name", ["lab", "thumb"])
def test_a_view_is_what_the_plant_shows_of_the_same_system(name: str, request: pytest.FixtureRequest) -> None:
    lab: LabSystem = request.getfixturevalue(name)
    seen = compute_view(View(drive=((2.4,),)), lab)
    plant = SimulatedPlant(lab.cached(View()).system)
    plant.reset()
    shown = plant.apply(np.array([2.4]))
    # Converged to 1e-7 in the energy norm; the largest difference found was 4e-8 N.
    np.testing.assert_allclose(seen.observation.readings, shown.readings, atol=1e-6)
    np.testing.assert_array_equal(seen.image, shown.image)
    told = answer(View(drive=((2.4,),)), seen, lab)
    assert list(told["readings"]) == [sensor.name for sensor in lab.schema.sensors]


def test_estimates_are_those_of_the_network(lab: LabSystem) -> None:
    seen = compute_view(lab.start, lab)
    read = OnnxEstimator.load(DEFAULT_MODEL).read(seen.image[None])
    told = answer(lab.start, seen, lab)["reading"]
    assert tuple(told["estimates"]) == (*lab.schema.outputs, "F_net")
    values = [told["estimates"][name]["value"] for name in lab.schema.outputs]
    np.testing.assert_allclose(values, read.forces[0], atol=6e-6)  # five digits are sent
    assert told["estimates"]["F_net"]["value"] == pytest.approx(float(read.forces.sum()), abs=6e-6)


def test_a_network_of_another_system_gives_no_estimates_and_says_so(thumb: LabSystem) -> None:
    seen = compute_view(thumb.start, thumb)
    told = answer(thumb.start, seen, thumb)
    assert seen.reading is None
    assert told["reading"] is None
    assert told["guard"] is None
    assert told["readings"]["F_net"] > 0.1
    refusal = thumb.refusal or ""
    assert refusal.startswith(
        "no estimates: the network was trained for the system published; expected the sensors"
    )
    assert "got P1, P2, P3;" in refusal


@pytest.mark.parametrize("name", ["lab", "thumb"])
def test_arrows_are_the_forces_on_the_zones(name: str, request: pytest.FixtureRequest) -> None:
    lab: LabSystem = request.getfixturevalue(name)
    view = View(drive=((3.0,),))
    seen = compute_view(view, lab)
    told = answer(view, seen, lab)
    zones = [sensor.name for sensor in lab.schema.sensors if sensor.quantity == "contact force"]
    assert len(told["scene"]["zones"]) == len(zones)
    for zone, sensor in zip(told["scene"]["zones"], zones, strict=True):
        # Planar: nothing is lost with y; five digits are sent.
        assert np.hypot(*zone["force"]) == pytest.approx(told["readings"][sensor], abs=2e-5)
        assert zone["force"][1] <= 0  # what is worn lies above: it presses down
    assert max(told["readings"][name] for name in zones) > 0.05


@pytest.mark.parametrize(("name", "end"), [("lab", 0.0), ("thumb", -1.0)])
def test_a_path_goes_to_the_peak_and_back_through_the_view(
    name: str, end: float, request: pytest.FixtureRequest
) -> None:
    lab: LabSystem = request.getfixturevalue(name)
    path = told_path(PathSettings(), lab)
    assert path["sensor"] == "F_net"
    assert [path[way][i][0] for way in ("loading", "unloading") for i in (0, -1)] == [0, 4, 4, end]
    assert path["loading"][-1] == path["unloading"][0]
    for way, drive in (("loading", ((2.4,),)), ("unloading", ((4.0,), (2.4,)))):
        seen = compute_view(View(drive=drive), lab).observation.readings[lab.schema.index("F_net")]
        assert dict(path[way])[2.4] == pytest.approx(float(seen), abs=1e-5)
    highest = max(value for _, value in path["loading"] + path["unloading"])
    assert path["target"]["low"] < path["target"]["start"] < highest <= path["target"]["high"]


def test_a_path_keeps_the_other_channels_where_they_are(assisted: LabSystem) -> None:
    view = View(drive=((1.0, 0.02),))
    path = told_path(PathSettings(view, channel="assist", sensor="knuckle"), assisted)
    angle = compute_view(view, assisted).observation.readings[assisted.schema.index("knuckle")]
    assert dict(path["loading"])[0.02] == pytest.approx(float(angle), abs=1e-5)
    assert path["unloading"][-1][0] == -0.02
    assert answer(view, compute_view(view, assisted), assisted)["drive"] == ((1.0, 0.0), (1.0, 0.02))


@pytest.mark.parametrize(
    "camera",
    [
        CameraSettings(corruption="noise-low"),
        CameraSettings(corruption="contrast-high"),
        CameraSettings(corruption="blur"),
        CameraSettings(corruption="occlusion"),
        CameraSettings(corruption="background"),
        CameraSettings(shift_x=0.1),
        CameraSettings(roll=0.2),
        CameraSettings(zoom=1.2),
        CameraSettings(tilt=0.3),
    ],
    ids=str,
)
def test_camera_and_corruption_change_the_picture_and_nothing_else(
    lab: LabSystem, camera: CameraSettings
) -> None:
    plain, other = (compute_view(replace(lab.start, camera=each), lab) for each in (CameraSettings(), camera))
    assert np.any(plain.image != other.image)
    np.testing.assert_array_equal(plain.rest.q, other.rest.q)
    np.testing.assert_array_equal(compute_view(replace(lab.start, camera=camera), lab).image, other.image)


def test_a_picture_shifted_right_has_moved_right() -> None:
    clean = np.full((1, 128, 128), 235, np.uint8)
    clean[0, 40:80, 30:60] = 60
    moved = camera_image(CameraSettings(shift_x=0.125), clean)[0]
    np.testing.assert_array_equal(moved[:, 16:], clean[0, :, :-16])


def test_the_guard_tells_what_it_would_do(lab: LabSystem) -> None:
    strange = draw_ood_images("text", 1, 0)[0]
    told = judge(strange, lab.network.read(strange[None]), lab.schema)
    assert told["state"] == "hold"
    assert "out-of-distribution image" in told["cause"]
    black = np.zeros((128, 128), np.uint8)
    told = judge(black, lab.network.read(black[None]), lab.schema)
    assert told == {"state": "hold", "cause": "a black or blank frame"}


def test_too_much_force_makes_the_guard_release(lab: LabSystem) -> None:
    seen = compute_view(lab.start, lab)
    assert seen.reading is not None
    heavy = replace(
        seen.reading, forces=seen.reading.forces + np.float32(0.7), high=seen.reading.high + np.float32(1)
    )
    assert judge(seen.image, heavy, lab.schema)["state"] == "release"


def test_frames_that_datasets_drop_are_marked(lab: LabSystem) -> None:
    rolled = View({"r0": 4.5, "r1": 4.0, "length": 110.0}, ((4.0,),))
    assert compute_view(rolled, lab).notes
    assert not compute_view(lab.start, lab).notes


def read_rows(file: Path) -> list[list[str]]:
    return [line.split(",") for line in file.read_text(encoding="utf-8").splitlines()]


@pytest.mark.parametrize(
    ("words", "view"),
    [
        (["--system", "published", "--vary", "young=0.25 MPa"], View({"young": 250.0}, ((4.0,), (2.4,)))),
        (
            ["--system", str(THUMB), "--vary", "rods.sleeve.young=250 kPa"],
            View({"rods.sleeve.young": 250.0}, ((4.0,), (2.4,))),
        ),
    ],
    ids=["published", "thumb"],
)
def test_the_command_writes_the_files_of_a_view(
    tmp_path: Path, words: list[str], view: View, request: pytest.FixtureRequest
) -> None:
    lab: LabSystem = request.getfixturevalue("thumb" if str(THUMB) in words else "lab")
    main(["lab", "--drive", "4", "2.4", *words, "--out", str(tmp_path / "view")])
    seen = compute_view(view, lab)
    image = cv2.imread(str(tmp_path / "view" / "picture.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, seen.image)
    rows = read_rows(tmp_path / "view" / "readings.csv")[1:]
    assert [row[:2] for row in rows] == [[sensor.name, sensor.unit] for sensor in lab.schema.sensors]
    assert [float(row[2]) for row in rows] == pytest.approx(seen.observation.readings.tolist(), abs=1e-6)
    assert [row[0] for row in rows if row[3]] == (
        list(lab.schema.controllable) if lab.refusal is None else []
    )
    assert read_rows(tmp_path / "view" / "path.csv")[0] == ["u [N]", "F_net [N]", "way"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--vary", "family=cube"], "design.family: expected one of linear, sine, "),
        (["--drive", "9"], "drive.0.u: expected 0 to 4 N, got 9"),
        (["--vary", "r0=1 mm"], "design.r0: expected 4 to 10 mm, got 1"),
        (["--system", "none"], "system: expected published, index, index-friction or a file"),
        (["--vary", "a=1"], "vary: expected ENTRY=VALUE, where ENTRY is family, length, "),
        (["--system", str(THUMB), "--vary", "gap=1 mm"], "vary: expected ENTRY=VALUE, where ENTRY is rods."),
        (["--system", str(THUMB), "--vary", "rods.sleeve.young=1 mm"], "young: expected a value in kPa"),
        (["--system", str(THUMB), "--vary", "rods.sleeve.young=1 kPa"], "young: expected 200 to 400 kPa"),
        (["--system", str(THUMB), "--drive", "-1.5"], "drive.0.u: expected -1 to 4 N"),
    ],
)  # fmt: skip
def test_options_that_do_not_fit_are_refused_in_one_sentence(
    capsys: pytest.CaptureFixture[str], words: list[str], sentence: str
) -> None:
    with pytest.raises(SystemExit) as end:
        main(["lab", *words, "--no-browser"])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert sentence in said


@pytest.mark.parametrize("shift", np.arange(-0.2, 0.21, 0.05))
def test_a_body_that_leaves_the_image_is_noted(shift: float, lab: LabSystem) -> None:
    seen = compute_view(View(drive=((2.4,),), camera=CameraSettings(shift_x=float(shift))), lab)
    border = np.concatenate([seen.image[0], seen.image[-1], seen.image[:, 0], seen.image[:, -1]])
    noted = any("outside the camera image" in note for note in seen.notes)
    assert noted == bool((border != BACKGROUND).any())


def test_a_pose_is_saved_with_the_positions_and_radii_of_its_nodes(lab: LabSystem) -> None:
    seen = compute_view(lab.start, lab)
    head, *rows = (line.split(",") for line in pose_csv(seen).splitlines())
    assert head == ["tube", "node", "x [m]", "y [m]", "z [m]", "radius [m]"]
    for tube in seen.system.tubes:
        own = np.array([row[1:] for row in rows if row[0] == tube.name], float)
        np.testing.assert_array_equal(own[:, 0], np.arange(len(tube.radius)))
        # Six digits are written.
        np.testing.assert_allclose(own[:, 1:4], seen.observation.axes[tube.name], rtol=1e-5, atol=1e-12)
        np.testing.assert_allclose(own[:, 4], tube.radius, rtol=1e-5)
