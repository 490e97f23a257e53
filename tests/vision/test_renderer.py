import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tubes import CAMERA, SCALE, assert_alike, coverage, curl, tube

import exosight
from exosight.errors import InputError
from exosight.vision import BACKGROUND, Camera, Tube, render, resized
from exosight.vision.renderer import AMBIENT


def hull_area(length: float, r: float, s: float) -> float:
    """Area of the convex hull of two discs, neither of which holds the other."""
    lean = np.arcsin((r - s) / length)
    return length * np.cos(lean) * (r + s) + r**2 * (np.pi / 2 + lean) + s**2 * (np.pi / 2 - lean)


stacked = partial(render, visibility="stacked")


@pytest.fixture(scope="module", params=[render, stacked], ids=["depth", "stacked"])
def draw(request) -> Callable:
    """Render in either order."""
    return request.param


pixels = st.floats(-60, 60)
bodies = st.lists(st.tuples(pixels, pixels, st.floats(1, 12)), min_size=2, max_size=6)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0, np.pi / 2])
@pytest.mark.parametrize(("r", "s"), [(6.0, 6.0), (9.3, 3.1), (4.0, 7.7)])
def test_area_is_that_of_the_hull_of_two_discs(draw, angle, r, s):
    ends = np.array([[-8.3, -7.2], [8.3, 7.2]]) * [[np.cos(angle), np.sin(angle)]]
    image = draw([tube(ends, [r, s])], CAMERA)[0]
    length = np.hypot(*(ends[1] - ends[0]))
    # Along the edge, coverage errs by up to 0.06 of a pixel, with a sign that alternates (measured: 0.3 %).
    assert coverage(image).sum() == pytest.approx(hull_area(length, r, s), rel=0.005)


def test_area_error_falls_with_resolution(draw):
    rng, r, s = np.random.default_rng(0), 8.1, 3.3
    errors = {1: [], 8: []}
    for _ in range(8):
        ends = np.array([[-10, -5], [10, 6]]) + rng.random((2, 2))
        for factor, found in errors.items():
            image = draw([tube(ends, [r, s])], resized(CAMERA, 64 * factor, 48 * factor))[0]
            found.append(coverage(image).sum() / factor**2 - hull_area(np.hypot(*(ends[1] - ends[0])), r, s))
    coarse, fine = (np.sqrt(np.mean(np.square(errors[factor]))) for factor in (1, 8))
    assert fine < coarse / 16  # between first order (8) and second order (64)


@pytest.mark.parametrize("r", [0.05, 0.2, 0.4, 0.7])
def test_tube_thinner_than_a_pixel_covers_its_own_width(draw, r):
    # Far ends lie outside the picture, so only the straight part counts. Half a gray is 1/470 of a pixel.
    image = draw([tube([[-100, 3.37], [100, 3.37]], [r, r])], CAMERA)[0]
    assert coverage(image).sum(axis=0) == pytest.approx(np.full(64, 2 * r), abs=2 / 470)


@given(bodies)
@settings(max_examples=20, deadline=None)
def test_picture_is_the_union_of_spheres_along_the_axis(nodes):
    nodes = np.array(nodes)
    image = stacked([tube(nodes[:, :2], nodes[:, 2])], CAMERA)[0]
    fine = np.linspace(0, len(nodes) - 1, 600 * (len(nodes) - 1) + 1)
    spheres = np.array([np.interp(fine, np.arange(len(nodes)), column) for column in nodes.T]).T
    columns, rows = np.meshgrid(np.arange(64) + 0.5 - 32, np.arange(48) + 0.5 - 24)
    nearest = np.full(columns.shape, np.inf)
    for x, z, r in spheres:
        np.minimum(nearest, np.hypot(columns - x, rows + z) - r, out=nearest)
    # The nearest sample lies up to h = 0.15 pixels beside the true sphere: h²/2 over half a pixel.
    # Then half a gray.
    assert np.abs(coverage(image) - np.clip(0.5 - nearest, 0, 1)).max() < 0.15**2 + 1 / 470


@given(bodies)
@settings(max_examples=20, deadline=None)
def test_mirrored_scene_is_mirrored_picture(nodes):
    nodes = np.array(nodes)
    image = stacked([tube(nodes[:, :2], nodes[:, 2], 0.5)], CAMERA)[0]
    mirrored = stacked([tube(nodes[:, :2] * [-1, 1], nodes[:, 2], 0.5)], CAMERA)[0]
    assert_alike(image[:, ::-1], mirrored)


@given(bodies)
@settings(max_examples=20, deadline=None)
def test_outline_is_symmetric_upside_down(nodes):
    nodes = np.array(nodes)
    image = stacked([tube(nodes[:, :2], nodes[:, 2])], CAMERA)[0]
    assert_alike(image[::-1], stacked([tube(nodes[:, :2] * [1, -1], nodes[:, 2])], CAMERA)[0])


