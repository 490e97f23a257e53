"""The two networks: image in, one output a sensor that the schema says is estimated."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from exosight.errors import InputError
from exosight.learning.outputs import command_scale
from exosight.system.schema import Schema


class Network(nn.Sequential):
    """Layers one after the other; the last gives the answers from the features.

    outputs   how many sensors it estimates
    """

    def __init__(self, outputs: int, *layers: nn.Module):
        super().__init__(*layers)
        self.outputs = outputs

    def forward(
        self,
        input: Float[Tensor, "batch images height width"],
        commands: Float[Tensor, "batch channels"] | None = None,
    ) -> Float[Tensor, "batch answers"]:
        """The answers; `commands`, in the channels' units, are for a network that has them as an input."""
        return self.last(self.features(input, commands))

    @property
    def last(self) -> nn.Linear:
        """The layer that gives the answers from the features."""
        last = list(self)[-1]
        assert isinstance(last, nn.Linear)
        return last

    def features(
        self,
        input: Float[Tensor, "batch images height width"],
        commands: Float[Tensor, "batch channels"] | None = None,
    ) -> Float[Tensor, "batch features"]:
        """The input of the last layer."""
        for layer in list(self)[:-1]:
            input = layer(input, commands) if isinstance(layer, ActuationEmbedding) else layer(input)
        return input


