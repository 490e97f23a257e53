"""Where the camera has moved to, as pictures and labels of a new set-up tell it."""

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from exosight.learning.adaptation.labelled import Labelled
from exosight.learning.adaptation.methods import scaled
from exosight.learning.networks import SensorModel, answers
from exosight.learning.ood import OodDetector, batches
from exosight.learning.registration import (
    Homography,
    Objective,
    Registration,
    descend,
    find_registrations,
    lowest,
    registered,
)

_PICTURES = 24
"""How many are looked at without their labels, and as many others to judge what was found."""
_LABELLED = 64
"""With their labels, at most."""
_WEIGHT, _CORNER = 20.0, 0.1
"""Of the error of the outputs beside the OOD score, and from where on it counts as its absolute value [the
outputs' scale]. On four moved cameras with 30 labels, a weight of 1 brought r back to 0.84 in the mean, of 5
to 0.91, of 20 to 0.92, which is what it was before the move."""
_BETTER = 0.8
"""Without labels, the OOD score must fall to this share on pictures that were not looked at, or the camera
counts as where it was: eight numbers always find a little."""


class View:
    """The camera of a new set-up, searched for once from pictures alone.

    former   the homography that the network has been given before, if there is one
    """

    def __init__(
        self,
        detector: OodDetector,
        model: SensorModel,
        pictures: Labelled,
        former: Homography | None,
        seed: int,
        known: bool,
    ):
        """`known`: whether the network's outputs are those that labels are of."""
        self.former = former
        self._detector, self._model, self._known, self._seed = detector, model, known, seed
        order = np.random.default_rng([seed, len(pictures)]).permutation(len(pictures))
        self._looked_at = pictures.take(order[:_PICTURES])
        more = order[_PICTURES : 2 * _PICTURES]
        self._kept = pictures.take(more if len(more) else order)
        self._places = find_registrations(self._score(self._looked_at), seed, former)

    def without_labels(self) -> Homography | None:
        """The best by the OOD score alone, or the former where it is not clearly better."""
        score, best = self._score(self._kept), self._places[0]
        former = torch.zeros(8) if self.former is None else self.former
        with torch.inference_mode():
            return best if score(best) < _BETTER * score(former) else self.former

    def with_labels(self, data: Labelled) -> Homography:
        """The best by OOD score and errors together, from where pictures alone have led to."""
        if not self._known:
            return self._places[0]
        rows = np.random.default_rng([self._seed, len(data)]).permutation(len(data))[:_LABELLED]
        few = data.take(np.sort(rows))
        (images, commands), wanted = few.tensors(), scaled(self._model, few)
        score, network = self._score(self._looked_at), self._model.network

        def objective(place: Homography) -> Float[Tensor, ""]:
            found = answers(network(registered(images, place), commands), network.outputs).values
            return score(place) + _WEIGHT * nn.functional.smooth_l1_loss(found, wanted, beta=_CORNER)

        return descend(objective, lowest(objective, self._places, 1))[0]

    def _score(self, pictures: Labelled) -> Objective:
        """Mean OOD score by homography."""
        images, commands = pictures.tensors()
        network, detector = self._model.network, self._detector

        def objective(place: Homography) -> Float[Tensor, ""]:
            seen = registered(images, place)
            return detector(seen, network.features(seen, commands)).mean()

        return objective


def through(homography: Homography | None, data: Labelled) -> Labelled:
    """Pictures as a network sees them through a homography, in whole gray values."""
    if homography is None:
        return data
    view = Registration(homography, data.images.shape[-2:])
    with torch.inference_mode():
        parts = [(view(part) * 255).round().byte().numpy() for part, _ in batches(data.images, None)]
    return replace(data, images=np.concatenate(parts))
