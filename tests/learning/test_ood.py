"""The OOD score: small for pictures of the family that it was fitted on, large for any others."""

import numpy as np
import pytest
import torch
from schemas import published_schema

from exosight.learning.networks import SensorModel, build_network
from exosight.learning.ood import NOISE, SHARE, OodDetector, fit_ood_detector
from exosight.vision.corruptions import add_noise


def pictures(count: int, seed: int) -> np.ndarray:
    """Blobs of 32×32, anywhere near the middle."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:32, :32] / 32
    a, b = rng.uniform(0.4, 0.6, (2, count, 1, 1))
    return (255 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 0.05)).astype(np.uint8)


@pytest.fixture(scope="module")
def model() -> SensorModel:
    """Untrained: random features of a picture tell the blob's place as well."""
    return SensorModel(
        build_network("light", published_schema(32, 32), 0, 3), torch.ones(7), np.ones(7, dtype=bool)
    ).eval()


@pytest.fixture(scope="module")
def fitted(model: SensorModel) -> OodDetector:
    return fit_ood_detector(model, (pictures(600, 0)[:, None], None))


def score(model: SensorModel, fitted: OodDetector, images: np.ndarray) -> np.ndarray:
    part = torch.from_numpy(images[:, None]).float() / 255
    with torch.inference_mode():
        return fitted(part, model.network.features(part)).numpy()


def test_other_pictures_score_higher_than_any_of_the_family(model: SensorModel, fitted: OodDetector) -> None:
    alike = score(model, fitted, pictures(300, 1))
    rng = np.random.default_rng(2)
    stripes = np.tile(np.uint8(255) * (np.arange(32, dtype=np.uint8) // 4 % 2), (20, 32, 1))
    noise = rng.integers(0, 256, (20, 32, 32), np.uint8)
    covered = pictures(20, 3)
    covered[:, 4:12, 4:28] = 200
    for odd in (stripes, noise, covered, 255 - pictures(20, 4)):
        assert score(model, fitted, odd).min() > alike.max()


def test_the_family_is_under_the_limit_with_the_noise_that_it_allows(
    model: SensorModel, fitted: OodDetector
) -> None:
    alike = score(model, fitted, pictures(300, 1))
    assert np.mean(alike) < 1  # the floor of what counts as usual makes it smaller
    assert np.quantile(alike, 0.99) < fitted.limit
    noisy = add_noise(pictures(300, 1), NOISE, np.random.default_rng(9))
    # 99 % by construction, on 300 other frames: four standard deviations of that count.
    assert np.mean(score(model, fitted, noisy) < fitted.limit) > SHARE - 4 * np.sqrt(0.01 / 300)


def test_contrast_does_not_matter(model: SensorModel, fitted: OodDetector) -> None:
    images = pictures(50, 5)
    faded = (60 + 0.5 * images).astype(np.uint8)
    # What is left of it: rounding to whole grays, and the floor of 1/100 under the standard deviation.
    assert np.abs(score(model, fitted, faded) - score(model, fitted, images)).max() < 0.3
