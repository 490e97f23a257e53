import numpy as np
import pytest
from schemas import published_schema

from exosight.errors import InputError
from exosight.evaluation.metrics import score
from exosight.evaluation.published import ROBUSTNESS_PUBLISHED
from exosight.evaluation.robustness import evaluate_robustness
from exosight.vision.corruptions import CORRUPTIONS, corrupt

SCHEMA = published_schema()


def frames(count: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """Images whose seven column groups are as bright as the seven forces are large."""
    forces = np.random.default_rng(0).uniform(0, 1, (count, 7)).astype(np.float32)
    bright = np.repeat(40 + 160 * forces, 3, axis=1)
    return np.repeat(bright[:, None, :], 8, axis=1).astype(np.uint8), forces


def read_brightness(images: np.ndarray) -> np.ndarray:
    columns = images.astype(np.float32).mean(axis=1)
    return (columns.reshape(len(images), 7, 3).mean(axis=2) - 40) / 160


def test_every_published_case_is_judged_in_order():
    images, forces = frames()
    cases = evaluate_robustness(SCHEMA, read_brightness, images, forces, seed=0)
    assert list(cases) == ["clean", *CORRUPTIONS]
    assert set(cases) == set(ROBUSTNESS_PUBLISHED)


def test_each_case_is_scored_on_its_corruption():
    images, forces = frames()
    cases = evaluate_robustness(SCHEMA, read_brightness, images, forces, seed=3)
    assert cases["clean"] == score(SCHEMA, forces, read_brightness(images))
    for name in CORRUPTIONS:
        assert cases[name] == score(SCHEMA, forces, read_brightness(corrupt(images, name, 3)))


def test_noise_costs_more_the_larger_it_is():
    images, forces = frames()
    cases = evaluate_robustness(SCHEMA, read_brightness, images, forces, seed=0)
    errors = [cases[name].rmse.mean for name in ("clean", "noise-low", "noise-medium", "noise-high")]
    assert errors == sorted(errors)
    assert errors[-1] > 10 * errors[0]


def test_contrast_moves_the_brightness_but_not_its_order():
    images, forces = frames()
    cases = evaluate_robustness(SCHEMA, read_brightness, images, forces, seed=0)
    # A linear map of gray values, rounded to whole ones: 66 levels are left for the forces.
    assert cases["contrast-high"].r.mean > 0.999
    assert cases["contrast-high"].rmse.mean > 10 * cases["clean"].rmse.mean


def test_same_seed_gives_the_same_scores_and_another_does_not():
    images, forces = frames()
    first, again, other = (
        evaluate_robustness(SCHEMA, read_brightness, images, forces, seed) for seed in (1, 1, 2)
    )
    assert first == again
    assert first["noise-high"] != other["noise-high"]


def test_estimator_of_another_size_is_refused():
    images, forces = frames()
    with pytest.raises(InputError, match=r"estimated values: expected shape \(frames, 7\)"):
        evaluate_robustness(
            SCHEMA, lambda images: np.zeros((len(images), 8), np.float32), images, forces, seed=0
        )
