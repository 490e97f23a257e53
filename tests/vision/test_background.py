"""Backgrounds: level, contrast and size as stated, turned as stated, the same again from the same numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.vision.background import background
from exosight.vision.transforms.composition import BACKGROUND_KINDS

SHAPE = (96, 128)


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from(BACKGROUND_KINDS),
    st.floats(0, 0.5),
    st.floats(0, 1),
    st.floats(0.05, 0.5),
    st.floats(0, 6.3),
    st.integers(0, 2**34),
)
def test_grays_stay_around_their_level(kind, contrast, share, size, angle, seed) -> None:
    level = contrast + (1 - 2 * contrast) * share
    gray = background(kind, SHAPE, level, contrast, size, angle, seed)
    assert gray.shape == SHAPE
    # Smooth fields overshoot their largest values, which are 1.2, between the places that they go through;
    # a fractal one adds up to 1.9 times as much. Then half a gray.
    reach = {"smooth": 1.7, "fractal": 3.2}.get(kind, 1.0) * 255 * contrast + 0.5
    assert np.abs(gray - 255 * level).max() <= reach + 1e-3
    np.testing.assert_array_equal(gray, background(kind, SHAPE, level, contrast, size, angle, seed))


@pytest.mark.parametrize("kind", [kind for kind in BACKGROUND_KINDS if kind != "flat"])
def test_every_pattern_shows_and_contrast_scales_it(kind: str) -> None:
    low, high = (background(kind, SHAPE, 0.5, c, 0.2, 0.4, 3).astype(float) - 127.5 for c in (0.1, 0.2))
    assert high.std() > 10
    assert np.abs(high - 2 * low).max() <= 1.5 + 1e-9  # both are rounded to whole grays


@pytest.mark.parametrize("kind", BACKGROUND_KINDS)
def test_without_contrast_every_kind_is_flat(kind: str) -> None:
    assert np.unique(background(kind, SHAPE, 0.3, 0.0, 0.2, 0.4, 3)).size == 1


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_stripes_repeat_after_their_size_across_their_angle(angle: float) -> None:
    """The strongest frequency of the picture is that of the stripes."""
    gray = background("stripes", (128, 128), 0.5, 0.4, 0.125, angle, 0).astype(float)
    spectrum = np.abs(
        np.fft.rfft2((gray - gray.mean()) * np.outer(np.hanning(128), np.hanning(128)), (512, 512))
    )
    row, column = np.unravel_index(spectrum.argmax(), spectrum.shape)
    frequency = np.array([column / 512, np.fft.fftfreq(512)[row]])  # a pixel
    frequency *= np.sign(frequency @ [np.cos(angle), np.sin(angle)])
    expected = np.array([np.cos(angle), np.sin(angle)]) / 16
    np.testing.assert_allclose(frequency, expected, atol=1 / 512 + 1e-9)  # one step of the spectrum


def test_gradient_rises_evenly_along_its_angle() -> None:
    gray = background("gradient", (128, 128), 0.5, 0.4, 0.2, np.pi / 2, 0).astype(float)
    assert np.abs(gray - gray[:, :1]).max() <= 1
    slope = 255 * 0.4 / 0.75 / 128
    assert np.abs(np.diff(gray[:, 0]) - slope).max() <= 1  # two roundings
    assert gray[-1, 0] - gray[0, 0] == pytest.approx(127 * slope, abs=1)


@pytest.mark.parametrize(
    "kind", ["smooth", "fractal", "cells", "shapes", "stripes", "checks", "grid", "rings"]
)
def test_seeds_make_other_backgrounds(kind: str) -> None:
    one, other = (background(kind, SHAPE, 0.5, 0.4, 0.2, 0.0, seed) for seed in (0, 1))
    assert np.mean(one != other) > 0.1
