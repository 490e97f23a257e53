"""Outlines of drawn bodies, against the geometry that they were drawn from."""

from dataclasses import replace

import cv2
import jax
import numpy as np
import pytest

from exosight.errors import DataError
from exosight.rig.identification.distances import distances, projected, view_of
from exosight.rig.identification.outlines import UNKNOWN, Outline, outline_of_mask, outline_of_picture
from exosight.system.camera import Camera, project, project_spheres
from exosight.vision.renderer import Tube, render

CAMERA = Camera(centre=(0.0, 0.0), metres_per_pixel=0.001, width=128, height=96, roll=0.1)
PINHOLE = replace(CAMERA, distance=0.3, pan=0.2, tilt=-0.3, distortion=0.1, principal=(5.0, -3.0))
VIEW = view_of(CAMERA)
SHADES = (0.7, 0.3)
FINGER = np.array([[-0.04, 0.0, -0.008], [0.0, 0.0, -0.012], [0.04, 0.0, -0.024]]), [0.011, 0.008, 0.005]
ROD = np.array([[-0.04, 0.0, 0.009], [0.0, 0.0, 0.001], [0.03, 0.0, 0.01]]), [0.007, 0.006, 0.005]
"""They overlap by about a millimetre along their first parts."""


def tubes() -> list[Tube]:
    return [
        Tube(centres[None], np.array([radii]), shade)
        for (centres, radii), shade in zip((FINGER, ROD), SHADES, strict=True)
    ]


def off(outline: Outline) -> np.ndarray:
    """Distance of each point from the outline that was drawn [pixels]."""
    known = [projected(c, np.array(r), VIEW, (128, 96)) for c, r in (FINGER, ROD)]
    args = (outline.points, outline.inside, outline.outside, known, np.zeros(2), False)
    return np.asarray(distances(*args))


@pytest.mark.parametrize("camera", [CAMERA, PINHOLE])
def test_spheres_are_projected_as_the_camera_does(camera: Camera) -> None:
    centres, radii = ROD[0] + np.array([0.0, 0.02, 0.0]), np.array(ROD[1])
    found = projected(centres, radii, view_of(camera), (128, 96))
    seen, sizes = project_spheres(camera, centres, radii)
    np.testing.assert_allclose(found[0], seen[:, :2], atol=1e-10)
    np.testing.assert_allclose(found[1], sizes, atol=1e-10)


def test_outlines_of_a_picture_lie_within_a_tenth_of_a_pixel() -> None:
    found = outline_of_picture(render(tubes(), CAMERA)[0], SHADES)
    away = off(found)
    # Gray values of whole numbers and coverage that is linear over a pixel: a few hundredths.
    assert np.sqrt(np.mean(away**2)) < 0.08
    assert abs(away.mean()) < 0.02
    # Of about 350 pixels of edges, what lies where three things meet or two are close is left out.
    assert len(found.points) > 250
    assert set(zip(found.inside.tolist(), found.outside.tolist(), strict=True)) == {(0, -1), (1, -1), (0, 1)}


@pytest.mark.parametrize("radius", [4.0, 8.0])
def test_neither_side_of_a_body_is_found_outside_of_its_place(radius: float) -> None:
    """One is lit, the other in the shade; those of thin bodies were found 0.03 pixels too near each other."""
    along, across = np.array([0.94, 0.0, -0.342]), np.array([0.342, 0.0, 0.94])
    ends = np.array([[-0.04], [0.04]]) * along
    bodies = [(ends + 0.018 * across, 0.7), (ends - 0.018 * across, 0.35)]
    radii = np.full((1, 2), radius * CAMERA.metres_per_pixel)
    sides: dict[tuple[int, bool], list[float]] = {}
    for shift in np.random.default_rng(0).uniform(-0.0005, 0.0005, (12, 2)):
        camera = replace(CAMERA, centre=tuple(shift.tolist()), height=128)
        picture = render([Tube(c[None], radii, gray) for c, gray in bodies], camera)[0]
        found = outline_of_picture(picture, (0.7, 0.35))
        for body, (centres, _) in enumerate(bodies):
            start, end = project(camera, centres)
            way = (end - start) / np.linalg.norm(end - start)
            place, side = (found.points - start) @ way, (found.points - start) @ (way[1], -way[0])
            own = (found.inside == body) & (place > 4) & (place < np.linalg.norm(end - start) - 4)
            for upper in (False, True):
                away = np.abs(side[own & ((side > 0) == upper)]) - radius
                sides.setdefault((body, upper), []).append(away.mean())
    # Of 850 points each; single ones are off by some 0.05, and neighbours alike.
    assert all(abs(np.mean(means)) < 0.008 for means in sides.values()), sides


