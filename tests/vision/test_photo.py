import numpy as np
import pytest

from exosight.system.camera import Camera
from exosight.vision.clutter import backdrop, cable_mask, moved, polygon_mask, texture
from exosight.vision.holders import Piece, holders
from exosight.vision.photo import CLEAN, photo
from exosight.vision.renderer import Tube, render

CAMERA = Camera(centre=(0.05, 0.0), metres_per_pixel=0.0022, width=64, height=64)


def bodies(frames):
    """A straight finger and a rod above it that bends from frame to frame."""
    along = np.linspace(0, 1, 12)
    finger = np.tile([[0.0, 0, 0], [0.05, 0, 0], [0.09, 0, -0.01]], (frames, 1, 1))
    angle = np.linspace(0, 2, frames)[:, None] * along
    steps = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=-1) * 0.09 / 11
    rod = np.cumsum(steps, axis=1) + np.array([0, 0, 0.017])
    return [
        Tube(finger, np.tile([0.011, 0.007, 0.004], (frames, 1)), 0.7),
        Tube(rod, np.tile(0.006 - 0.002 * along, (frames, 1)), 0.35),
    ]


def pictures(seed, frames=6, which=None):
    numbers = np.arange(frames) if which is None else np.array(which)
    tubes = [Tube(tube.centres[numbers], tube.radii[numbers], tube.shade) for tube in bodies(frames)]
    return photo(tubes, CAMERA, render(tubes, CAMERA), seed, numbers)


def test_a_frame_depends_on_its_number_alone():
    together = pictures((3,))
    np.testing.assert_array_equal(together[[4, 1]], pictures((3,), which=[4, 1]))
    assert (together[1] != pictures((4,))[1]).mean() > 0.5


def test_some_frames_stay_clean_and_no_other_is_the_same():
    count = 300
    tubes = [
        Tube(np.repeat(t.centres[:1], count, 0), np.repeat(t.radii[:1], count, 0), t.shade) for t in bodies(1)
    ]
    clean = render(tubes, CAMERA)
    found = photo(tubes, CAMERA, clean, (0,), np.arange(count))
    same = (found == clean).all(axis=(1, 2))
    # Four standard deviations of a binomial distribution.
    assert same.mean() == pytest.approx(CLEAN, abs=4 * np.sqrt(CLEAN * (1 - CLEAN) / count))
    assert len(np.unique(found.reshape(count, -1), axis=0)) == count - same.sum() + 1
    # Grays spread over the whole range, from picture to picture and within one.
    assert found.mean(axis=(1, 2)).std() > 30
    assert np.median(found.std(axis=(1, 2))) > 20


def test_what_holds_a_body_hides_little_of_it():
    rng = np.random.default_rng(0)
    finger, rod = (Piece(tube.centres[0], tube.radii[0]) for tube in bodies(1))
    alone = Tube(rod.centres[None], rod.radii[None], 0.0)
    seen = (render([alone], CAMERA) < 100).sum()
    left = []
    for _ in range(60):
        held = holders(rng, finger, hand=True) + holders(rng, rod, hand=False)
        around = [Tube(piece.centres[None], piece.radii[None], 1.0) for piece in held]
        left.append((render([alone, *around], CAMERA) < 100).sum() / seen)
    # A sleeve or strap covers some millimetres of 90, a bent finger before the base no more than its width.
    assert np.mean(left) > 0.85
    assert np.min(left) > 0.4


def test_backdrops_are_reflectances():
    rng = np.random.default_rng(1)
    found = np.array([backdrop(rng, (32, 48)) for _ in range(60)])
    assert found.shape == (60, 32, 48)
    assert found.min() >= 0
    assert found.max() <= 1
    # A plain wall in a third of them, which differs by no more than 15 % each way; others mostly by more.
    plain = np.ptp(found, axis=(1, 2)) <= 0.3
    assert 0.15 < plain.mean() < 0.7


def test_texture_stays_within_its_contrast():
    rng = np.random.default_rng(2)
    for _ in range(20):
        assert np.abs(texture(rng, (20, 20), ("stripes", "fractal", "checks"), 0.3)).max() <= 0.3 * 1.01


def test_shadow_moves_and_blurs_as_asked():
    mask = np.zeros((81, 81), np.uint8)
    mask[38:43, 38:43] = 255
    shadow = moved(mask, 6.0, -4.0, 3.0).astype(float)
    y, x = np.mgrid[:81, :81]
    weight = shadow / shadow.sum()
    # Grays of a faint shadow are rounded to whole numbers: a tenth of a pixel, a tenth of the blur.
    assert (weight * x).sum() == pytest.approx(46, abs=0.1)
    assert (weight * y).sum() == pytest.approx(36, abs=0.1)
    spread = (weight * (x - 46) ** 2).sum() - 2.0  # less the square's own (5² − 1)/12
    assert np.sqrt(spread) == pytest.approx(3.0, rel=0.1)


def test_polygon_covers_its_area():
    corners = np.array([[10.5, 8.0], [40.0, 12.5], [30.0, 41.0]])
    (ax, ay), (bx, by) = corners[1] - corners[0], corners[2] - corners[0]
    area = abs(ax * by - ay * bx) / 2
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum()
    # OpenCV draws an edge about a pixel wide on top of the polygon.
    assert area < polygon_mask(corners, (50, 50)).sum() / 255 < area + edge


def test_cable_crosses_the_border():
    rng = np.random.default_rng(3)
    masks = [cable_mask(rng, (64, 64), 2.0)[0] for _ in range(20)]
    assert sum(mask.any() for mask in masks) > 15
    assert all(mask.mean() < 60 for mask in masks)
