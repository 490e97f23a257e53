"""Pictures made what their appearance says: closed forms of each effect, and independence of the batch."""

import dataclasses

import jaxtyping
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.vision import BACKGROUND, TRAINING, augment, draw_appearance, set_contrast
from exosight.vision.augment import coverage

FRAMES = 6
EVERYTHING = dataclasses.replace(TRAINING, share=0.7, fingers_in_front=1)


def flat(gray: int, frames: int = 4) -> np.ndarray:
    return np.full((frames, 128, 128), gray, np.uint8)


def test_a_frame_comes_out_alike_in_any_batch_and_order(clean) -> None:
    numbers = np.arange(FRAMES)
    together = augment(clean, draw_appearance(EVERYTHING, 4, numbers))
    for i in numbers[::-1]:
        alone = augment(clean[i : i + 1], draw_appearance(EVERYTHING, 4, numbers[i : i + 1]))
        np.testing.assert_array_equal(alone[0], together[i])
    assert np.any(together != augment(clean, draw_appearance(EVERYTHING, 5, numbers)))


def test_images_given_stay_as_they_are(clean) -> None:
    before = clean.copy()
    augment(clean, draw_appearance(EVERYTHING, 0, np.arange(FRAMES)))
    np.testing.assert_array_equal(clean, before)


# The bodies, and what is behind them


def test_coverage_is_found_from_the_picture(clean, cover) -> None:
    found = np.stack([coverage(picture) for picture in clean])
    assert np.all(found[cover == 0] == 0)
    whole = np.stack([np.pad(c, 1, mode="edge") for c in cover == 255])
    inner = np.lib.stride_tricks.sliding_window_view(whole, (3, 3), axis=(1, 2)).all(axis=(3, 4))
    assert np.all(found[inner] == 255)
    edges = (cover > 0) & (cover < 255)
    # A tenth, as documented: shading changes between a pixel and its neighbour. Where both bodies meet the
    # background, the neighbour is the wrong one.
    assert np.sqrt(np.mean(((found - cover.astype(float)) / 255)[edges] ** 2)) < 0.12


@pytest.mark.parametrize("level", [0.0, 0.3, 1.0])
def test_background_is_seen_where_the_bodies_let_it(clean, cover, plain, level) -> None:
    seen = augment(clean, plain(FRAMES, background=1, background_level=level), cover)
    through = 1 - cover / 255
    expected = clean + through * (round(255 * level) - BACKGROUND)
    assert (
        np.abs(seen - np.clip(expected, 0, 255)).max() <= 1.5
    )  # the cover is rounded to 1/255, then the gray


def test_the_renderers_background_put_back_is_the_same_picture(clean, plain) -> None:
    seen = augment(clean, plain(FRAMES, background=1, background_level=BACKGROUND / 255))
    assert np.abs(seen.astype(int) - clean).max() <= 1


def test_bodies_fade_and_the_background_stays(clean, cover, plain) -> None:
    seen = augment(clean, plain(FRAMES, body_dark=0.2, body_range=0.5), cover)
    np.testing.assert_array_equal(seen[cover == 0], clean[cover == 0])
    whole = cover == 255
    assert np.abs(seen[whole] - (0.2 * 255 + 0.5 * clean[whole])).max() <= 0.51


@pytest.mark.parametrize("change", [{"background": 1.0}, {"fingers_behind": 1.0}, {"body_range": 0.5}])
def test_pictures_without_the_renderers_background_are_refused(plain, change) -> None:
    noisy = np.random.default_rng(0).integers(0, 256, (1, 64, 64), dtype=np.uint8)
    with pytest.raises(InputError, match="clean pictures"):
        augment(noisy, plain(1, **change))


# Light and lens


@given(st.floats(0, 0.9), st.floats(0, 6.3), st.floats(0, 0.9))
@settings(deadline=None, max_examples=20)
def test_light_falls_as_stated(plain, gradient, angle, vignette) -> None:
    seen = augment(flat(100, 1), plain(1, gradient=gradient, gradient_angle=angle, vignette=vignette))[0]
    columns, rows = np.meshgrid(np.arange(128) + 0.5 - 64, np.arange(128) + 0.5 - 64)
    corner = 64 * np.sqrt(2)
    along = (np.cos(angle) * columns + np.sin(angle) * rows) / corner
    gain = 1 + gradient * along - vignette * (columns**2 + rows**2) / corner**2
    assert np.abs(seen - np.clip(100 * gain, 0, 255)).max() <= 0.51


@pytest.mark.parametrize("blur", [{"blur": 2.5}, {"motion": 9.0, "motion_angle": 0.6}])
def test_blur_keeps_the_mean_and_lowers_the_contrast(clean, plain, blur) -> None:
    seen = augment(clean, plain(FRAMES, **blur)).astype(float)
    # The bodies end away from the border, so what leaves a pixel arrives at another; pixels are rounded.
    np.testing.assert_allclose(seen.mean(axis=(1, 2)), clean.mean(axis=(1, 2)), atol=0.5)
    assert np.all(seen.std(axis=(1, 2)) < clean.std(axis=(1, 2)))


