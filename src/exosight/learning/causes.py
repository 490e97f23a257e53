"""What is unusual about an image, by a linear classifier on the network's features and the OOD residual.

The classifier learns from clean images of which each differs in one respect (`exosight.vision.disturbances`),
or in none. Its inputs are the network's last features, and the mean squared residual of the OOD detector's
reconstruction in 8×8 fields of the image: where the reconstruction fails says whether something lies before
the device, behind it, or all of it has moved.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor, nn

from exosight.learning.large_error import NOT_SHOWN
from exosight.learning.networks import SensorModel
from exosight.learning.ood import OodDetector, batches
from exosight.vision.disturbances import DISTURBANCES, disturbed
from exosight.vision.ood_images import draw_ood_images

CAUSES = (*DISTURBANCES, NOT_SHOWN)
"""What may be unusual about an image, in the order of the classifier's answers."""

UNRELATED = ("plain", "speckle", "clouds", "shapes")
"""Kinds of image without the system to learn from; the others of OOD_KINDS are for tests."""

EACH = 512
"""Images with each disturbance to learn from; a network with fewer clean ones has no classifier."""

_FIELDS = 8
_RIDGE = 1e-3
_FAINT = 1e-4  # least squared residual of a field [the picture's variance]
_STEPS = 200


class CauseClassifier(nn.Module):
    """Probabilities of the causes from features and residual of the OOD detector; the rest is no cause."""

    def __init__(self, features: int, size: tuple[int, int], causes: int = len(CAUSES)):
        super().__init__()
        self.small = size[0] // 4, size[1] // 4
        self.field = tuple(max(1, side // _FIELDS) for side in self.small)
        fields = np.prod([side // step for side, step in zip(self.small, self.field, strict=True)])
        self.linear = nn.Linear(features + int(fields), 1 + causes)

    def forward(
        self, features: Float[Tensor, "batch features"], residual: Float[Tensor, "batch places"]
    ) -> Float[Tensor, "batch causes"]:
        """Of each cause; they and the probability of none sum to 1."""
        found = torch.softmax(self.linear(self.given(features, residual)), dim=1)
        return found[:, 1 : self.linear.out_features]

    def given(
        self, features: Float[Tensor, "batch features"], residual: Float[Tensor, "batch places"]
    ) -> Float[Tensor, "batch given"]:
        """The classifier's inputs."""
        fields = nn.functional.avg_pool2d((residual**2).reshape(-1, 1, *self.small), self.field)
        return torch.cat([features, (fields.flatten(1) + _FAINT).log()], dim=1)


def fit_causes(
    model: SensorModel, ood: OodDetector, sets: list[UInt8[np.ndarray, "_ height width"]]
) -> CauseClassifier:
    """From images as they are, and with each of the causes, in this order (see `training_sets`)."""
    size = sets[0].shape[1:]
    parts = []
    with torch.inference_mode():
        for images in sets:
            for image, _ in batches(images[:, None], None):
                features = model.network.features(image)
                parts.append((features, ood.residual(image, features)))
    features, residual = (torch.cat(each) for each in zip(*parts, strict=True))
    found = CauseClassifier(features.shape[1], size, len(sets) - 1)
    kind = np.repeat(np.arange(len(sets)), [len(images) for images in sets])
    _fit(found.linear, found.given(features, residual).double(), torch.from_numpy(kind))
    return found.eval()


def training_sets(
    images: UInt8[np.ndarray, "frames height width"], seed: int
) -> list[UInt8[np.ndarray, "_ height width"]]:
    """Clean images as they are, and with each of the causes; about as many images of other things."""
    changed = [disturbed(images, ways, seed + k) for k, ways in enumerate(DISTURBANCES.values())]
    return [images, *changed, unrelated(-(-len(images) // len(UNRELATED)), images.shape[1:], seed)]


def unrelated(
    count: int, size: tuple[int, ...], seed: int, kinds: Sequence[str] = UNRELATED
) -> UInt8[np.ndarray, "images height width"]:
    """So many images of each kind without the system."""
    height, width = size
    return np.concatenate([draw_ood_images(kind, count, seed, width, height) for kind in kinds])


def _fit(linear: nn.Linear, given: Float[Tensor, "frames given"], kind: Int[Tensor, " frames"]) -> None:
    """Multinomial logistic regression of standardised inputs with a ridge, by L-BFGS."""
    mean, scale = given.mean(0), given.std(0) + 1e-6
    given = (given - mean) / scale
    weight = torch.zeros(linear.out_features, given.shape[1], dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(linear.out_features, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.LBFGS([weight, bias], max_iter=_STEPS, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        optimizer.zero_grad()
        found = nn.functional.cross_entropy(given @ weight.T + bias, kind) + _RIDGE * (weight**2).sum()
        found.backward()
        return found

    optimizer.step(loss)
    with torch.no_grad():
        linear.weight.copy_(weight / scale)
        linear.bias.copy_(bias - weight @ (mean / scale))