class PaperNetwork(Network):
    """The published network: five 3×3 convolutions without padding, four max-pools, four dense layers.

    128×128 images only. With seven outputs it has 78,847 parameters, which needs batch normalisation after
    all five convolutions (the paper's text has four, and eight outputs; none such has its parameter count).
    """

    def __init__(self, schema: Schema):
        if schema.image_size != (128, 128):
            raise InputError(
                f"the paper network needs 128×128 images, got {_size(schema)}; use the light one"
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
        outputs = len(schema.outputs)
        super().__init__(outputs, *layers, nn.Linear(64, outputs))


class LightNetwork(Network):
    """The default: a quarter of the paper's multiply-adds at 128×128 (39 M against 162 M), and more answers.

    The first convolution sees 4×4 pixels as 16 channels, so nothing of the picture is lost and nothing is
    computed at its full size; the rest halve it twice and look again (residual blocks) at 16×16 and 8×8.
    Beside the sensors it answers, for each, how far off it may be and whether there is contact (of forces),
    and `auxiliary` further numbers that are only learned from, such as joint angles.

    `history` earlier images are further channels, newest first: what moved shows in the first convolution.
    With `actuation`, the commands join where the picture has become features, before they are rectified: they
    say nothing of any one place, and the last layer can still weigh the features by them.

    Any image of 32 to 4096 pixels a side, in multiples of 4.
    """

    def __init__(self, schema: Schema, auxiliary: int = 0, history: int = 0, actuation: bool = False):
        size, outputs = schema.image_size, len(schema.outputs)
        if min(size) < 32 or max(size) > 4096 or any(side % 4 for side in size):
            raise InputError(
                "the light network needs images of 32 to 4096 pixels a side, in multiples of 4, "
                f"got {_size(schema)}"
            )
        height, width = (-(-side // 32) for side in size)
        features = 128
        super().__init__(
            outputs,
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
            *([ActuationEmbedding(features, command_scale(schema))] if actuation else []),
            nn.ReLU(),
            nn.Linear(features, 3 * outputs + auxiliary),
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
    """What commands add to features; each in units of about its spread over a path."""

    scale: Tensor

    def __init__(self, features: int, scale: Float[np.ndarray, " channels"]):
        super().__init__()
        self.share = nn.Linear(len(scale), features)
        # Known from the schema: not a part of checkpoints.
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32), persistent=False)

    def forward(
        self, features: Float[Tensor, "batch features"], commands: Float[Tensor, "batch channels"]
    ) -> Float[Tensor, "batch features"]:
        """Features + share(commands / scale)."""
        return features + self.share(commands / self.scale)


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
    name: str, schema: Schema, auxiliary: int, seed: int, history: int = 0, actuation: bool = False
) -> Network:
    """Build a network whose first weights follow from the seed alone; the global generator is left as it was.

    auxiliary   further numbers that a light network learns; the paper's has the estimated sensors only
    history     earlier images that are inputs of a light network; the paper's has one image
    actuation   whether the commands are an input of a light network; of the paper's they are not

    Raises InputError if the network cannot take images of the first camera's size.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        if name == "paper":
            return PaperNetwork(schema)
        return LightNetwork(schema, auxiliary, history, actuation)


def answer_slices(outputs: int) -> tuple[slice, slice, slice]:
    """Places of values, log spread and contact among a network's answers; the paper's has the first only."""
    first, second, third = (slice(outputs * i, outputs * (i + 1)) for i in range(3))
    return first, second, third


class Answers(NamedTuple):
    """What a network answers to a batch of images, values in units of their scale.

    values      (batch, outputs)
    log_spread  (batch, outputs) natural logarithm of the error to be expected of each; None if it has none
    contact     (batch, outputs) log odds that there is contact, of no meaning where the sensor is not a
                force; None likewise
    auxiliary   (batch, n) what is learned beside
    """

    values: Tensor
    log_spread: Tensor | None
    contact: Tensor | None
    auxiliary: Tensor


def answers(output: Float[Tensor, "batch answers"], outputs: int) -> Answers:
    """The parts of a network's output."""
    if output.shape[1] == outputs:
        return Answers(output, None, None, output[:, :0])
    values, spread, contact = (output[:, part] for part in answer_slices(outputs))
    # Between a 400th and 50 times the scale: beyond, one outlier would rule the loss.
    return Answers(values, spread.clamp(-6, 4), contact, output[:, 3 * outputs :])


class SensorModel(nn.Module):
    """A network with its units: images in [0, 1], and commands if it has them as an input, to sensors.

    Forces are magnitudes, so a negative one is always wrong and zero always nearer. The loss is taken before
    the limit, where the gradient never vanishes.

    scale         (outputs,)   what one unit of the network's output stands for [the sensor's unit]
    offset        (outputs,)   what an output of 0 stands for [the sensor's unit]; None: 0
    nonnegative   (outputs,)   which sensors are forces
    """

    scale: Tensor
    offset: Tensor | None
    lowest: Tensor
    touches: Tensor

    def __init__(
        self,
        network: Network,
        scale: Float[Tensor, " outputs"],
        nonnegative: Bool[np.ndarray, " outputs"],
        offset: Float[Tensor, " outputs"] | None = None,
    ):
        super().__init__()
        self.network = network
        self.only_forces = bool(nonnegative.all())
        self.register_buffer("scale", scale)
        self.register_buffer("offset", offset)
        lowest = torch.where(torch.from_numpy(nonnegative), 0.0, -torch.inf).to(scale.device)
        self.register_buffer("lowest", lowest, persistent=False)
        self.register_buffer("touches", (lowest == 0).float(), persistent=False)

    def forward(
        self,
        image: Float[Tensor, "batch images height width"],
        commands: Float[Tensor, "batch channels"] | None = None,
    ) -> tuple[
        Float[Tensor, "batch outputs"], Float[Tensor, "batch outputs"], Float[Tensor, "batch outputs"]
    ]:
        """Values of the sensors, the error to expect of each [their units], and whether there is contact.

        A network that has neither of the last two is taken to err by the same everywhere, and to find contact
        where it finds a force. The probability of contact is 0 for a sensor that is not a force.
        """
        return self.read(self.network.features(image, commands))

    def read(
        self, features: Float[Tensor, "batch features"]
    ) -> tuple[
        Float[Tensor, "batch outputs"], Float[Tensor, "batch outputs"], Float[Tensor, "batch outputs"]
    ]:
        """The three answers, from the features of images."""
        found = answers(self.network.last(features), self.network.outputs)
        scaled = found.values * self.scale
        if self.offset is not None:
            scaled = scaled + self.offset
        values = torch.relu(scaled) if self.only_forces else torch.maximum(scaled, self.lowest)
        if found.log_spread is None or found.contact is None:
            error, contact = self.scale.expand_as(values), (values > 0).to(values.dtype)
        else:
            error, contact = found.log_spread.exp() * self.scale, torch.sigmoid(found.contact)
        return values, error, contact if self.only_forces else contact * self.touches


def _size(schema: Schema) -> str:
    return "×".join(map(str, schema.image_size))
