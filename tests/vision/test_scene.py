"""What a camera sees of a system: where, and what before what."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index
from exosight.exosuit.published import EXOSUIT_SHADE, FINGER_SHADE, published
from exosight.system.camera import Camera
from exosight.system.observation import observe
from exosight.system.system import System, stack_systems
from exosight.vision import BACKGROUND, Light, Lighting, render
from exosight.vision.renderer import AMBIENT, LAMP
from exosight.vision.scene import cover, picture, tubes

CAMERA = Camera()
PIXEL = CAMERA.metres_per_pixel
WORN = Exosuit(gap=4 * PIXEL)
SYSTEM = published(WORN)
FINGER = WORN.finger

flexions = st.tuples(*(st.floats(low, 1.5) for low in (-0.17, -0.08, -0.08)))


def finger_nodes(angles) -> np.ndarray:
    """Joints and tip (1, 5, 3) of a finger flexed by these joint angles."""
    heading = np.cumsum([*angles, 0.0])
    along = np.asarray(FINGER.lengths)[:, None] * np.stack(
        [np.cos(heading), np.zeros(4), -np.sin(heading)], axis=-1
    )
    return np.concatenate([np.zeros((1, 3)), np.cumsum(along, axis=0)])[None]


def straight_rod(gap: float) -> np.ndarray:
    """The unbent exosuit's axis, so far above the finger's base."""
    exosuit = SYSTEM.tubes[1]
    height = FINGER.radii[0] + float(exosuit.radius[0]) + gap
    rod = SYSTEM.robot["exosuit"]
    along = rod.length * np.asarray(rod.quadrature.points)
    return np.stack([along, np.zeros(len(along)), np.full(len(along), height)], axis=-1)[None]


def drawn(*bodies) -> np.ndarray:
    return render(bodies, CAMERA, visibility="stacked")[0]


def covered(image: np.ndarray) -> np.ndarray:
    """The pixels that a body covers whole: those whose eight neighbours show it too."""
    seen = np.pad(image != BACKGROUND, 1)
    return np.lib.stride_tricks.sliding_window_view(seen, (3, 3)).all(axis=(2, 3))


@settings(deadline=None, max_examples=40)
@given(flexions, st.floats(3 * PIXEL, 0.02))
def test_background_shows_between_bodies_that_do_not_touch(angles, gap):
    # Extension brings a joint up by no more than 4 mm over the finger's length; flexion takes it away.
    gap += max(finger_nodes(angles)[0, :, 2].max(), 0.0)
    finger, exosuit = tubes(SYSTEM, {"finger": finger_nodes(angles), "exosuit": straight_rod(gap)})
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
def test_published_tubes_are_drawn_one_over_the_other_and_all_are_seen(angles, gap):
    axes = {"exosuit": straight_rod(gap), "finger": finger_nodes(angles)}  # its order does not matter
    finger, exosuit = tubes(SYSTEM, axes)
    image, alone, under = drawn(finger, exosuit), drawn(exosuit), drawn(finger)
    np.testing.assert_array_equal(picture(SYSTEM, axes)[0], image)
    whole = covered(alone)
    assert whole.sum() > 300
    np.testing.assert_array_equal(image[whole], alone[whole])
    free = alone == BACKGROUND
    np.testing.assert_array_equal(image[free], under[free])
    assert (under[free] != BACKGROUND).sum() > 100


@settings(deadline=None, max_examples=10)
@given(flexions, st.floats(-0.015, 0.005))
def test_the_same_surfaces_in_contact_are_seen_in_depth_order(angles, gap):
    axes = {"exosuit": straight_rod(gap), "finger": finger_nodes(angles)}
    system = index(WORN)
    np.testing.assert_array_equal(picture(system, axes), render(tubes(system, axes), CAMERA))
    black = render(tubes(system, axes, [0.0, 0.0]), CAMERA)
    np.testing.assert_array_equal(cover(system, axes), np.rint((1 - black / BACKGROUND) * 255))


def test_published_shades_are_apart_from_each_other_and_the_background():
    finger, exosuit = tubes(SYSTEM, {"finger": finger_nodes((0, 0, 0)), "exosuit": straight_rod(0.01)})
    assert (finger.shade, exosuit.shade) == (FINGER_SHADE, EXOSUIT_SHADE) == (0.70, 0.35)
    brightest = [int(image[covered(image)].max()) for image in (drawn(finger), drawn(exosuit))]
    assert brightest[0] - brightest[1] > 50  # of the 89 between full light on either
    assert brightest[0] < BACKGROUND


def rest(system: System) -> dict[str, np.ndarray]:
    """Its axes at q = 0, one frame."""
    seen = observe(stack_systems([system]), np.zeros((1, 1, system.robot.dofs)))
    return {name: np.asarray(axis)[0] for name, axis in seen.axes.items()}


def test_stacked_systems_are_one_a_frame():
    systems = [published(Exosuit(gap=gap, mount_angle=angle)) for gap, angle in ((0.0, 0.0), (0.004, 0.1))]
    axes = [rest(system) for system in systems]
    together = {name: np.concatenate([each[name] for each in axes]) for name in axes[0]}
    images = picture(stack_systems(systems), together)
    for image, system, own in zip(images, systems, axes, strict=True):
        np.testing.assert_array_equal(image, picture(system, own)[0])
    assert np.any(images[0] != images[1])


def test_lighting_gives_every_tube_its_shade_in_every_frame():
    axes = {name: np.repeat(axis, 2, axis=0) for name, axis in rest(SYSTEM).items()}
    light = Light(np.tile(LAMP, (2, 1)), np.full(2, AMBIENT))
    images = picture(SYSTEM, axes, Lighting(np.array([[0.7, 0.35], [0.2, 0.6]]), light))
    np.testing.assert_array_equal(images[0], picture(SYSTEM, axes)[0])
    exchanged = drawn(*(tubes(SYSTEM, rest(SYSTEM), [0.2, 0.6])))
    np.testing.assert_array_equal(images[1], exchanged)


def test_what_the_bodies_cover_is_what_differs_from_the_background():
    axes = rest(SYSTEM)
    share, image = cover(SYSTEM, axes)[0], picture(SYSTEM, axes)[0]
    np.testing.assert_array_equal(share == 0, image == BACKGROUND)
    assert np.all(share[covered(image)] > 250)  # but for the narrow gap, which no pixel lies in


def test_a_pose_that_is_not_finite_is_refused():
    rod = straight_rod(0.0)
    rod[0, 7, 0] = np.nan
    with pytest.raises(InputError, match="tube centres"):
        tubes(SYSTEM, {"finger": finger_nodes((0, 0, 0)), "exosuit": rod})


def test_axes_of_another_system_are_refused():
    with pytest.raises(InputError, match="got none of exosuit"):
        tubes(SYSTEM, {"finger": finger_nodes((0, 0, 0))})


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_observed_axes_are_where_the_bodies_are(angle: float):
    """At rest, and with the first joint bent: the finger folds there, the exosuit stays straight."""
    q = np.zeros((1, 1, SYSTEM.robot.dofs))
    q[0, 0, SYSTEM.robot.dof_slice("finger_0")] = angle
    seen = observe(stack_systems([SYSTEM]), q)
    axes = {name: np.asarray(axis)[0] for name, axis in seen.axes.items()}
    np.testing.assert_allclose(axes["finger"], finger_nodes((angle, 0, 0)), atol=1e-12)  # round-off
    np.testing.assert_allclose(axes["exosuit"], straight_rod(4 * PIXEL), atol=1e-12)
    image = picture(SYSTEM, axes)[0]
    for column in range(20, 60):  # [pixels], where both bodies are
        grays = image[:, column]
        body = np.flatnonzero(grays != BACKGROUND)
        (gap,) = np.flatnonzero(np.diff(body) > 1)
        upper, lower = grays[body[1:gap]], grays[body[gap + 2 : -1]]  # without the antialiased edges
        assert upper.max() <= 255 * EXOSUIT_SHADE + 1 < lower.max()
