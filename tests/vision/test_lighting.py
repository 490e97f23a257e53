"""Shades and lamps of rendered bodies."""

import numpy as np
import pytest
from pydantic import ValidationError

from exosight.errors import InputError
from exosight.vision import BACKGROUND, Camera, Light, LightingVariation, Tube, draw_lighting, render
from exosight.vision.renderer import AMBIENT, LAMP, draw

CAMERA = Camera(centre=(0.0, 0.0), metres_per_pixel=1.0, width=64, height=64)
RADIUS = 20.0
BALL = Tube(np.zeros((1, 2, 3)), np.full((1, 2), RADIUS), 0.8)
NUMBERS = np.arange(2000)
SHADES = {"link": 0.7, "sleeve": 0.35, "ring": 0.5}


@pytest.mark.parametrize("lamp", [LAMP, (1.0, 0.0, 0.0), (-0.6, 0.0, 0.8), (0.48, -0.36, 0.8)])
@pytest.mark.parametrize("ambient", [0.0, 0.4, 1.0])
def test_a_ball_is_lit_by_lambert(lamp, ambient) -> None:
    picture = render([BALL], CAMERA, Light(np.array([lamp]), np.array([ambient])))[0]
    columns, rows = np.meshgrid(np.arange(64) + 0.5 - 32, np.arange(64) + 0.5 - 32)
    inside = np.hypot(columns, rows) < RADIUS - 1
    towards = np.sqrt(np.maximum(RADIUS**2 - columns**2 - rows**2, 0))
    facing = (lamp[0] * columns - lamp[1] * rows + lamp[2] * towards) / RADIUS
    expected = 255 * 0.8 * (ambient + (1 - ambient) * np.maximum(facing, 0))
    assert np.abs(picture - expected)[inside].max() <= 0.5 + 1e-9  # rounding


def test_the_default_light_is_the_nominal_one() -> None:
    light = Light(np.array([LAMP]), np.array([AMBIENT]))
    np.testing.assert_array_equal(render([BALL], CAMERA), render([BALL], CAMERA, light))


def test_every_frame_has_its_own_shade_and_lamp() -> None:
    centres, radii = np.zeros((3, 2, 3)), np.full((3, 2), RADIUS)
    shades, lamps = np.array([0.2, 0.5, 0.8]), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    ambient = np.array([0.1, 0.2, 0.3])
    together = render([Tube(centres, radii, shades)], CAMERA, Light(lamps, ambient))
    for k in range(3):
        one = Tube(centres[:1], radii[:1], float(shades[k]))
        alone = render([one], CAMERA, Light(lamps[k : k + 1], ambient[k : k + 1]))
        np.testing.assert_array_equal(together[k], alone[0])


def test_by_default_light_is_the_nominal_one() -> None:
    drawn = draw_lighting(LightingVariation(), 0, NUMBERS, SHADES)
    np.testing.assert_array_equal(drawn.shades, np.tile(list(SHADES.values()), (2000, 1)))
    np.testing.assert_allclose(drawn.light.lamp, np.tile(LAMP, (2000, 1)), atol=1e-15)
    np.testing.assert_array_equal(drawn.light.ambient, np.full(2000, AMBIENT))


def test_lamps_are_even_over_their_cap() -> None:
    """The height of even points on a sphere's cap is even (Archimedes)."""
    lamp = draw_lighting(LightingVariation(lamp=0.8), 0, NUMBERS, SHADES).light.lamp
    np.testing.assert_allclose(np.linalg.norm(lamp, axis=1), 1, atol=1e-12)
    share = (1 - lamp @ np.array(LAMP)) / (1 - np.cos(0.8))
    assert np.all((share > -1e-12) & (share < 1 + 1e-12))
    assert share.mean() == pytest.approx(0.5, abs=5 * np.sqrt(1 / 12 / 2000))  # five standard errors
    around = np.arctan2(lamp @ np.cross(LAMP, (1, 0, 0)), lamp[:, 0])
    assert np.abs(np.exp(1j * around).mean()) < 5 / np.sqrt(2000)


def test_switches_move_their_own_numbers_and_frames_stand_alone() -> None:
    variation = LightingVariation(
        shades={"link": (0.5, 0.8), "sleeve": (0.1, 0.4), "ring": (0.2, 0.3)}, lamp=0.5, ambient=(0.2, 0.6)
    )
    drawn = draw_lighting(variation, (3, 1), NUMBERS, SHADES)
    for values, (low, high) in zip(drawn.shades.T, variation.shades.values(), strict=True):
        assert np.all((values >= low) & (values <= high))
        assert np.ptp(values) > 0.9 * (high - low)  # of 2000 even draws, all but 0.1 % with probability 1
    assert np.all((drawn.light.ambient >= 0.2) & (drawn.light.ambient <= 0.6))
    for one, other in ((0, 1), (0, 2), (1, 2)):
        correlation = np.corrcoef(drawn.shades[:, one], drawn.shades[:, other])[0, 1]
        assert abs(correlation) < 5 / np.sqrt(2000)  # five standard errors of none
    alone = draw_lighting(LightingVariation(shades={"sleeve": (0.1, 0.4)}), (3, 1), NUMBERS[5:6], SHADES)
    np.testing.assert_array_equal(alone.shades[0], [0.7, drawn.shades[5, 1], 0.5])


def test_a_third_tube_leaves_the_draws_of_the_others() -> None:
    variation = LightingVariation(shades={"link": (0.5, 0.8)}, lamp=0.5, ambient=(0.2, 0.6))
    two, three = (
        draw_lighting(variation, 1, NUMBERS, dict(list(SHADES.items())[:count])) for count in (2, 3)
    )
    np.testing.assert_array_equal(two.shades, three.shades[:, :2])
    np.testing.assert_array_equal(two.light.lamp, three.light.lamp)
    np.testing.assert_array_equal(two.light.ambient, three.light.ambient)


def test_impossible_light_is_refused() -> None:
    with pytest.raises(InputError, match="unit vector"):
        Light(np.array([[1.0, 1.0, 0.0]]), np.array([0.5]))
    with pytest.raises(InputError, match="0…1"):
        Light(np.array([LAMP]), np.array([1.5]))
    with pytest.raises(InputError, match="1 pictures"):
        draw(
            np.full((1, 64, 64), BACKGROUND, np.uint8), BALL, CAMERA, Light(np.tile(LAMP, (2, 1)), np.ones(2))
        )
    with pytest.raises(InputError, match="shade"):
        Tube(np.zeros((1, 2, 3)), np.ones((1, 2)), np.array([2.0]))
    with pytest.raises(ValidationError):
        LightingVariation(shades={"link": (0.8, 0.1)})