@given(bodies)
@settings(max_examples=20, deadline=None)
def test_direction_of_the_axis_does_not_matter(nodes):
    nodes = np.array(nodes)
    image = stacked([tube(nodes[:, :2], nodes[:, 2])], CAMERA)[0]
    assert_alike(image, stacked([tube(nodes[::-1, :2], nodes[::-1, 2])], CAMERA)[0])


def test_shift_by_whole_pixels_shifts_the_picture(draw):
    nodes, radii = np.array([[-9.3, 2.1], [1.4, 6.7], [8.2, -3.3]]), [3.0, 4.5, 2.0]
    image = draw([tube(nodes, radii, 0.7)], CAMERA)[0]
    moved = draw([tube(nodes + np.array([5, -7]), radii, 0.7)], CAMERA)[0]
    assert_alike(np.roll(image, (7, 5), axis=(0, 1)), moved)


def test_averaged_fine_picture_is_the_coarse_picture(draw):
    bodies = [tube([[-20, -9], [0, -12], [14, -20]], [8, 5, 3], 0.7), tube(*curl(), 0.35)]
    coarse = draw(bodies, CAMERA)[0]
    fine = draw(bodies, resized(CAMERA, 128, 96))[0].reshape(48, 2, 64, 2).mean(axis=(1, 3))
    difference = np.abs(coarse - fine)
    assert np.sqrt(np.mean(difference**2)) < 2.5  # one gray in a hundred
    # Only in creases and in gaps narrower than a pixel do two edges share one; coarse pixels see the nearer.
    assert np.mean(difference > 8) < 0.01


def test_small_view_is_a_cut_out_of_a_large_one(draw):
    body = tube([[-40, -9], [0, -12], [34, -50]], [8, 5, 3], 0.7)
    large = draw([body], Camera(centre=(0.0, 0.0), metres_per_pixel=SCALE, width=128, height=128))[0]
    assert_alike(large[40:88, 32:96], draw([body], CAMERA)[0])


@pytest.mark.parametrize("shift", [[41, 0], [-41, 0], [0, 33], [0, -33], [1e8, 1e8]])
def test_tube_outside_the_picture_leaves_the_background(draw, shift):
    image = draw([tube(np.array([[-5, 0], [5, 0]]) * [0.8, 1] + shift, [4.4, 4.4])], CAMERA)[0]
    assert np.all(image == BACKGROUND)


@pytest.mark.parametrize("shift", [[40, 0], [-40, 0], [0, 28], [0, -28]])
def test_tube_that_touches_the_picture_shows(draw, shift):
    image = draw([tube(np.array([[-4, 0], [4, 0]]) + shift, [4.6, 4.6])], CAMERA)[0]
    assert np.any(image < BACKGROUND)


@given(
    st.lists(
        st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0, 1e6, exclude_min=True)),
        min_size=2,
        max_size=5,
    ),
    st.floats(0, 1),
)
@settings(max_examples=100, deadline=None)
def test_any_valid_tube_renders(draw, nodes, shade):
    nodes = np.array(nodes)
    centres = np.stack([nodes[:, 0], nodes[:, 0], nodes[:, 1]], axis=-1)
    image = draw([Tube(centres[None], nodes[None, :, 2], shade)], CAMERA)[0]
    lightest = max(BACKGROUND, int(255 * shade + 0.5))
    assert image.max() <= lightest
    assert image.min() >= min(BACKGROUND, int(255 * shade * AMBIENT))


def test_joints_leave_no_seam(draw):
    ends, radii = np.array([[-14.3, -5.1], [15.2, 6.4]]), np.array([8.0, 3.0])
    share = np.sort(np.r_[0, np.random.default_rng(0).random(40), 1])[:, None]
    many = tube(ends[0] + share * (ends[1] - ends[0]), radii[0] + share[:, 0] * (radii[1] - radii[0]), 0.7)
    assert_alike(draw([tube(ends, radii, 0.7)], CAMERA), draw([many], CAMERA))


def test_going_over_a_tube_twice_darkens_nothing():
    nodes, radii = curl()
    once = stacked([tube(nodes, radii, 0.6)], CAMERA)
    back = stacked([tube(np.r_[nodes, nodes[::-1]], np.r_[radii, radii[::-1]], 0.6)], CAMERA)
    assert_alike(once, back)


def test_coincident_nodes_draw_one_sphere(draw):
    image = draw([tube([[1.5, 2.5], [1.5, 2.5]], [6.0, 9.0])], CAMERA)[0]
    assert coverage(image).sum() == pytest.approx(np.pi * 81, rel=0.005)  # as for the other areas


