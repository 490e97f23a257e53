"""Cameras calibrated from drawn boards, against the cameras that they were drawn by."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.app.main import main
from exosight.errors import DataError, InputError
from exosight.rig.calibrated_camera import BOARD_IN_WORLD, placed, with_camera, with_lens
from exosight.rig.charuco import Board, Calibration, View, calibrate, find_board
from exosight.system.build import build
from exosight.system.camera import Camera, project
from exosight.system.file import describe, read_system_file

LEVER = Path(__file__).parent / "identification" / "lever.toml"
BOARD = Board((7, 5), 0.02, 0.015)
CORNER = (-0.035, 0.01, 0.045)
"""Where the first picture shows the board's upper left corner [m]."""
CAMERA = Camera(
    centre=(0.03, -0.005),
    metres_per_pixel=0.0006,
    width=336,
    height=288,
    distance=0.3,
    pan=0.1,
    tilt=-0.2,
    roll=0.15,
    distortion=-0.06,
    principal=(7.0, -4.0),
)
FOCAL_LENGTH = 0.3 / 0.0006


def in_plane(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Board to camera, where the board stands along the x–z plane with its corner at CORNER."""
    assert camera.distance
    turn = camera.rotation
    target = np.array([camera.centre[0], 0, camera.centre[1]])
    return turn @ BOARD_IN_WORLD, turn @ (CORNER - target) + [0, 0, camera.distance]


def places(count: int, turned: float = 0.5) -> list[tuple[np.ndarray, np.ndarray]]:
    """Board to camera, of boards about in the middle, the first in the x–z plane."""
    random, found = np.random.default_rng(0), [in_plane(CAMERA)]
    while len(found) < count:
        turn, _ = cv2.Rodrigues(random.uniform(-1, 1, 3) * [turned, turned, 0.2])
        middle = random.uniform([-0.02, -0.02, 0.3], [0.02, 0.02, 0.42])
        found.append((turn, middle - turn @ [0.07, 0.05, 0]))
    return found


def drawn(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """What CAMERA shows of the board: each pixel the mean of nine rays' grays."""
    columns, rows = BOARD.squares
    flat = BOARD.charuco().generateImage((32 * columns, 32 * rows), marginSize=0)
    size = np.array([CAMERA.width, CAMERA.height])
    across, down = np.meshgrid(*((np.arange(3 * side) + 0.5) / 3 for side in size))
    middle = size / 2 + CAMERA.principal
    matrix = np.array([[FOCAL_LENGTH, 0, middle[0]], [0, FOCAL_LENGTH, middle[1]], [0, 0, 1]])
    seen = np.stack([across.ravel(), down.ravel()], axis=1)[:, None]
    slopes = cv2.undistortPoints(seen, matrix, np.array([CAMERA.lens, 0, 0, 0]))[:, 0]
    rays, pinhole = np.column_stack([slopes, np.ones(len(slopes))]) @ turn, -turn.T @ shift
    at = pinhole - pinhole[2] / rays[:, 2:] * rays
    x, y = (32 / BOARD.square * at[:, :2].T - 0.5).astype(np.float32).reshape(2, *across.shape)
    fine = cv2.remap(flat, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255)
    return cv2.resize(fine, size.tolist(), interpolation=cv2.INTER_AREA)


def seen(turn: np.ndarray, shift: np.ndarray) -> View:
    """The corners as CAMERA shows them, without a picture."""
    at = BOARD.charuco().getChessboardCorners() @ turn.T + shift
    slopes = at[:, :2] / at[:, 2:]
    bent = 1 + CAMERA.lens * np.sum(slopes**2, axis=1, keepdims=True)
    middle = np.array([CAMERA.width, CAMERA.height]) / 2 + CAMERA.principal
    return View("view", np.arange(len(at)), middle + FOCAL_LENGTH * bent * slopes)


SIZE = CAMERA.width, CAMERA.height


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    return [drawn(*place) for place in places(9)]


def test_the_camera_of_drawn_boards_is_found(pictures):
    views = [view for view in (find_board(each, BOARD, "board") for each in pictures) if view]
    assert len(views) == 9
    found = calibrate(views, BOARD, SIZE)
    # OpenCV finds corners of squares 25 pixels wide to about a tenth of a pixel.
    assert found.error < 0.3
    true = {"focal_length": FOCAL_LENGTH, "radial": CAMERA.lens}
    for name, value in true.items():
        at, deviation = getattr(found, name)
        # Within four deviations, of which the corners' errors, alike in neighbouring views, may need more
        # than independent ones would: and these are small.
        assert abs(at - value) < 4 * deviation, name
    assert found.focal_length[1] < 0.01 * FOCAL_LENGTH
    np.testing.assert_array_less(np.abs(found.principal[0] - [175, 140]), 4 * found.principal[1])
    camera = placed(with_lens(CAMERA, found), found.rotations[0], found.translations[0], CORNER)
    points = np.random.default_rng(1).uniform([-0.03, -0.01, -0.05], [0.09, 0.01, 0.04], (100, 3))
    # In the plane of the board all errors of the lens and the place cancel but for the corners' own.
    np.testing.assert_allclose(project(camera, points), project(CAMERA, points), atol=0.3)


def test_exact_corners_give_the_exact_lens():
    found = calibrate([seen(*place) for place in places(6)], BOARD, SIZE)
    # OpenCV takes corners in single precision: 2e-5 pixels of 300, enlarged by at most 100 in the lens.
    assert found.focal_length[0] == pytest.approx(FOCAL_LENGTH, rel=1e-5)
    assert found.radial[0] == pytest.approx(CAMERA.lens, rel=1e-3)
    np.testing.assert_allclose(found.principal[0], [175, 140], atol=2e-3)
    np.testing.assert_allclose(np.degrees(found.tilts)[0], np.degrees(np.hypot(0.1, 0.2)), atol=0.2)
    assert found.error < 1e-3


def exact() -> Calibration:
    """Of CAMERA, in the plane."""
    turn, shift = in_plane(CAMERA)
    return Calibration(
        size=SIZE,
        focal_length=(FOCAL_LENGTH, 1.0),
        principal=(np.array([175.0, 140.0]), np.ones(2)),
        radial=(CAMERA.lens, 0.1),
        rotations=turn[None],
        translations=shift[None],
        errors=np.zeros(1),
        error=0.0,
    )


angles = st.floats(-1.2, 1.2)


@given(angles, angles, st.floats(-3.1, 3.1), st.floats(0.05, 3), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_a_camera_is_placed_where_it_was(pan, tilt, roll, distance, x, z):
    there = dataclasses.replace(CAMERA, pan=pan, tilt=tilt, roll=roll, distance=distance, centre=(x, z))
    turn, shift = in_plane(there)
    found = placed(CAMERA, turn, shift, CORNER)
    for entry in ("pan", "tilt", "roll", "distance", "centre"):
        # Rounding, enlarged by 1/cos² of angles up to 1.2: some 1e-14.
        assert getattr(found, entry) == pytest.approx(getattr(there, entry), abs=1e-11), entry
    # The focal length is the lens's own, and stays.
    assert found.distance
    assert found.distance / found.metres_per_pixel == pytest.approx(FOCAL_LENGTH)


def test_a_cropped_camera_shows_the_same_part():
    points = np.random.default_rng(2).uniform([-0.02, -0.02, -0.05], [0.08, 0.02, 0.04], (50, 3))
    shown = dataclasses.replace(CAMERA, width=100, height=120, principal=(0.0, 0.0))
    found = exact()
    camera = placed(with_lens(shown, found, (80, 10, 200)), found.rotations[0], found.translations[0], CORNER)
    expected = (project(CAMERA, points) - [80, 10]) / 2
    np.testing.assert_allclose(project(camera, points), expected, atol=1e-9)


def test_without_a_place_the_picture_stays_but_for_the_lens():
    flat = Camera(centre=(0.02, 0.01), metres_per_pixel=0.0006, width=336, height=288, roll=0.7)
    straight = dataclasses.replace(exact(), radial=(0.0, 0.1))
    camera = with_lens(flat, straight)
    points = np.random.default_rng(3).uniform(-0.05, 0.05, (20, 3)) * [1, 0, 1]
    # A pinhole that looks along y shows the x–z plane as an orthographic camera does.
    np.testing.assert_allclose(project(camera, points), project(flat, points), atol=1e-9)


def test_pictures_that_tell_no_camera_are_refused(pictures):
    exactly = [seen(*place) for place in places(6)]
    with pytest.raises(DataError, match=r"5 or more that show a board of 7×5 squares.* got 4"):
        calibrate(exactly[:4], BOARD, SIZE)
    with pytest.raises(DataError, match=r"tilted by 10 degrees or more .* do not tell the focal length"):
        calibrate([seen(*place) for place in places(6, turned=0.0)[1:]], BOARD, SIZE)
    random = np.random.default_rng(0)
    shaken = [
        dataclasses.replace(view, corners=view.corners + random.normal(scale=4, size=view.corners.shape))
        for view in exactly
    ]
    with pytest.raises(DataError, match=r"got some \d.\d pixels away .* board's own size"):
        calibrate(shaken, BOARD, SIZE)
    with pytest.raises(DataError, match=r"expected markers 0 to 6 of a board of 5×3 squares.*, got 16"):
        find_board(pictures[0], Board((5, 3), 0.02, 0.015), "a.png")
    assert find_board(pictures[0], Board((5, 7), 0.02, 0.015), "a.png") is None
    assert find_board(np.full((288, 336), 200, np.uint8), BOARD, "a.png") is None
    with pytest.raises(InputError, match=r"dictionary of 77 markers or more .* got 50"):
        find_board(pictures[0], Board((14, 11), 0.02, 0.015), "a.png")
    with pytest.raises(InputError, match="camera before the x–z plane"):
        placed(CAMERA, np.eye(3) @ BOARD_IN_WORLD, np.array([0, 0, -0.3]), CORNER)
    with pytest.raises(InputError, match="aspect ratio of the system file's camera, 128×128 pixels"):
        with_lens(Camera(), exact())
    with pytest.raises(InputError, match="crop: expected a part of 300×300 pixels within 336×288"):
        with_lens(Camera(), exact(), (0, 0, 300))
    with pytest.raises(InputError, match="the calibrated camera: distortion"):
        with_lens(CAMERA, dataclasses.replace(exact(), radial=(3.0, 0.1)))


def test_a_file_has_the_camera_that_was_written():
    values = read_system_file(LEVER)
    camera = build(describe(with_camera(values, "side", CAMERA))).camera
    assert camera == CAMERA


def test_the_command_writes_a_system_file(pictures, tmp_path, capsys):
    folder = tmp_path / "boards"
    folder.mkdir()
    for number, picture in enumerate(pictures, 1):
        cv2.imwrite(str(folder / f"img_{number}.png"), picture)
    cv2.imwrite(str(folder / "img_10.png"), np.full(pictures[0].shape, 200, np.uint8))
    out = tmp_path / "rig.toml"
    options = ["calibrate", str(folder), "--board", "7", "5", "--square", "0.02", "--marker", "0.015"]
    options += ["--system", str(LEVER), "--plane", "img_1.png", "--corner", *map(str, CORNER)]
    main([*options, "--out", str(out)])
    shown = capsys.readouterr()
    assert "left out, as they do not show the board: img_10.png" in shown.err
    assert "focal length" in shown.out
    camera = build(describe(read_system_file(out))).camera
    # The file's camera has a third of the pictures' pixels.
    assert (camera.width, camera.height) == (112, 96)
    points = np.array([[0.0, 0.0, 0.0], [0.06, 0.0, 0.02]])
    np.testing.assert_allclose(project(camera, points), project(CAMERA, points) / 3, atol=0.1)
    cv2.imwrite(str(folder / "img_10.png"), np.full((288, 300), 200, np.uint8))
    with pytest.raises(SystemExit):
        main([*options, "--out", str(tmp_path / "other.toml")])
    assert "img_10.png: expected 336×288 pixels, as img_1.png has, got 300×288" in capsys.readouterr().err
