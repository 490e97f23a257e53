"""Finger and exosuit as two tubes: what is drawn where, and over what."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit, assemble, observe
from exosight.exosuit.finger import Finger
from exosight.exosuit.shapes import TABLE_I, radius
from exosight.mechanics import stack
from exosight.vision import BACKGROUND, Camera, render
from exosight.vision.scene import EXOSUIT_SHADE, FINGER_SHADE, picture, tubes

CAMERA = Camera()
PIXEL = CAMERA.metres_per_pixel
FINGER = Finger()
X = np.linspace(0, 1, 42)
RADII = radius(TABLE_I.surface, X)

flexions = st.tuples(*(st.floats(low, 1.5) for low in (-0.17, -0.08, -0.08)))


def finger_nodes(angles) -> np.ndarray:
    """Joints and tip (1, 5, 3) of a finger flexed by these joint angles."""
    heading = np.cumsum([*angles, 0.0])
    along = np.asarray(FINGER.lengths)[:, None] * np.stack(
        [np.cos(heading), np.zeros(4), -np.sin(heading)], axis=-1
    )
    return np.concatenate([np.zeros((1, 3)), np.cumsum(along, axis=0)])[None]


def straight_rod(gap: float) -> np.ndarray:
    """The exosuit's unbent axis (1, 42, 3), so far above the finger's base."""
    height = FINGER.radii[0] + RADII[0] + gap
    return np.stack([TABLE_I.length * X, np.zeros(42), np.full(42, height)], axis=-1)[None]


def drawn(*bodies) -> np.ndarray:
    return render(bodies, CAMERA)[0]


def covered(image: np.ndarray) -> np.ndarray:
    """The pixels that a body covers whole: those whose eight neighbours show it too."""
    seen = np.pad(image != BACKGROUND, 1)
    return np.lib.stride_tricks.sliding_window_view(seen, (3, 3)).all(axis=(2, 3))


@settings(deadline=None, max_examples=40)
@given(flexions, st.floats(3 * PIXEL, 0.02))
def test_background_shows_between_bodies_that_do_not_touch(angles, gap):
    # Extension brings a joint up by no more than 4 mm over the finger's length; flexion takes it away.
    gap += max(finger_nodes(angles)[0, :, 2].max(), 0.0)
    finger, exosuit = tubes(straight_rod(gap), RADII, finger_nodes(angles), np.array(FINGER.radii))
    below, above = drawn(finger) != BACKGROUND, drawn(exosuit) != BACKGROUND
    both = below.any(axis=0) & above.any(axis=0)
    assert both.sum() > 5
    lowest, highest = 127 - above[::-1].argmax(axis=0), below.argmax(axis=0)
    image = drawn(finger, exosuit)
    for column in np.flatnonzero(both):
        between = image[lowest[column] + 1 : highest[column], column]
        assert len(between) > 0
        assert (between == BACKGROUND).all()


@settings(deadline=None, max_examples=40)
@given(flexions, st.floats(-0.015, 0.02))
def test_the_exosuit_is_drawn_over_the_finger_and_both_are_seen(angles, gap):
    finger, exosuit = tubes(straight_rod(gap), RADII, finger_nodes(angles), np.array(FINGER.radii))
    image, alone, under = drawn(finger, exosuit), drawn(exosuit), drawn(finger)
    whole = covered(alone)
    assert whole.sum() > 300
    np.testing.assert_array_equal(image[whole], alone[whole])
    free = alone == BACKGROUND
    np.testing.assert_array_equal(image[free], under[free])
    assert (under[free] != BACKGROUND).sum() > 100


def test_shades_are_those_documented_and_apart_from_each_other_and_the_background():
    finger, exosuit = tubes(straight_rod(0.01), RADII, finger_nodes((0, 0, 0)), np.array(FINGER.radii))
    assert (finger.shade, exosuit.shade) == (FINGER_SHADE, EXOSUIT_SHADE) == (0.70, 0.35)
    brightest = [int(image[covered(image)].max()) for image in (drawn(finger), drawn(exosuit))]
    assert brightest[0] - brightest[1] > 50  # of the 89 between full light on either
    assert brightest[0] < BACKGROUND


def test_radii_may_differ_from_frame_to_frame():
    rods, fingers = (np.repeat(part, 2, axis=0) for part in (straight_rod(0.0), finger_nodes((0, 0, 0))))
    both = tubes(rods, np.stack([RADII, 1.5 * RADII]), fingers, np.array(FINGER.radii))
    images = render(both, CAMERA)
    np.testing.assert_array_equal(
        images[0], drawn(*tubes(rods[:1], RADII, fingers[:1], np.array(FINGER.radii)))
    )
    assert (images[1] != BACKGROUND).sum() > (images[0] != BACKGROUND).sum()


def test_a_pose_that_is_not_finite_is_refused():
    rod = straight_rod(0.0)
    rod[0, 7, 0] = np.nan
    with pytest.raises(InputError, match="tube centres"):
        tubes(rod, RADII, finger_nodes((0, 0, 0)), np.array(FINGER.radii))


def test_a_picture_of_a_worn_exosuit():
    exosuit = Exosuit(gap=4 * PIXEL)
    robot = assemble(exosuit)
    images = []
    for angle in (0.0, 0.5):
        q = np.zeros((1, 1, robot.dofs))
        q[0, 0, robot.dof_slice("finger_0")] = angle
        pose = jax.tree.map(lambda leaf: leaf[0], observe(stack([robot]), jnp.asarray(q)))
        images.append(picture(exosuit, pose, CAMERA))
        body = tubes(straight_rod(4 * PIXEL), RADII, finger_nodes((angle, 0, 0)), np.array(FINGER.radii))
        # The rod's points are Gauss points here and evenly spaced there, on one straight taper: round-off.
        assert np.abs(images[-1][0].astype(int) - drawn(*body)).max() <= 1
    for column in range(20, 100):  # [pixels], where both bodies are
        grays = images[0][0, :, column]
        body = np.flatnonzero(grays != BACKGROUND)
        (gap,) = np.flatnonzero(np.diff(body) > 1)
        upper, lower = grays[body[1:gap]], grays[body[gap + 2 : -1]]  # without the antialiased edges
        assert upper.max() <= 255 * EXOSUIT_SHADE + 1 < lower.max()
