"""The surface nearest to the camera is seen, and bodies that pass into each other share one boundary."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tubes import CAMERA, SCALE, assert_alike, coverage, curl, tube

from exosight.vision import BACKGROUND, Light, Tube, render, resized

EVEN = Light(np.array([[0.0, 0.0, 1.0]]), np.array([1.0]))
"""A light in which every surface is as light as its shade."""
UNSEEN = BACKGROUND / 255
"""The shade of a tube that looks like the background in it, and still hides what is behind it."""


def body(nodes, radii, shade=0.0) -> Tube:
    """One frame from nodes (x, depth, z) and radii, all in pixels of CAMERA from its centre."""
    return Tube(np.asarray(nodes, float)[None] * SCALE, np.asarray(radii, float)[None] * SCALE, shade)


def bar(z: float, radius: float, shade: float = 0.0, depth: float = 0.0) -> Tube:
    """A horizontal tube whose ends lie outside the picture."""
    return body([[-100, depth, z], [100, depth, z]], [radius, radius], shade)


def height(*bodies: Tube) -> np.ndarray:
    """How much of each column black tubes cover [pixels]."""
    return coverage(render(bodies, CAMERA, EVEN)[0]).sum(axis=0)


coordinate = st.floats(-25, 25)
radius = st.floats(1.5, 8)
straight = st.tuples(*[coordinate] * 6, radius, radius).map(lambda x: body([x[:3], x[3:6]], x[6:], shade=0.3))


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearer_of_two_crossing_tubes_is_seen_whole(order):
    far = body([[-20, 3, 0], [20, 3, 0]], [9, 9], 0.9)
    near = body([[0, -10, -20], [0, -10, 20]], [3, 3], 0.3)
    image, alone = (render(bodies, CAMERA)[0] for bodies in ([far, near][::order], [near]))
    inside = np.abs(np.arange(64) + 0.5 - 32) < 2.5
    np.testing.assert_array_equal(image[:, inside], alone[:, inside])
    np.testing.assert_array_equal(image[:, :28], render([far], CAMERA)[0, :, :28])


def test_a_tube_before_another_keeps_its_soft_edges():
    # Edges fall on pixels' middles: half of the pixel is the one in front, half the one behind it.
    image = render([bar(0, 9, 0.8), bar(0.5, 3, 0.2, depth=-20)], CAMERA, EVEN)[0]
    np.testing.assert_array_equal(image[24 - 4, :], round(255 * (0.8 + 0.2) / 2))
    np.testing.assert_array_equal(image[24 + 2, :], round(255 * (0.8 + 0.2) / 2))


@given(radius, radius, st.floats(0, 0.5), st.floats(-7, -6))
@settings(max_examples=40, deadline=None)
def test_tubes_that_overlap_end_at_the_plane_of_equal_power(r, s, depth, place):
    apart = r + s - depth * min(r, s)
    own = (apart**2 + r**2 - s**2) / (2 * apart)  # from the axis to the boundary
    seen = height(bar(place, r), bar(place + apart, s, UNSEEN))
    # A gray is rounded in each of the two rows that hold an edge.
    assert seen == pytest.approx(np.full(64, r + own), abs=2 / 235)
    # Both together cover what they cover as one, and no pixel between them shows the background.
    assert height(bar(place, r), bar(place + apart, s)) == pytest.approx(
        np.full(64, r + s + apart), abs=2 / 235
    )


def test_boundary_is_in_the_middle_however_deep_the_overlap():
    """Of two equal tubes moved into each other, each loses half of the overlap, whichever is named first."""
    for overlap in (0.0, 0.3, 1.0, 2.0):
        z = 5 - overlap / 2
        upper, lower = render([bar(z, 5, 0.8), bar(-z, 5, 0.2)], CAMERA, EVEN)[0, [23, 24], 0]
        assert (upper, lower) == (204, 51)  # 255 times the shade: nothing of the other one


def test_area_of_two_spheres_that_overlap_does_not_depend_on_which_is_seen():
    r, s, apart = 9.3, 6.1, 13.0
    a = (apart**2 + r**2 - s**2) / (2 * apart)
    own = np.pi * r**2 - r**2 * np.arccos(a / r) + a * np.sqrt(r**2 - a**2)  # without its circular segment
    for angle in (0.0, 0.4, 1.1):
        at = apart * np.array([np.cos(angle), 0.0, np.sin(angle)]) - [5, 0, 2]
        balls = [([-5, 0, -2], r), (at, s)]
        seen = height(
            *(
                body([place, place], [q, q], shade)
                for (place, q), shade in zip(balls, (0.0, UNSEEN), strict=True)
            )
        )
        assert seen.sum() == pytest.approx(own, rel=0.005)  # as for the area of one tube


def test_a_rod_on_itself_is_seen_as_two_rods():
    bend = np.linspace(-np.pi / 2, np.pi / 2, 24)
    turn = np.stack([20 + 5.5 * np.cos(bend), 5.5 * np.sin(bend)], axis=-1)
    rod = tube(np.r_[[[-100, -5.5]], turn, [[-100, 5.5]]], np.full(26, 6.0), 0.8)  # 1 pixel into itself
    image = render([rod], CAMERA)[0]
    assert_alike(image[:, :45], render([bar(-5.5, 6, 0.8), bar(5.5, 6, 0.8)], CAMERA)[0, :, :45])
    np.testing.assert_array_equal(render([rod], CAMERA, EVEN)[0, 14:34, :45], 204)  # no gap


@pytest.mark.parametrize("side", [1, -1])
def test_a_rod_before_itself_hides_its_rear(side):
    """A loop whose ends cross each other, one of them nearer to the camera."""
    ends = [[[-30, 8, -14], [0, 8, 0], [20, 4, 10]], [[20, -4, -10], [0, -8, 0], [-30, -8, 14]]]
    loop = body(np.concatenate(ends) * [1, side, 1], np.full(6, 4.0), 0.6)
    near = body(np.array(ends[side > 0]) * [1, side, 1], np.full(3, 4.0), 0.6)
    whole = np.s_[:, 10:40]  # columns left of where the loop turns
    alone = render([near], CAMERA)[0][whole]
    covered = render([near], CAMERA, EVEN)[0][whole] == round(255 * 0.6)
    assert_alike(render([loop], CAMERA)[0][whole][covered], alone[covered])


def test_the_nearest_surface_is_seen_wherever_there_is_no_doubt():
    """Against all spheres along two tubes of random nodes: who is in front, a pixel from any boundary."""
    rng = np.random.default_rng(0)
    columns, rows = np.meshgrid(np.arange(64) + 0.5 - 32, 24 - (np.arange(48) + 0.5))
    pixels = 0
    for _ in range(12):
        both = [(rng.uniform(-18, 18, (n, 3)), rng.uniform(2, 9, n)) for n in rng.integers(2, 6, 2)]
        front = np.full((2, 48, 64), 1e3)
        for found, (nodes, radii) in zip(front, both, strict=True):
            fine = np.linspace(0, len(nodes) - 1, 150 * (len(nodes) - 1) + 1)
            spheres = [np.interp(fine, np.arange(len(nodes)), values) for values in (*nodes.T, radii)]
            for x, y, z, r in zip(*spheres, strict=True):
                out = r**2 - (columns - x) ** 2 - (rows - z) ** 2
                np.minimum(found, np.where(out > 0, y - np.sqrt(np.abs(out)), 1e3), out=found)
        image = render([body(*both[0], 0.0), body(*both[1], 0.9)], CAMERA, EVEN)[0]
        first = np.where(front.min(axis=0) == 1e3, 2, np.argmin(front, axis=0))
        around = np.lib.stride_tricks.sliding_window_view(first, (3, 3))
        lead = np.abs(front[0] - front[1])[1:-1, 1:-1]
        clear = (around == around[..., 1:2, 1:2]).all(axis=(2, 3)) & ((lead > 2) | (around[..., 1, 1] == 2))
        expected = np.array([0, round(255 * 0.9), BACKGROUND])[first[1:-1, 1:-1]]
        assert_alike(image[1:-1, 1:-1][clear], expected[clear])
        pixels += np.count_nonzero(clear & (first[1:-1, 1:-1] < 2))
    assert pixels > 5000


@given(straight, straight)
@settings(max_examples=40, deadline=None)
def test_the_order_of_the_tubes_does_not_matter(one, other):
    assert_alike(render([one, other], CAMERA), render([other, one], CAMERA))


@given(straight, straight)
@settings(max_examples=40, deadline=None)
def test_mirrored_scene_is_mirrored_picture(one, other):
    mirror = [Tube(each.centres * [-1, 1, 1], each.radii, each.shade) for each in (one, other)]
    assert_alike(render([one, other], CAMERA)[..., ::-1], render(mirror, CAMERA))


@given(st.floats(-0.6, 0.6), st.floats(1, 4), st.floats(1, 4))
@settings(max_examples=40, deadline=None)
def test_both_orders_are_one_where_nothing_overlaps_in_the_picture(bend, r, s):
    along = np.linspace(-25, 25, 15)
    arc = np.stack([along, bend * along**2 / 50 + 15], axis=-1)
    bodies = [tube(arc, np.linspace(r, s, 15), 0.7), tube(arc - [0, 25], np.full(15, s), 0.35)]
    images = [render(bodies, CAMERA, visibility=order)[0] for order in ("depth", "stacked")]
    difference = np.abs(images[0].astype(int) - images[1])
    # Where a strand ends and the next begins the inner edge has a corner: two edges cross a pixel.
    assert np.count_nonzero(difference > 1) <= 12  # of some 500
    assert difference.max() <= 8


def test_a_rolled_up_rod_is_smooth():
    """Seen four times as finely and averaged: where it lies on itself, each pixel shows both its parts."""
    fine, coarse = (
        render([tube(*curl(), 0.7)], resized(CAMERA, 64 * scale, 48 * scale))[0] for scale in (4, 1)
    )
    difference = np.abs(fine.reshape(48, 4, 64, 4).mean(axis=(1, 3)) - coarse)
    assert difference.max() < 20  # 64 grays where the pixel shows the part that it is deepest in
