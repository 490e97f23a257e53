"""What a network is to say of its own estimates: the probability of a large error, and what is unusual.

Both are fitted when a network is exported, on frames that it has not learned from: as they are, with one
disturbance each, and on images of other things.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float32

from exosight.learning.causes import EACH, CauseClassifier, fit_causes, training_sets, unrelated
from exosight.learning.large_error import LargeError, fit_large_error
from exosight.learning.networks import SensorModel
from exosight.learning.ood import Inputs, OodDetector, batches
from exosight.system.schema import Schema
from exosight.vision.disturbances import is_clean

FEWEST = 100
"""Frames below which no probability is fitted."""

_OF_A_KIND = 32


class Reliability(NamedTuple):
    """None where there were too few frames, or the network has earlier images as inputs."""

    large_error: LargeError | None
    causes: CauseClassifier | None


def fit_reliability(
    model: SensorModel,
    ood: OodDetector,
    schema: Schema,
    seen: Inputs,
    labels: Float32[np.ndarray, "frames outputs"],
) -> Reliability:
    """From frames that the network has not learned from, and what their estimated sensors read.

    There are as many frames as they are as disturbed ones, if there are so many. Only clean images can be
    disturbed, and without 512 of them there are no causes; nor are there of a network with commands as an
    input.
    """
    images, commands = seen
    if len(images) < FEWEST or images.shape[1] > 1:
        return Reliability(None, None)
    rng = np.random.default_rng(0)
    clean = np.flatnonzero(is_clean(images[:, 0])) if commands is None else np.arange(0)
    causes, parts, truth = None, [], []
    kept = np.arange(len(images))
    if len(clean) >= EACH:
        picked = rng.choice(clean, EACH, replace=False)
        sets = training_sets(images[picked, 0], 0)
        causes = fit_causes(model, ood, sets)
        changed = sets[1:-1]
        parts = [_judged(model, ood, (each[:, None], None)) for each in changed]
        truth = [labels[picked]] * len(changed)
        kept = rng.permutation(kept)[: EACH * len(changed)]
    usual = images[kept], None if commands is None else commands[kept]
    parts.append(_judged(model, ood, usual))
    truth.append(labels[kept])
    values, error, score = (np.concatenate(each) for each in zip(*parts, strict=True))
    others = error[:0], score[:0]
    if causes is None:  # which tells by itself that the device is not shown
        pictures = unrelated(_OF_A_KIND, images.shape[2:], 0)[:, None]
        loads = None if commands is None else np.resize(commands, (len(pictures), commands.shape[1]))
        _, *others = _judged(model, ood, (pictures, loads))
    large_error = fit_large_error(
        schema, labels, values, error, np.concatenate(truth), score, (others[0], others[1])
    )
    return Reliability(large_error, causes)


def _judged(model: SensorModel, ood: OodDetector, seen: Inputs) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, the errors to be expected of them, and OOD scores as shares of the limit."""
    parts = []
    with torch.inference_mode():
        for image, commands in batches(*seen):
            features = model.network.features(image, commands)
            values, error, _ = model.read(features)
            parts.append([x.numpy() for x in (values, error, ood(image, features) / ood.limit)])
    values, error, score = (np.concatenate(each) for each in zip(*parts, strict=True))
    return values, error, score
