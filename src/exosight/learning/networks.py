"""The two networks: image in, forces on C1…C7 out."""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from exosight.errors import InputError
from exosight.learning.samples import CONTACTS

ImageSize = tuple[int, int]
"""(height, width) [pixels]"""


class Network(nn.Sequential):
    """Layers one after the other; the last tells the answers from the features."""

    def forward(
        self, input: Float[Tensor, "batch images height width"], u: Float[Tensor, " batch"] | None = None
    ) -> Float[Tensor, "batch outputs"]:
        """The answers; `u` [N] is for a network that is told it."""
        return self.last(self.features(input, u))

    @property
    def last(self) -> nn.Linear:
        """The layer that tells the answers from the features."""
        last = list(self)[-1]
        assert isinstance(last, nn.Linear)
        return last

    def features(
        self, input: Float[Tensor, "batch images height width"], u: Float[Tensor, " batch"] | None = None
    ) -> Float[Tensor, "batch features"]:
        """What the last layer sees."""
        for layer in list(self)[:-1]:
            input = layer(input, u) if isinstance(layer, ActuationEmbedding) else layer(input)
        return input


class PaperNetwork(Network):
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


class LightNetwork(Network):
    """The default: a quarter of the paper's multiply-adds at 128×128 (39 M against 162 M), and more answers.

    The first convolution sees 4×4 pixels as 16 channels, so nothing of the picture is lost and nothing is
    computed at its full size; the rest halve it twice and look again (residual blocks) at 16×16 and 8×8.
    Beside the forces it answers, for each contact, how far off they may be and whether there is contact, and
    `auxiliary` further numbers that are only learned from, such as joint angles.

    `history` earlier images are further channels, newest first: what moved shows in the first convolution.
    With `actuation`, u joins where the picture has become features, before they are rectified: it says
    nothing of any one place, and the last layer can still weigh what is seen by it.

    Any image of 32 to 4096 pixels a side, in multiples of 4.
    """

    def __init__(
        self,
        image_size: ImageSize = (128, 128),
        auxiliary: int = 0,
        history: int = 0,
        actuation: bool = False,
    ):
        if min(image_size) < 32 or max(image_size) > 4096 or any(side % 4 for side in image_size):
            raise InputError(
                "the light network needs images of 32 to 4096 pixels a side, in multiples of 4, "
                f"got {_size(image_size)}"
            )
        height, width = (-(-side // 32) for side in image_size)
        features = 128
        super().__init__(
            Standardise(),
            nn.PixelUnshuffle(4),
            _convolution(16 * (1 + history), 48, 1),
            _convolution(48, 64, 2),
            Residual(64),
            _convolution(64, 96, 2),
            Residual(96),
            Residual(96),
            _convolution(96, 64, 2),
            nn.Flatten(),
            nn.Linear(64 * height * width, features),
            *([ActuationEmbedding(features)] if actuation else []),
            nn.ReLU(),
            nn.Linear(features, 3 * len(CONTACTS) + auxiliary),
        )


class Standardise(nn.Module):
    """Each image minus its mean, over its standard deviation: whatever the contrast, the same picture."""

    def forward(
        self, image: Float[Tensor, "batch images height width"]
    ) -> Float[Tensor, "batch images height width"]:
        """At a standard deviation under 1/100 of full scale the picture is left fainter than the others."""
        centred = image - image.mean((2, 3), keepdim=True)
        return centred / ((centred**2).mean((2, 3), keepdim=True) + 1e-4).sqrt()


class ActuationEmbedding(nn.Module):
    """What u adds to features; over a path it spreads by about 1 N, so newtons need no scale."""

    def __init__(self, features: int):
        super().__init__()
        self.share = nn.Linear(1, features)

    def forward(
        self, features: Float[Tensor, "batch features"], u: Float[Tensor, " batch"]
    ) -> Float[Tensor, "batch features"]:
        """Features + share(u)."""
        return features + self.share(u[:, None])


class Residual(nn.Module):
    """What a convolution adds to its input."""

    def __init__(self, channels: int):
        super().__init__()
        self.change = _convolution(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """x + change(x)."""
        return x + self.change(x)


def _convolution(channels: int, filters: int, stride: int) -> nn.Sequential:
    """3×3, normalised (which makes a bias redundant), rectified."""
    layer = nn.Conv2d(channels, filters, 3, stride=stride, padding=1, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(filters), nn.ReLU())


NETWORKS = ("light", "paper")


def build_network(
    name: str, image_size: ImageSize, auxiliary: int, seed: int, history: int = 0, actuation: bool = False
) -> Network:
    """Build a network whose first weights follow from the seed alone; the global generator is left as it was.

    auxiliary   further numbers that a light network learns; the paper's has the seven forces only
    history        earlier images that a light network sees; the paper's sees one
    actuation   whether a light network is told u; the paper's is not

    Raises InputError if the network cannot take images of that size.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        if name == "paper":
            return PaperNetwork(image_size)
        return LightNetwork(image_size, auxiliary, history, actuation)


FORCES, LOG_SPREAD, CONTACT = (slice(len(CONTACTS) * i, len(CONTACTS) * (i + 1)) for i in range(3))
"""Places of the answers among a network's outputs; a network that tells forces alone has the first only."""


class Answers(NamedTuple):
    """What a network says about a batch of images, forces in units of their scale.

    forces      (batch, 7)
    log_spread  (batch, 7) natural logarithm of the error to be expected of each; None if it does not tell
    contact     (batch, 7) log odds that there is contact; None likewise
    auxiliary   (batch, n) what is learned beside
    """

    forces: Tensor
    log_spread: Tensor | None
    contact: Tensor | None
    auxiliary: Tensor


def answers(output: Float[Tensor, "batch outputs"]) -> Answers:
    """The parts of a network's output."""
    if output.shape[1] == FORCES.stop:
        return Answers(output, None, None, output[:, :0])
    forces, spread, contact = (output[:, part] for part in (FORCES, LOG_SPREAD, CONTACT))
    # Between a 400th and 50 times the scale: beyond, one outlier would rule the loss.
    return Answers(forces, spread.clamp(-6, 4), contact, output[:, CONTACT.stop :])


class ForceModel(nn.Module):
    """A network with its units: images in [0, 1], and u [N] if it is told, to what is asked of an estimator.

    Labels are magnitudes, so a negative force is always wrong and zero always nearer. The loss is taken
    before the limit, where the gradient never vanishes.
    """

    scale: Tensor

    def __init__(self, network: Network, scale: Float[Tensor, "7"]):
        super().__init__()
        self.network = network
        self.register_buffer("scale", scale)

    def forward(
        self, image: Float[Tensor, "batch images height width"], u: Float[Tensor, " batch"] | None = None
    ) -> tuple[Float[Tensor, "batch 7"], Float[Tensor, "batch 7"], Float[Tensor, "batch 7"]]:
        """Forces on C1…C7 [N], the error to be expected of each [N], and the probability of contact.

        A network that tells neither of the last two is taken to err by the same everywhere, and to see
        contact where it sees a force.
        """
        return self.read(self.network.features(image, u))

    def read(
        self, features: Float[Tensor, "batch features"]
    ) -> tuple[Float[Tensor, "batch 7"], Float[Tensor, "batch 7"], Float[Tensor, "batch 7"]]:
        """The three answers, from the features of images."""
        found = answers(self.network.last(features))
        forces = torch.relu(found.forces * self.scale)
        if found.log_spread is None or found.contact is None:
            return forces, self.scale.expand_as(forces), (forces > 0).to(forces.dtype)
        return forces, found.log_spread.exp() * self.scale, torch.sigmoid(found.contact)


def _size(image_size: ImageSize) -> str:
    return "×".join(str(side) for side in image_size)
