"""The estimator on degraded images: the paper's noise and contrast cases (its section II-D, Table 4)."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, UInt8

from exosight.evaluation.metrics import Scores, score
from exosight.system.schema import Schema
from exosight.vision.corruptions import CORRUPTIONS, corrupt

Estimate = Callable[[UInt8[np.ndarray, "frames height width"]], Float[np.ndarray, "frames outputs"]]
"""Images → the estimated sensors [their units]."""

CLEAN = "clean"


def evaluate_robustness(
    schema: Schema,
    estimate: Estimate,
    images: UInt8[np.ndarray, "frames height width"],
    labels: Float[np.ndarray, "frames outputs"],
    seed: int,
) -> dict[str, Scores]:
    """Score the estimator on the clean images and on each corruption of them.

    schema    of the system whose sensors are estimated
    estimate  images → sensors; it does not depend on the seed, so every estimator gets the same noise
    images    (frames, height, width)   gray levels 0…255
    labels    (frames, outputs)         what the estimated sensors read [their units]
    seed      of the noise
    returns   "clean" and every name in CORRUPTIONS, in that order

    Raises InputError where `score` does.
    """
    cases = {CLEAN: score(schema, labels, estimate(images))}
    for name in CORRUPTIONS:
        cases[name] = score(schema, labels, estimate(corrupt(images, name, seed)))
    return cases
