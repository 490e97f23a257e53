"""What training images go through: moved by whole pixels, faded linearly, noisy as stated, and repeatable."""

import numpy as np
import pytest

from exosight.learning.augmentation import FADED, NOISE, NOISE_MEAN, NOISY, augment_batch, shifted


def test_images_move_by_whole_pixels_and_their_border_repeats():
    generator = np.random.default_rng(0)
    images = generator.integers(0, 256, (40, 120, 80), np.uint8)
    moves = set()
    for image, other in zip(images, shifted(images[:, None], generator)[:, 0], strict=True):
        # Largest moves: 120 // 40 rows and 80 // 40 columns. The inner part says which move it was.
        padded = np.pad(image, ((3, 3), (2, 2)), mode="edge")
        fits = [
            (y, x)
            for y in range(7)
            for x in range(5)
            if np.array_equal(padded[y : y + 120, x : x + 80], other)
        ]
        assert len(fits) == 1
        moves.update(fits)
    assert {y for y, _ in moves} == set(range(7))
    assert {x for _, x in moves} == set(range(5))


def test_small_images_stay_where_they_are():
    images = np.random.default_rng(0).integers(0, 256, (8, 1, 39, 39), np.uint8)
    assert np.array_equal(shifted(images, np.random.default_rng(1)), images)


def test_what_happens_follows_from_seed_epoch_and_step_alone():
    images = np.random.default_rng(0).integers(0, 256, (8, 1, 80, 80), np.uint8)
    found = [augment_batch(images, *key).tobytes() for key in [(1, 2, 3), (2, 2, 3), (1, 3, 3), (1, 2, 4)]]
    assert found[0] == augment_batch(images, 1, 2, 3).tobytes()
    assert len(set(found)) == 4


def test_shares_ranges_and_noise_are_as_stated():
    """Half black, half white, 32×32: each half's mean tells the grays, its spread the noise."""
    images = np.zeros((2000, 32, 32), np.uint8)
    images[:, 16:] = 255
    found = augment_batch(images[:, None], seed=0, epoch=1, step=0)[:, 0]
    assert found.dtype == np.float32
    assert found.min() >= 0
    assert found.max() <= 1
    low, high = found[:, :16].mean((1, 2)), found[:, 16:].mean((1, 2))
    noisy = found[:, :16].std((1, 2)) > 1e-6
    clean = ~noisy
    # Shares of 2000 coin tosses: four standard deviations.
    assert noisy.mean() == pytest.approx(NOISY, abs=4 * 0.5 / np.sqrt(2000))
    faded = clean & (high - low < 1 - 1e-6)
    assert faded.sum() / clean.sum() == pytest.approx(FADED, abs=4 * 0.5 / np.sqrt(clean.sum()))
    share = (high - low)[faded] / (1 - low[faded])
    assert low[faded].max() <= 0.7
    assert 0.25 - 1e-6 <= share.min() <= share.max() <= 1
    # In faded grays far from both limits nothing is clipped: the noise can be measured.
    inside = noisy & (low > 0.3) & (low < 0.7)
    spread = found[inside, :16].std((1, 2))
    assert spread[spread < 0.1].min() >= 0.9 * NOISE[0]
    weak = noisy & (low > 0.3) & (high < 0.8) & (found[:, :16].std((1, 2)) < 0.05)
    assert weak.any()
    assert NOISE_MEAN == 0.01


def test_parts_of_a_step_have_draws_of_their_own_which_are_always_the_same() -> None:
    images = np.full((4, 1, 40, 40), 128, np.uint8)
    first, second = augment_batch(images, 3, 1, 2), augment_batch(images, 3, 1, 2, 1)
    assert (first == augment_batch(images, 3, 1, 2, 0)).all()
    assert (second == augment_batch(images, 3, 1, 2, 1)).all()
    assert (first != second).any()
    assert (second != augment_batch(images, 3, 1, 2, 2)).any()


def test_the_images_of_a_stack_are_moved_and_faded_alike_and_have_noise_of_their_own():
    """Three times the same picture: without noise it stays the same, with noise only the noise differs."""
    rng = np.random.default_rng(0)
    images = np.repeat(rng.integers(0, 256, (400, 1, 40, 40), np.uint8), 3, axis=1)
    found = augment_batch(images, seed=0, epoch=1, step=0)
    same = np.all(found == found[:, :1], axis=(1, 2, 3))
    # Half of the stacks have noise, within four standard deviations of 400 coin tosses; it is in every image.
    assert same.mean() == pytest.approx(1 - NOISY, abs=4 * 0.5 / np.sqrt(400))
    noisy = found[~same]
    assert np.all(np.any(noisy[:, 1] != noisy[:, 2], axis=(1, 2)))
    # Noise of equal strength in all three: 1600 grays each, some clipped, tell the spread to a few per cent.
    differences = [(noisy[:, i] - noisy[:, j]).std((1, 2)) for i, j in ((0, 1), (1, 2))]
    np.testing.assert_allclose(differences[0], differences[1], rtol=0.2)
