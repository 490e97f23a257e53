"""Another camera's view: what each part does to points in closed form, and pictures that agree with them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.vision import BACKGROUND, Camera, Tube, augment, project, render, transformed_points
from exosight.vision.view import DISTANCE, homographies

W, H = 128, 96
MIDDLE = np.array([W, H]) / 2
POINTS = np.random.default_rng(0).uniform((0, 0), (W, H), (1, 40, 2))
ROUND_OFF = 1e-10  # pixels; a few operations on numbers of some hundreds

angles = st.floats(-3, 3)


@given(angles)
def test_roll_turns_points_about_the_middle(plain, angle: float) -> None:
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    found = transformed_points(plain(1, roll=angle).columns, POINTS, W, H)
    np.testing.assert_allclose(found, (POINTS - MIDDLE) @ turn + MIDDLE, atol=ROUND_OFF)


def test_a_positive_roll_is_clockwise(plain) -> None:
    right = np.array([[[MIDDLE[0] + 10, MIDDLE[1]]]])
    below = transformed_points(plain(1, roll=np.pi / 2).columns, right, W, H)[0, 0]
    np.testing.assert_allclose(below, MIDDLE + np.array([0, 10]), atol=ROUND_OFF)  # rows grow downwards


@given(st.floats(0.5, 2), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_zoom_enlarges_and_shift_moves_by_shares_of_the_sides(plain, zoom, x, y) -> None:
    found = transformed_points(plain(1, zoom=zoom, shift_x=x, shift_y=y).columns, POINTS, W, H)
    np.testing.assert_allclose(found, zoom * (POINTS - MIDDLE) + MIDDLE + [x * W, y * H], atol=ROUND_OFF)


@given(st.floats(-0.7, 0.7))
def test_tilt_is_a_pinhole_cameras_view_of_a_turned_plane(plain, tilt: float) -> None:
    """A point y below the middle is seen at y cos t · D/(D + y sin t)."""
    d = POINTS - MIDDLE
    far = DISTANCE * W
    for name, one, other in (("tilt_x", 1, 0), ("tilt_y", 0, 1)):
        found = transformed_points(plain(1, **{name: tilt}).columns, POINTS, W, H) - MIDDLE
        nearness = far / (far + d[..., one] * np.sin(tilt))
        np.testing.assert_allclose(found[..., one], d[..., one] * np.cos(tilt) * nearness, atol=ROUND_OFF)
        np.testing.assert_allclose(found[..., other], d[..., other] * nearness, atol=ROUND_OFF)


@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), angles)
def test_a_camera_without_a_lens_keeps_lines_straight(plain, tilt_x, tilt_y, roll) -> None:
    line = np.array([20.0, 15.0]) + np.linspace(0, 1, 7)[:, None] * np.array([70.0, 55.0])
    found = transformed_points(plain(1, tilt_x=tilt_x, tilt_y=tilt_y, roll=roll).columns, line[None], W, H)[0]
    along = (found - found[0]) / np.linalg.norm(found[-1] - found[0])
    assert np.abs(along[:, 0] * along[-1, 1] - along[:, 1] * along[-1, 0]).max() < 1e-12  # round-off


@given(st.floats(-0.2, 0.2))
def test_distortion_leaves_the_middle_and_all_directions(plain, k: float) -> None:
    inner = MIDDLE + 0.8 * (POINTS - MIDDLE)  # pincushions push what is farther out of sight
    found = (
        transformed_points(
            plain(1, distortion=k).columns, np.concatenate([inner, MIDDLE[None, None]], axis=1), W, H
        )[0]
        - MIDDLE
    )
    np.testing.assert_allclose(found[-1], 0, atol=ROUND_OFF)
    d = (inner - MIDDLE)[0]
    np.testing.assert_allclose(found[:-1, 0] * d[:, 1], found[:-1, 1] * d[:, 0], atol=1e-8)  # of 1e4 pixels²
    # The division model, source above `exosight.vision.view`: undistorted = distorted / (1 + k r²).
    r = np.linalg.norm(found[:-1], axis=1) / np.linalg.norm(MIDDLE)
    np.testing.assert_allclose(found[:-1] / (1 + k * r[:, None] ** 2), d, atol=1e-8)


def test_a_pincushion_enlarges_towards_the_corners_and_a_barrel_shrinks(plain) -> None:
    d = 0.7 * (POINTS - MIDDLE)
    for k, sign in ((0.1, 1), (-0.1, -1)):
        found = transformed_points(plain(1, distortion=k).columns, MIDDLE + d, W, H) - MIDDLE
        gain = np.linalg.norm(found, axis=-1) / np.linalg.norm(d, axis=-1)
        order = np.argsort(np.linalg.norm(d, axis=-1)[0])
        assert np.all(np.diff(sign * gain[0, order]) > 0)


def test_homographies_of_nothing_are_the_identity(plain) -> None:
    np.testing.assert_array_equal(homographies(plain(2).columns, W, H), np.tile(np.eye(3), (2, 1, 1)))


views = st.fixed_dictionaries(
    {
        "roll": st.floats(-1, 1),
        "zoom": st.floats(0.8, 1.2),
        "tilt_x": st.floats(-0.4, 0.4),
        "tilt_y": st.floats(-0.4, 0.4),
        "shift_x": st.floats(-0.1, 0.1),
        "shift_y": st.floats(-0.1, 0.1),
        "distortion": st.floats(-0.15, 0.15),
    }
)


@settings(deadline=None, max_examples=25)
@given(views, st.floats(-20, 20), st.floats(-15, 15))
def test_pictures_move_as_their_points_do(plain, view: dict, x: float, z: float) -> None:
    """A ball's picture has its centre of mass where the ball's centre is seen."""
    camera = Camera(centre=(0.0, 0.0), metres_per_pixel=1.0, width=W, height=H)
    centre = np.array([[[x, 0.0, z]] * 2])
    picture = render([Tube(centre, np.full((1, 2), 4.0), 0.0)], camera)
    appearance = plain(1, **view)
    weight = BACKGROUND - augment(picture, appearance)[0].astype(float)
    columns, rows = np.meshgrid(np.arange(W) + 0.5, np.arange(H) + 0.5)
    found = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
    # A ball of four pixels is seen as something that is not quite round: a tenth of a pixel at this tilt.
    np.testing.assert_allclose(
        found, transformed_points(appearance.columns, project(camera, centre[:, :1]), W, H)[0, 0], atol=0.15
    )


def test_a_turned_scene_is_a_turned_picture(clean, plain) -> None:
    """A quarter turn hits pixel centres, so nothing is interpolated but round-off."""
    turned = augment(clean, plain(len(clean), roll=np.pi / 2))
    assert np.abs(turned.astype(int) - np.rot90(clean, -1, axes=(1, 2))).max() <= 1


def test_what_lies_beyond_the_border_goes_on_as_it_ends(clean, plain) -> None:
    shifted = augment(clean, plain(len(clean), shift_x=0.25))
    assert np.abs(shifted[:, :, 32:].astype(int) - clean[:, :, :-32]).max() <= 1
    np.testing.assert_array_equal(shifted[:, :, :32], np.repeat(shifted[:, :, 32:33], 32, axis=2))


def test_bodies_keep_their_size_when_the_camera_turns_and_shifts(clean, plain) -> None:
    appearance = plain(len(clean), roll=0.3, shift_x=0.02)
    before = (BACKGROUND - clean.astype(float)).sum(axis=(1, 2))
    after = (BACKGROUND - augment(clean, appearance).astype(float)).sum(axis=(1, 2))
    np.testing.assert_allclose(after, before, rtol=0.01)  # interpolation rounds each pixel to whole grays
