import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from exosight.errors import InputError
from exosight.system.camera import project_spheres
from exosight.vision import Camera, project, resized

sides = st.integers(1, 4096)


def test_centre_of_view_is_centre_of_image():
    camera = Camera(centre=(0.02, -0.01), metres_per_pixel=0.001, width=60, height=40)
    np.testing.assert_allclose(project(camera, np.array([0.02, 5.0, -0.01])), [30, 20])


def test_x_runs_right_and_z_runs_up_by_one_pixel_a_scale_step():
    camera = Camera(centre=(0.0, 0.0), metres_per_pixel=0.002, width=10, height=10)
    np.testing.assert_allclose(project(camera, np.array([[0.002, 0, 0], [0, 0, 0.002]])), [[6, 5], [5, 4]])


def test_depth_does_not_matter():
    points = np.random.default_rng(0).normal(size=(7, 3))
    np.testing.assert_array_equal(project(Camera(), points), project(Camera(), points * [1, 0, 1]))


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_batch_matches_loop(batch):
    points = np.random.default_rng(1).normal(size=(*batch, 3))
    together = project(Camera(), points)
    assert together.shape == (*batch, 2)
    for index in np.ndindex(*batch):
        np.testing.assert_array_equal(together[index], project(Camera(), points[index]))


@given(sides, sides, sides, sides)
def test_resizing_keeps_all_that_was_visible_and_wastes_nothing(old_width, old_height, width, height):
    old = Camera(width=old_width, height=old_height, metres_per_pixel=0.0011)
    new = resized(old, width, height)
    assert (new.width, new.height, new.centre) == (width, height, old.centre)
    growth = np.array([width / old_width, height / old_height]) * new.metres_per_pixel / old.metres_per_pixel
    assert min(growth) == pytest.approx(1)  # one side of the field of view stays, the other never shrinks


def test_resizing_with_one_aspect_ratio_scales_pixel_coordinates():
    points = np.random.default_rng(2).normal(size=(5, 3))
    np.testing.assert_allclose(project(resized(Camera(), 512, 512), points), 4 * project(Camera(), points))


@pytest.mark.parametrize("size", [(0, 10), (10, -1), (10, 10**6)])
def test_impossible_size_is_refused(size):
    with pytest.raises(InputError, match="pixels"):
        resized(Camera(), *size)


@pytest.mark.parametrize(
    "wrong",
    [
        {"metres_per_pixel": 0.0},
        {"metres_per_pixel": float("nan")},
        {"width": 0},
        {"height": 2.5},
        {"centre": (float("inf"), 0.0)},
        {"centre": (0.0,)},
    ],
)
def test_impossible_camera_is_refused(wrong):
    with pytest.raises(ValidationError):
        Camera(**wrong)


def test_camera_cannot_change():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Camera().width = 5


PINHOLE = Camera(
    distance=0.3,
    pan=0.12,
    tilt=-0.2,
    roll=0.3,
    distortion=-0.05,
    principal=(9.0, -4.0),
    width=320,
    height=240,
)


def in_view(count, seed=0):
    """Points within ± 6 cm of what the camera looks at, in all directions [m]."""
    x, z = PINHOLE.centre
    return np.random.default_rng(seed).uniform(-0.06, 0.06, (count, 3)) + np.array([x, 0, z])


def test_pinhole_agrees_with_opencv():
    assert PINHOLE.distance
    focal_length = PINHOLE.distance / PINHOLE.metres_per_pixel
    middle = np.array([[focal_length, 0, 169], [0, focal_length, 116], [0, 0, 1]])
    target = np.array([PINHOLE.centre[0], 0, PINHOLE.centre[1]])
    moved = np.array([0, 0, PINHOLE.distance]) - PINHOLE.rotation @ target
    turned, _ = cv2.Rodrigues(PINHOLE.rotation)
    lens = np.array([PINHOLE.lens, 0, 0, 0])
    expected, _ = cv2.projectPoints(in_view(50), turned, moved, middle, lens)
    # Rodrigues' vector is found by an iteration to single precision's square root: 1e-9 rad of 300 pixels.
    np.testing.assert_allclose(project(PINHOLE, in_view(50)), expected[:, 0], atol=1e-5)


