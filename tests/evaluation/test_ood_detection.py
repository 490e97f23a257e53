import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.evaluation.ood_detection import auroc, evaluate_ood_detection, ood_detection_table
from exosight.vision import BACKGROUND, OOD_KINDS

numbers = st.lists(st.integers(-5, 5), min_size=1, max_size=20).map(lambda values: np.array(values, float))


@given(numbers, numbers)
def test_auroc_is_the_share_of_pairs_in_order(usual: np.ndarray, ood: np.ndarray) -> None:
    pairs = np.sign(ood[:, None] - usual[None])
    assert auroc(usual, ood) == pytest.approx(np.mean((pairs + 1) / 2))
    assert auroc(usual, ood) + auroc(ood, usual) == pytest.approx(1)


def test_scores_that_are_not_finite_or_missing_are_refused() -> None:
    for usual, ood in (([], [1.0]), ([1.0], []), ([1.0], [np.nan])):
        with pytest.raises(InputError, match="scores: expected finite numbers of at least one image each"):
            auroc(np.array(usual), np.array(ood))


def pictures(count: int) -> np.ndarray:
    """A dark square before the renderer's background."""
    images = np.full((count, 32, 32), BACKGROUND, np.uint8)
    images[:, 8:20, 8:20] = 60
    return images


def background_gone(images: np.ndarray, places: np.ndarray | None = None) -> np.ndarray:
    """1.5 where less than a twentieth of the picture is the renderer's background, 0.5 elsewhere."""
    return np.where(np.mean(images == BACKGROUND, axis=(1, 2)) < 1 / 20, 1.5, 0.5)


def test_every_kind_is_judged_against_clean_images() -> None:
    images = pictures(12)
    found = {
        f.kind: f for f in evaluate_ood_detection(background_gone, images, background_gone(images), seed=0)
    }
    assert list(found) == ["held-out backgrounds", "held-out occlusions", *OOD_KINDS]
    assert {f.frames for f in found.values()} == {12}
    # What paints over all of the background is found; what hides at most a quarter of the picture is not;
    # and so is not what the renderer's background alone fills.
    assert (found["held-out backgrounds"].auroc, found["held-out backgrounds"].flagged) == (1.0, 1.0)
    assert (found["speckle"].auroc, found["speckle"].flagged) == (1.0, 1.0)
    assert (found["held-out occlusions"].auroc, found["held-out occlusions"].flagged) == (0.5, 0.0)
    assert (found["bare"].auroc, found["bare"].flagged) == (0.5, 0.0)
    rows = ood_detection_table("ood", "OOD", tuple(found.values())).rows
    assert rows[0] == ("held-out backgrounds", 12, 1.0, 100.0)


def test_images_before_other_backgrounds_are_given_no_new_ones() -> None:
    found = evaluate_ood_detection(background_gone, np.zeros((4, 32, 32), np.uint8), np.full(4, 0.5), seed=0)
    assert [f.kind for f in found] == list(OOD_KINDS)


def test_every_picture_stands_in_for_a_frame_of_the_test_part() -> None:
    """What is made from a frame stands in its own place, whatever is seen beside it."""
    images = pictures(12)
    images[:, 14, 14] = np.arange(12)  # well within the square, which another background leaves alone
    held_out: list[np.ndarray] = []

    def ood(others: np.ndarray, places: np.ndarray) -> np.ndarray:
        assert places.shape == (len(others),)
        assert sorted(places) == list(range(12))
        held_out.append(others[np.argsort(places)])
        return np.zeros(len(others))

    evaluate_ood_detection(ood, images, np.zeros(12), seed=0)
    assert np.array_equal(held_out[0][:, 10:18, 10:18], images[:, 10:18, 10:18])
