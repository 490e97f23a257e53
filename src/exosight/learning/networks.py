"""The two networks: image in, forces on C1…C7 out."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from exosight.errors import InputError
from exosight.learning.samples import CONTACTS

ImageSize = tuple[int, int]
"""(height, width) [pixels]"""


class PaperNetwork(nn.Sequential):
    """The published network: five 3×3 convolutions without padding, four max-pools, four dense layers.

    128×128 images only; 78,847 parameters, which needs batch normalisation after all five convolutions and
    seven outputs (the paper's text has four and eight, and no such network has its parameter count).
    """

    def __init__(self, image_size: ImageSize = (128, 128)):
        if image_size != (128, 128):
            raise InputError(
                f"the paper network needs 128×128 images, got {_size(image_size)}; use the light one"
            )
        layers: list[nn.Module] = []
        channels = 1
        for number, filters in enumerate((64, 64, 32, 32, 8)):
            layers += [nn.Conv2d(channels, filters, 3), nn.BatchNorm2d(filters), nn.ReLU()]
            if number < 4:
                layers.append(nn.MaxPool2d(2))
            channels = filters
        layers.append(nn.Flatten())
        for features, outputs in ((128, 32), (32, 64), (64, 64)):
            layers += [nn.Linear(features, outputs), nn.ReLU()]
        super().__init__(*layers, nn.Linear(64, len(CONTACTS)))


class LightNetwork(nn.Sequential):
    """A strided network: each convolution halves the image, so it costs a small part of the paper's.

    Any image of at least 32×32; at 128×128 it takes 14 M multiply-adds (the paper's: 162 M). The first kernel
    is 5×5, since it alone sees the pixels; batch normalisation makes the convolutions' own biases redundant.
    """

    def __init__(self, image_size: ImageSize = (128, 128)):
        if min(image_size) < 32 or max(image_size) > 4096:
            raise InputError(
                f"the light network needs images of 32 to 4096 pixels a side, got {_size(image_size)}"
            )
        layers: list[nn.Module] = []
        channels = 1
        for filters, kernel in ((16, 5), (32, 3), (64, 3), (64, 3), (64, 3)):
            layers.append(nn.Conv2d(channels, filters, kernel, stride=2, padding=kernel // 2, bias=False))
            layers += [nn.BatchNorm2d(filters), nn.ReLU()]
            channels = filters
        height, width = (-(-side // 32) for side in image_size)
        layers += [nn.Flatten(), nn.Linear(channels * height * width, 64), nn.ReLU()]
        super().__init__(*layers, nn.Linear(64, len(CONTACTS)))


NETWORKS: dict[str, type[PaperNetwork] | type[LightNetwork]] = {"light": LightNetwork, "paper": PaperNetwork}


def build_network(name: str, image_size: ImageSize, seed: int) -> nn.Sequential:
    """Build a network whose first weights follow from the seed alone; the global generator is left as it was.

    Raises InputError if the network cannot take images of that size.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return NETWORKS[name](image_size)


class ForceModel(nn.Module):
    """A network with its unit: forces = max(0, scale · network(image)).

    Labels are magnitudes, so a negative answer is always wrong and zero always nearer. The loss is taken
    before the limit, where the gradient never vanishes.
    """

    def __init__(self, network: nn.Sequential, scale: Float[Tensor, "7"]):
        super().__init__()
        self.network = network
        self.register_buffer("scale", scale)

    def forward(self, image: Float[Tensor, "batch 1 height width"]) -> Float[Tensor, "batch 7"]:
        """Forces on C1…C7 [N] from images in [0, 1]."""
        return torch.relu(self.network(image) * self.scale)


def _size(image_size: ImageSize) -> str:
    return "×".join(str(side) for side in image_size)
