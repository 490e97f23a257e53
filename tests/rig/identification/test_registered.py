"""Where a camera is, from one picture of the lever at rest, against the camera that took it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w
from pictured_rig import UNCERTAIN, scaled, vary

from exosight.app.main import main
from exosight.rig.calibrated_camera import with_camera
from exosight.rig.identification.outlines import outline_of_picture
from exosight.rig.identification.registered import register
from exosight.rig.identification.response import at_rest
from exosight.system.build import build
from exosight.system.camera import Camera, project
from exosight.system.file import Values, describe, read_system_file, replaced
from exosight.system.observation import body_axes
from exosight.vision.scene import picture

CAMERA = Camera(
    centre=(0.035, 0.0),
    metres_per_pixel=0.001,
    width=112,
    height=96,
    distance=0.3,
    pan=0.1,
    tilt=-0.1,
    distortion=-0.03,
    principal=(3.0, -2.0),
)
BUMPED = replace(
    CAMERA, centre=(0.038, 0.002), metres_per_pixel=0.00104, distance=0.312, roll=0.07, pan=0.2, tilt=-0.05
)


@pytest.fixture(scope="module")
def known(lever: Values) -> Values:
    """The lever as an identification leaves it, seen by a pinhole."""
    return with_camera({**lever, "vary": vary()}, "side", CAMERA)


def pictured(values: Values, camera: Camera) -> np.ndarray:
    """A lever within the file's intervals, at rest."""
    random = np.random.default_rng(0)
    truth = {entry: scaled(entry, random.normal()) for entry in UNCERTAIN}
    system = replace(build(describe(replaced(values, truth))), cameras=(("side", camera),))
    axes = body_axes(system, at_rest(system)[None])
    return picture(system, {name: np.asarray(axis) for name, axis in axes.items()})[0]


def test_a_camera_that_stayed_is_said_to_have_stayed(known: Values) -> None:
    found = register(known, (outline_of_picture(pictured(known, CAMERA), (0.7, 0.25)),))
    assert not found.moved
    assert found.away < 0.2  # outlines are found to a few hundredths of a pixel; a longer link is beside it
    assert found.misfit < 0.2


def test_a_bumped_camera_is_found_from_one_picture(
    known: Values, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, file, out = tmp_path / "rest.png", tmp_path / "rig.toml", tmp_path / "moved.toml"
    cv2.imwrite(str(image), pictured(known, BUMPED))
    file.write_text(tomli_w.dumps(known))
    main(["calibrate", str(image), "--system", str(file), "--out", str(out)])
    shown = capsys.readouterr()
    assert "the camera has moved: the device at rest lies" in shown.err
    values = read_system_file(out)
    camera = build(describe(values)).camera
    # Bodies of 60 pixels, outlines to a few hundredths of one, a link that is known to 1 %.
    assert camera.centre == pytest.approx(BUMPED.centre, abs=2e-4)
    assert camera.metres_per_pixel == pytest.approx(BUMPED.metres_per_pixel, rel=5e-3)
    assert camera.roll == pytest.approx(BUMPED.roll, abs=5e-3)
    # What direction changes: of 60 pixels 100 mm wide at 300 mm, an angle's third, so 0.02 rad 0.4 pixels.
    assert (camera.pan, camera.tilt) == pytest.approx((BUMPED.pan, BUMPED.tilt), abs=0.02)
    # The lens stays, and all else in the file.
    assert camera.distance is not None
    assert camera.distance / camera.metres_per_pixel == pytest.approx(300)
    assert (camera.principal, camera.distortion) == (CAMERA.principal, CAMERA.distortion)
    assert {**values, "cameras": {}} == {**known, "cameras": {}}
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.06, 0.0, 0.016]])
    np.testing.assert_allclose(project(camera, points), project(BUMPED, points), atol=0.3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--plane", "a.png"], "--plane: an option of boards; give --board"),
        (["--board", "8", "6"], "--square: expected the side of the board's squares"),
        (
            ["--board", "8", "6", "--square", "0.02", "--masks"],
            "--masks: an option of pictures of the device",
        ),
        (["--board", "8", "6", "--square", "0.02", "--corner", "0", "0", "0"], "--corner: it has an effect"),
        (["--out", "rig.txt"], "--out: expected a file *.toml"),
    ],
)
def test_options_that_do_not_fit_each_other_are_refused(
    options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", "pictures", "--system", "rig.toml", *options])
    assert said in capsys.readouterr().err