def test_pinhole_straight_ahead_scales_with_depth():
    camera = dataclasses.replace(Camera(), distance=0.5)
    x, z = camera.centre
    points = np.array([[x + 0.02, 0.25, z + 0.01], [x, -0.25, z], [x + 0.02, 0.0, z]])
    focal_length = 0.5 / 0.0011
    expected = 64 + focal_length * np.array([[0.02 / 0.75, -0.01 / 0.75], [0, 0], [0.02 / 0.5, 0]])
    np.testing.assert_allclose(project(camera, points), expected)


def test_pinhole_sees_its_centre_at_the_principal_point_whatever_its_direction():
    x, z = PINHOLE.centre
    np.testing.assert_allclose(project(PINHOLE, np.array([x, 0.0, z])), [169, 116], atol=1e-9)


def test_resized_pinhole_scales_pixel_coordinates():
    points = in_view(20)
    np.testing.assert_allclose(project(resized(PINHOLE, 640, 480), points), 2 * project(PINHOLE, points))


def test_corner_moves_by_the_distortion():
    straight = dataclasses.replace(Camera(), distance=0.4)
    bent = dataclasses.replace(straight, distortion=0.1)
    x, z = straight.centre
    half = 64 * straight.metres_per_pixel
    corner = np.array([x + half, 0.0, z - half])
    np.testing.assert_allclose(project(bent, corner) - 64, 1.1 * (project(straight, corner) - 64))


@pytest.mark.parametrize("far", [10.0, 100.0])
def test_pinhole_far_away_is_orthographic(far):
    camera = Camera(roll=0.4)
    points = in_view(40)
    away = project(dataclasses.replace(camera, distance=far), points) - project(camera, points)
    # A point at depth y appears smaller by y/(distance + y): of some 90 pixels at most, 6 cm away.
    assert 0 < np.abs(away).max() < 90 * 0.06 / (far - 0.06)


@given(st.floats(-0.2, 0.2), st.floats(0.002, 0.02), st.floats(-0.3, 0.3))
def test_sphere_on_the_axis_is_seen_under_its_tangents(depth, radius, tilt):
    camera = Camera(distance=0.5, tilt=tilt)
    view = camera.rotation[2]
    at = np.array([camera.centre[0], 0, camera.centre[1]]) + depth * view
    (column, row, away), size = project_spheres(camera, at, np.array(radius))
    angle = np.arcsin(radius / (0.5 + depth))
    assert size == pytest.approx(0.5 / 0.0011 * np.tan(angle))
    assert (column, row) == pytest.approx((64, 64))
    assert 0.5 * np.expm1(away * 0.0011 / 0.5) == pytest.approx(depth, abs=1e-12)  # rounding of some metres


def test_depth_and_picture_have_one_scale():
    """Small steps in any direction at any depth are as long in pixels."""
    camera = Camera(distance=0.3)
    for depth in (-0.1, 0.0, 0.1):
        at = np.array([camera.centre[0], depth, camera.centre[1]])
        step = 1e-6
        nodes, _ = project_spheres(camera, at + np.vstack([np.zeros(3), step * np.eye(3)]), np.full(4, 0.001))
        lengths = np.linalg.norm(nodes[1:] - nodes[0], axis=1)
        np.testing.assert_allclose(lengths, lengths[0], rtol=1e-5)  # of second order in the step over 0.2 m


@pytest.mark.parametrize(
    "wrong", [{"tilt": 0.1}, {"pan": 0.1}, {"distortion": 0.1}, {"principal": (1, 0)}, {"distance": 0.001}]
)
def test_pinhole_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValidationError):
        Camera(**wrong)


def test_orthographic_camera_is_written_as_before():
    values = TypeAdapter(Camera).dump_python(Camera(), mode="json")
    assert set(values) == {"centre", "metres_per_pixel", "width", "height", "roll"}
    assert TypeAdapter(Camera).validate_python(TypeAdapter(Camera).dump_python(PINHOLE)) == PINHOLE
