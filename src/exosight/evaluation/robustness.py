"""The estimator on degraded images: the paper's noise and contrast cases (its section II-D, Table 4)."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, UInt8

from exosight.evaluation.metrics import Scores, score
from exosight.vision.corruptions import CORRUPTIONS, corrupt

Estimate = Callable[[UInt8[np.ndarray, "frames height width"]], Float[np.ndarray, "frames 7"]]
"""Images → the seven contact forces [N]."""

CLEAN = "clean"


def evaluate_robustness(
    estimate: Estimate,
    images: UInt8[np.ndarray, "frames height width"],
    forces: Float[np.ndarray, "frames 7"],
    seed: int,
) -> dict[str, Scores]:
    """Score the estimator on the clean images and on each corruption of them.

    estimate  images → forces [N]; it never sees the seed, so every estimator gets the same noise
    images    (frames, height, width)   gray levels 0…255
    forces    (frames, 7)               true f_C1…f_C7 [N]
    seed      of the noise
    returns   "clean" and every name in CORRUPTIONS, in that order

    Raises InputError where `score` does.
    """
    cases = {CLEAN: score(forces, estimate(images))}
    for name in CORRUPTIONS:
        cases[name] = score(forces, estimate(corrupt(images, name, seed)))
    return cases
