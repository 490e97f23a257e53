import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from exosight.errors import InputError
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