def test_outlines_of_a_blurred_noisy_picture_lie_within_a_tenth_of_a_pixel() -> None:
    """Grays of the dark rod's blurred edge are those of the brighter finger."""
    picture = cv2.GaussianBlur(render(tubes(), CAMERA)[0].astype(float), (0, 0), 0.5)
    noisy = picture + np.random.default_rng(0).normal(scale=2, size=picture.shape)
    found = outline_of_picture(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), SHADES)
    free = found.outside == -1
    away = off(found)[free]
    # Light that is lost beyond the ends of the profiles, and noise of a percent of the contrast.
    assert np.sqrt(np.mean(away**2)) < 0.09
    assert abs(away.mean()) < 0.05
    assert [int(np.sum(free & (found.inside == body))) > 100 for body in (0, 1)] == [True, True]


def test_outlines_of_a_mask_lie_within_half_a_pixel() -> None:
    finger, rod = (render([Tube(c[None], np.array([r]), 0.0)], CAMERA)[0] < 117 for c, r in (FINGER, ROD))
    mask = np.where(rod, 2, np.where(finger, 1, 0)).astype(np.uint8)
    mask[:, :30] = UNKNOWN
    found = outline_of_mask(mask, 2)
    assert found.points[:, 0].min() > 31  # nothing where the mask says that it does not know
    free = found.outside == -1
    # A pixel is all or nothing: its edge is off by up to half a pixel, 0.29 pixels in the mean of squares.
    assert np.sqrt(np.mean(off(found)[free] ** 2)) < 0.3


@pytest.mark.parametrize("camera", [CAMERA, PINHOLE])
def test_a_distance_moves_with_its_sphere(camera: Camera) -> None:
    points = np.array([[60.0, 20.0], [64.0, 70.0], [50.0, 44.0]])
    args = points, np.array([1, 0, 0]), np.array([-1, -1, 1])

    def found(view: np.ndarray) -> jax.Array:
        known = [projected(c, np.array(r), view, (128, 96)) for c, r in (FINGER, ROD)]
        return distances(*args, known, np.array([0.1, 0.2]), False)

    at = view_of(camera)
    slope, step = jax.jacfwd(found)(at), 1e-5
    for i in range(len(at)):
        move = np.eye(len(at))[i] * step * max(abs(at[i]), 1e-3)
        rise = (found(at + move) - found(at - move)) / (2 * move[i])
        # Central differences: steps of 1e-5 leave 1e-10 of second derivatives and 1e-9 of round-off.
        np.testing.assert_allclose(slope[:, i], rise, rtol=1e-6, atol=1e-6)


def test_pictures_without_the_device_are_refused() -> None:
    with pytest.raises(DataError, match="no pixel has the gray of body 1"):
        outline_of_picture(np.full((64, 64), 235, np.uint8), SHADES)
    with pytest.raises(DataError, match="background brighter than the device"):
        outline_of_picture(np.zeros((64, 64), np.uint8), SHADES)
    with pytest.raises(DataError, match="no pixel has the gray of body 2"):
        outline_of_picture(render(tubes()[:1], CAMERA)[0], SHADES)
    with pytest.raises(DataError, match="outline of body 1"):
        outline_of_mask(np.zeros((64, 64), np.uint8), 2)
    with pytest.raises(DataError, match="expected 0 for background, 1 to 2"):
        outline_of_mask(np.full((64, 64), 7, np.uint8), 2)