def test_depth_along_the_view_does_not_matter():
    nodes, radii = curl()
    flat = tube(nodes, radii, 0.4)
    deep = Tube(flat.centres + np.linspace(0, 1, 42)[:, None] * [0, 1, 0], flat.radii, 0.4)
    np.testing.assert_array_equal(stacked([flat], CAMERA), stacked([deep], CAMERA))


def test_later_tube_hides_earlier_one():
    one, other = tube([[-20, 0], [20, 0]], [6, 6], 0.9), tube([[0, -20], [0, 20]], [6, 6], 0.3)
    alone = stacked([other], CAMERA)[0]
    both = stacked([one, other], CAMERA)[0]
    inside = np.abs(np.arange(64) + 0.5 - 32) < 5
    np.testing.assert_array_equal(both[:, inside], alone[:, inside])
    swapped = stacked([other, one], CAMERA)[0]
    np.testing.assert_array_equal(swapped[20:28], stacked([one], CAMERA)[0, 20:28])


def test_horizontal_tube_is_lit_like_a_cylinder(draw):
    r = 20.0
    column = draw([tube([[-100, 0], [100, 0]], [r, r], 0.8)], CAMERA)[0, :, 32]
    up = (24 - (np.arange(48) + 0.5)) / r
    inside = np.abs(up) < 0.97
    # Lambert: normal (up, towards the camera) times the direction of the lamp (0.6, 0.8).
    facing = np.maximum(0.6 * up + 0.8 * np.sqrt(np.maximum(1 - up**2, 0)), 0)
    expected = 255 * 0.8 * (AMBIENT + (1 - AMBIENT) * facing)
    assert np.abs(column[inside] - expected[inside]).max() <= 0.5 + 1e-9
    assert column[inside].max() in (203, 204)  # 255 × 0.8 where the surface faces the lamp


def test_frames_are_independent_and_threads_agree(draw):
    rng = np.random.default_rng(8)
    centres, radii = rng.normal(0, 0.02, (12, 5, 3)), rng.uniform(0.001, 0.006, (12, 5))
    together = draw([Tube(centres, radii, 0.4)], CAMERA)
    with ThreadPoolExecutor(4) as pool:
        alone = pool.map(
            lambda i: draw([Tube(centres[i : i + 1], radii[i : i + 1], 0.4)], CAMERA)[0], range(12)
        )
        np.testing.assert_array_equal(together, np.stack(list(alone)))


def test_no_frames_give_no_pictures(draw):
    assert draw([Tube(np.empty((0, 3, 3)), np.empty((0, 3)), 0.5)], CAMERA).shape == (0, 48, 64)


def test_single_precision_is_welcome(draw):
    body = tube(*curl(), 0.4)
    single = Tube(body.centres.astype(np.float32), body.radii.astype(np.float32), 0.4)
    assert_alike(draw([body], CAMERA), draw([single], CAMERA))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"centres": np.full((2, 3, 3), np.nan)}, "finite"),
        ({"centres": np.full((2, 3, 3), 1e7)}, "finite"),
        ({"centres": np.zeros((2, 1, 3)), "radii": np.ones((2, 1))}, "two nodes"),
        ({"centres": np.zeros((3, 3))}, "frames, nodes, 3"),
        ({"radii": np.ones((2, 4))}, "one per node"),
        ({"radii": np.zeros((2, 3))}, "positive"),
        ({"radii": np.full((2, 3), np.nan)}, "positive"),
        ({"radii": np.full((2, 3), np.inf)}, "positive"),
        ({"shade": 1.5}, "shade"),
        ({"shade": float("nan")}, "shade"),
    ],
)
def test_impossible_tube_is_refused_in_a_sentence(change, message, monkeypatch):
    # A user has no shape checks from the test set-up.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(InputError, match=message):
        Tube(**{"centres": np.zeros((2, 3, 3)), "radii": np.ones((2, 3)), "shade": 0.5, **change})


@pytest.mark.parametrize("frames", [[], [1, 2]])
def test_tubes_of_different_length_are_refused(frames):
    tubes = [Tube(np.zeros((n, 2, 3)), np.ones((n, 2)), 0.5) for n in frames]
    with pytest.raises(InputError, match="same number of frames"):
        render(tubes, CAMERA)


def test_renders_where_no_folder_can_be_written(tmp_path):
    shutil.copytree(
        Path(exosight.__file__).parent, tmp_path / "exosight", ignore=shutil.ignore_patterns("__pycache__")
    )
    (
        tmp_path / "exosight" / "vision" / "__pycache__"
    ).touch()  # a file in the way of the cache folder, even for root
    program = (
        "import numpy as np; from exosight.vision import *;"
        "print(render([Tube(np.zeros((1, 2, 3)), np.ones((1, 2)), 0.0)], Camera()).max())"
    )
    environment = {"PYTHONPATH": str(tmp_path), "HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", "")