@pytest.mark.parametrize("sigma", [1.0, 2.0, 4.0])
def test_gaussian_blur_has_the_stated_width(plain, sigma: float) -> None:
    dot = np.zeros((1, 65, 65), np.uint8)
    dot[0, 22:43, 22:43] = 255
    weight = augment(dot, plain(1, blur=sigma))[0].astype(float)
    columns = np.arange(65) - 32
    variance = (weight.sum(axis=0) * columns**2).sum() / weight.sum()
    # Variances of what is folded add up; OpenCV cuts its kernel off at three standard deviations.
    assert variance == pytest.approx((21**2 - 1) / 12 + sigma**2, rel=0.03)


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 2])
def test_motion_blur_spreads_along_its_direction_alone(plain, angle: float) -> None:
    dot = np.zeros((1, 65, 65), np.uint8)
    dot[0, 27:38, 27:38] = 255
    weight = augment(dot, plain(1, motion=12.0, motion_angle=angle))[0].astype(float)
    columns, rows = np.meshgrid(np.arange(65) - 32, np.arange(65) - 32)
    for direction, spread in ((angle, 12.0**2 / 12), (angle + np.pi / 2, 0.0)):
        along = np.cos(direction) * columns + np.sin(direction) * rows
        variance = (weight * along**2).sum() / weight.sum()
        # A line of length l has the variance l²/12; linear interpolation adds at most ¼ each way.
        assert variance == pytest.approx((11**2 - 1) / 12 + spread, abs=0.4)


# Tone and noise


@given(st.floats(0, 0.9), st.floats(0, 1))
@settings(deadline=None, max_examples=20)
def test_contrast_is_that_of_the_papers_tests(clean, plain, lost, share) -> None:
    dark = lost * share
    seen = augment(clean, plain(FRAMES, range=lost, dark=dark))
    # Both round half a gray up; a value that lies there may go either way.
    assert np.abs(seen.astype(int) - set_contrast(clean, dark, min(dark + 1 - lost, 1.0))).max() <= 1


@pytest.mark.parametrize("gamma", [0.5, 1.7])
def test_gamma_is_a_power_that_keeps_black_and_white(plain, gamma) -> None:
    grays = np.arange(256, dtype=np.uint8).reshape(1, 16, 16)
    seen = augment(grays, plain(1, gamma=gamma))
    assert np.abs(seen - 255 * (grays / 255) ** gamma).max() <= 0.5 + 1e-4  # rounding; tones are in float32
    assert (seen[0, 0, 0], seen[0, -1, -1]) == (0, 255)


@pytest.mark.parametrize("variance", [0.001, 0.01])
def test_noise_is_the_papers(plain, variance: float) -> None:
    seen = augment(flat(127), plain(4, noise=variance, seed=np.arange(4.0)))
    change = (seen.astype(float) - 127) / 255
    # Five standard errors, as for `add_noise`; rounding to grays adds 1/12 gray².
    assert change.mean() == pytest.approx(0.01, abs=5 * np.sqrt(variance / change.size))
    assert change.var() == pytest.approx(variance + 1 / 12 / 255**2, rel=5 * np.sqrt(2 / change.size) + 1e-4)
    kurtosis = ((change - change.mean()) ** 4).mean() / change.var() ** 2
    assert kurtosis == pytest.approx(3, abs=5 * np.sqrt(24 / change.size))


def test_noise_is_white_and_differs_from_frame_to_frame(plain) -> None:
    seen = augment(flat(127), plain(4, noise=0.01, seed=np.arange(4.0))).astype(float)
    noise = seen - seen.mean()
    for pair in (
        (noise[:, 1:], noise[:, :-1]),
        (noise[:, :, 1:], noise[:, :, :-1]),
        (noise[:, :, 4:], noise[:, :, :-4]),
        (noise[1:], noise[:-1]),
    ):
        correlation = np.corrcoef(pair[0].ravel(), pair[1].ravel())[0, 1]
        assert abs(correlation) < 5 / np.sqrt(pair[0].size)  # five standard errors of none


@pytest.mark.parametrize("gray", [50, 100, 200])
def test_variance_of_shot_noise_is_proportional_to_brightness(plain, gray: int) -> None:
    seen = augment(flat(gray), plain(4, shot=0.002, seed=np.arange(4.0))).astype(float)
    expected = 0.002 * gray / 255 * 255**2 + 1 / 12
    assert seen.var() == pytest.approx(expected, rel=5 * np.sqrt(2 / seen.size) + 1e-4)
    assert seen.mean() == pytest.approx(gray, abs=5 * np.sqrt(expected / seen.size))


# What does not fit


def test_wrong_input_is_refused(clean, cover, plain, monkeypatch) -> None:
    # A user has no shape checks from the test set-up.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(InputError, match="3 frames"):
        augment(clean, plain(3))
    with pytest.raises(InputError, match="cover"):
        augment(clean, plain(FRAMES), cover[:, :64])
