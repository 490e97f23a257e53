"""Pictures without the plant: the same again from the same seed, and unlike the plant's."""

import numpy as np
import pytest

from exosight.errors import InputError
from exosight.vision import HELD_OUT, OOD_KINDS, TRAINING, augment, draw_appearance, draw_ood_images


@pytest.mark.parametrize("kind", OOD_KINDS)
def test_a_picture_depends_on_seed_and_place_alone(kind: str) -> None:
    images = draw_ood_images(kind, 4, seed=3, width=96, height=64)
    assert images.shape == (4, 64, 96)
    np.testing.assert_array_equal(draw_ood_images(kind, 2, seed=3, width=96, height=64), images[:2])
    assert len({image.tobytes() for image in images}) == 4
    assert np.any(draw_ood_images(kind, 4, seed=4, width=96, height=64) != images)


@pytest.mark.parametrize("kind", OOD_KINDS)
def test_no_picture_is_like_one_of_the_plant(kind: str, clean: np.ndarray) -> None:
    for image in draw_ood_images(kind, 6, seed=0).astype(float):
        assert np.sqrt(np.mean((image - clean) ** 2, axis=(1, 2))).min() > 20  # grays


def test_clouds_have_the_spectrum_of_natural_pictures() -> None:
    """Power falls with frequency, as a power between 1.6 and 3.2; steps are in octaves."""
    power = np.abs(np.fft.rfft2(draw_ood_images("clouds", 20, 0).astype(float), axes=(1, 2))) ** 2
    radius = np.hypot(np.fft.fftfreq(128)[:, None], np.fft.rfftfreq(128)[None])
    bands = [power[:, (radius >= low) & (radius < 2 * low)].mean(axis=1) for low in (1 / 64, 1 / 32, 1 / 16)]
    slopes = np.log2(np.array(bands[:-1]) / np.array(bands[1:]))
    assert np.all(slopes.mean(axis=0) > 1.0)  # clipping whitens a little
    assert np.all(slopes.mean(axis=0) < 3.7)


def test_what_is_held_out_is_not_trained_with(clean: np.ndarray) -> None:
    assert not set(HELD_OUT["backgrounds"].backgrounds) & set(TRAINING.backgrounds)
    assert not set(HELD_OUT["occlusions"].occlusions) & set(TRAINING.occlusions)
    for variation in HELD_OUT.values():
        seen = augment(clean, draw_appearance(variation, 0, np.arange(len(clean))))
        assert np.all(np.any(seen != clean, axis=(1, 2)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "cats"}, "plain"),
        ({"count": -1}, "count"),
        ({"seed": -1}, "seed"),
        ({"width": 3}, "16 pixels"),
    ],
)
def test_impossible_requests_are_refused(change: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        draw_ood_images(**{"kind": "plain", "count": 1, "seed": 0, **change})
