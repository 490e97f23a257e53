import jaxtyping
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from exosight.errors import InputError
from exosight.vision import CORRUPTIONS, add_noise, corrupt, set_contrast

GRAYS = np.arange(256, dtype=np.uint8).reshape(1, 16, 16)
NOISES = ["noise-low", "noise-medium", "noise-high"]


def constant(gray: int, frames: int = 4) -> np.ndarray:
    return np.full((frames, 128, 128), gray, np.uint8)


def test_cases_are_the_papers():
    assert list(CORRUPTIONS) == [*NOISES, "contrast-low", "contrast-high"]
    assert [CORRUPTIONS[name].variance for name in NOISES] == [0.001, 0.01, 0.1]


@pytest.mark.parametrize("variance", [0.001, 0.01])
def test_noise_has_the_stated_mean_and_variance(variance):
    # Mid gray lies five standard deviations from black and white, so clipping plays no part.
    change = (add_noise(constant(127), variance, np.random.default_rng(3)).astype(float) - 127) / 255
    # Five standard errors of a sample mean and of a sample variance; rounding to grays adds 1/12 gray².
    assert change.mean() == pytest.approx(0.01, abs=5 * np.sqrt(variance / change.size))
    expected = variance + 1 / 12 / 255**2
    assert change.var() == pytest.approx(expected, rel=5 * np.sqrt(2 / change.size))


def test_strong_noise_is_clipped_to_black_and_white_as_often_as_a_gaussian_says():
    noisy = corrupt(constant(127), "noise-high", seed=0)
    sigma = 255 * np.sqrt(0.1)
    # Gray 0 below −126.5 − 2.55 grays from the mean, gray 255 above 127.5 − 2.55, at σ = 255 √0.1 grays.
    for gray, share in ((0, norm.cdf((-126.5 - 2.55) / sigma)), (255, norm.sf((127.5 - 2.55) / sigma))):
        found = np.mean(noisy == gray)
        assert found == pytest.approx(share, abs=5 * np.sqrt(share / noisy.size))


def test_noise_is_white():
    change = corrupt(constant(127), "noise-medium", seed=1).astype(float)
    change -= change.mean()
    for axis in (0, 1, 2):
        neighbours = np.mean(change * np.roll(change, 1, axis)) / change.var()
        assert abs(neighbours) < 5 / np.sqrt(change.size)  # five standard errors of a correlation


def test_no_variance_only_shifts_by_the_mean():
    np.testing.assert_array_equal(add_noise(constant(100), 0.0, np.random.default_rng(0)), constant(103))


@pytest.mark.parametrize("name", NOISES)
def test_noise_does_not_depend_on_batches(name):
    images = np.random.default_rng(4).integers(0, 256, (7, 8, 9)).astype(np.uint8)
    whole = corrupt(images, name, seed=11)
    parts = [corrupt(images[a:b], name, seed=11, first=a) for a, b in ((0, 1), (1, 5), (5, 7))]
    np.testing.assert_array_equal(whole, np.concatenate(parts))


def test_seeds_and_frames_draw_different_noise():
    drawn = [
        corrupt(constant(127, 2), "noise-medium", seed=seed)[frame] for seed in (0, 1) for frame in (0, 1)
    ]
    for i in range(4):
        for j in range(i):
            # Two independent draws of σ = 25.5 grays agree to the gray about once in 90 pixels.
            assert np.mean(drawn[i] == drawn[j]) < 0.03


def test_adding_noise_draws_in_frame_order():
    images = constant(127, 3)
    rng = np.random.default_rng(5)
    parts = [add_noise(images[:1], 0.01, rng), add_noise(images[1:], 0.01, rng)]
    np.testing.assert_array_equal(add_noise(images, 0.01, np.random.default_rng(5)), np.concatenate(parts))


@pytest.mark.parametrize(("name", "low", "high"), [("contrast-low", 26, 200), ("contrast-high", 174, 240)])
def test_contrast_maps_black_and_white_as_printed(name, low, high):
    mapped = corrupt(GRAYS, name, seed=0)
    assert (mapped.min(), mapped.max()) == (low, high)
    exact = low + (high - low) * (GRAYS / 255)
    assert np.abs(mapped - exact).max() <= 0.5 + 1e-9  # rounded to the nearest gray


@given(st.floats(0, 0.99), st.floats(0.01, 1))
def test_contrast_keeps_the_order_of_grays(low, share):
    mapped = set_contrast(GRAYS, low, low + share * (1 - low)).astype(int).ravel()
    assert np.all(np.diff(mapped) >= 0)
    assert mapped[0] == int(255 * low + 0.5)


def test_full_contrast_changes_nothing():
    np.testing.assert_array_equal(set_contrast(GRAYS, 0.0, 1.0), GRAYS)


def test_input_is_left_alone():
    images = constant(50)
    for name in CORRUPTIONS:
        corrupt(images, name, seed=0)
    np.testing.assert_array_equal(images, constant(50))


def test_no_images_give_no_images():
    for name in CORRUPTIONS:
        assert corrupt(np.empty((0, 4, 5), np.uint8), name, seed=0).shape == (0, 4, 5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: corrupt(GRAYS, "fog", 0), "noise-low"),
        (lambda: corrupt(GRAYS, "noise-low", -1), "seed"),
        (lambda: corrupt(GRAYS, "noise-low", 0, first=-1), "first"),
        (lambda: add_noise(GRAYS, -0.1, np.random.default_rng(0)), "variance"),
        (lambda: add_noise(GRAYS, float("nan"), np.random.default_rng(0)), "variance"),
        (lambda: set_contrast(GRAYS, 0.5, 0.5), "contrast"),
        (lambda: set_contrast(GRAYS, 0.5, 1.1), "contrast"),
        (lambda: set_contrast(GRAYS, float("nan"), 1.0), "contrast"),
        (lambda: set_contrast(GRAYS[0], 0.0, 1.0), "frame axis"),
        (lambda: corrupt(GRAYS / 255, "noise-low", 0), "uint8"),
    ],
)
def test_wrong_input_is_refused_in_a_sentence(call, message, monkeypatch):
    # A user has no shape checks from the test set-up.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(InputError, match=message):
        call()
