"""Starting from a network that has learned already, in place of random weights.

An exported file has the batch normalisation folded into the convolutions. It comes back around the same
answers: normalising with the mean and deviation that the features have on some images, then undoing it,
leaves every answer as it was, and training goes on from there as if it had never been folded.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx
import torch
from jaxtyping import Float
from torch import Tensor, nn

from exosight.errors import DataError, InputError
from exosight.learning.causes import CauseClassifier
from exosight.learning.checkpoint import RunIdentity
from exosight.learning.model_file import ModelCard, open_session, read_model, sealed
from exosight.learning.networks import (
    ActuationEmbedding,
    Network,
    SensorModel,
    answer_slices,
    build_network,
)
from exosight.learning.ood import OodDetector
from exosight.learning.outputs import nonnegative
from exosight.system.schema import difference

_PREFIX = "model.network."
_SCALE, _OFFSET = "model.scale", "model.offset"


@dataclass(frozen=True)
class Pretrained:
    """A network to start from, as its file has it."""

    card: ModelCard
    sha256: str
    """of the file, as its seal has it"""
    weights: Mapping[str, Tensor]
    """by the name of the layer in `Network`; a convolution's bias is that of its normalisation as well"""
    scale: Float[Tensor, " outputs"]
    """what one unit of each output stands for [the sensor's unit]"""
    offset: Float[Tensor, " outputs"]
    """what an output of 0 stands for [the sensor's unit]"""
    ood: OodDetector
    """of the features that these weights give"""
    causes: CauseClassifier | None
    """likewise; None if its card names no causes"""


def load_pretrained(path: Path) -> Pretrained:
    """Read a network from the ONNX file that a run exported; nothing in it is executed.

    Raises DataError if it is missing, truncated, changed, or no network of this version of exosight.
    """
    data = read_model(path)
    _, card = open_session(data, 1, str(path))
    graph = onnx.load_from_string(data).graph
    arrays = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in graph.initializer}
    weights = {}
    for node in graph.node:
        if len(node.input) < 2 or not node.input[1].startswith(_PREFIX) or node.input[1] not in arrays:
            continue
        layer = node.input[1].removeprefix(_PREFIX).removesuffix(".weight")
        weights[f"{layer}.weight"] = arrays[node.input[1]]
        if len(node.input) > 2:
            weights[f"{layer}.bias"] = arrays.get(node.input[2], np.full(1, np.nan))
    scale = arrays.get(_SCALE, np.full(1, np.nan))
    offset = arrays.get(_OFFSET, np.zeros(len(card.schema.outputs), np.float32))
    if not scale.shape == offset.shape == (len(card.schema.outputs),) or not all(
        x.dtype == np.float32 and np.isfinite(x).all() for x in [scale, offset, *weights.values()]
    ):
        raise DataError(f"{path}: its weights are not those of an estimator of exosight; export it again")
    return Pretrained(
        card,
        sealed(data),
        {name: torch.from_numpy(array.copy()) for name, array in weights.items()},
        torch.from_numpy(scale.copy()),
        torch.from_numpy(offset.copy()),
        _detector(graph, arrays, card, path),
        _classifier(arrays, card, path),
    )


def _detector(
    graph: onnx.GraphProto, arrays: Mapping[str, np.ndarray], card: ModelCard, path: Path
) -> OodDetector:
    """The OOD detector in a file, whose usual error stands there squared, as what the last division is by."""
    made_by = {node.output[0]: node for node in graph.node}
    score = made_by.get("ood_score", onnx.NodeProto(input=[""]))
    division = made_by.get(score.input[0], onnx.NodeProto(input=["", ""]))
    names = "ood.weight", "ood.bias", division.input[-1]
    height, width = card.schema.image_size
    places = height // 4 * (width // 4)
    found = [arrays.get(name, np.full(1, np.nan)) for name in names]
    if not (
        all(x.shape[-1:] == (places,) and np.isfinite(x).all() for x in found)
        and [x.ndim for x in found] == [2, 1, 1]
        and (found[2] > 0).all()
    ):
        raise DataError(f"{path}: its OOD score is not that of an estimator of exosight; export it again")
    weight, bias, squared = (torch.from_numpy(x.copy()).float() for x in found)
    return OodDetector(weight, bias, squared.sqrt(), card.ood_limit)


def _classifier(arrays: Mapping[str, np.ndarray], card: ModelCard, path: Path) -> CauseClassifier | None:
    """The classifier of causes in a file."""
    if not card.causes:
        return None
    weight, bias = (arrays.get(f"causes.linear.{name}", np.full(1, np.nan)) for name in ("weight", "bias"))
    features = arrays["ood.weight"].shape[0]
    found = CauseClassifier(features, card.schema.image_size, len(card.causes))
    if not all(
        x.shape == own.shape and np.isfinite(x).all()
        for x, own in ((weight, found.linear.weight), (bias, found.linear.bias))
    ):
        raise DataError(f"{path}: its causes are not those of an estimator of exosight; export it again")
    with torch.no_grad():
        found.linear.weight.copy_(torch.from_numpy(weight.copy()))
        found.linear.bias.copy_(torch.from_numpy(bias.copy()))
    return found.eval()


def check_pretrained(pretrained: Pretrained, identity: RunIdentity) -> None:
    """Raise InputError unless the network to start from is of the kind that is to be trained."""
    card, settings = pretrained.card, identity.settings
    if card.registration:
        raise InputError(
            "pretrained: it was adapted to a camera that had moved, and sees pictures as the former one "
            "would; start from the network that it was adapted from, or adapt it once more: exosight adapt"
        )
    there = (card.network, card.history, card.actuation)
    asked = (settings.network, settings.history, settings.actuation)
    names = ("network", "history", "actuation")
    own, other = card.schema, identity.schema
    if not (card.actuation or card.history) and len(own.channels) == len(other.channels):
        own = replace(own, channels=other.channels)  # whose commands it only learned beside
    if fault := difference(own, other, ("sensors", "cameras", "channels")):
        raise InputError(f"pretrained: it is for another system: {fault}; start from one of the same kind")
    for name, has, wants in zip(names, there, asked, strict=True):
        if has != wants and not (name == "actuation" and wants):
            raise InputError(
                f"pretrained: its {name} is {has}, asked for is {wants}; start from one of the same kind"
            )


def first_weights(
    pretrained: Pretrained,
    identity: RunIdentity,
    images: Float[Tensor, "batch images height width"],
    commands: Float[Tensor, "batch channels"] | None,
) -> dict[str, Tensor]:
    """The weights with which a run's network answers, before its first step, as the one it starts from.

    images, commands   some hundreds of those that it will learn from: they only set what is normalised by

    Raises DataError if the layers are others than this version of exosight builds.
    """
    network = identity.build_network().eval()
    unfold(pretrained, network, images, commands)
    with torch.no_grad():
        scale = torch.tensor(identity.output_scale)
        own = torch.zeros_like(scale) if identity.offset is None else identity.offset
        _rescale(network, pretrained.scale / scale, (pretrained.offset - own) / scale)
    return {name: tensor.detach().clone() for name, tensor in network.state_dict().items()}


def unfold(
    pretrained: Pretrained,
    network: Network,
    images: Float[Tensor, "batch images height width"],
    commands: Float[Tensor, "batch channels"] | None,
) -> None:
    """Give a network the weights of a file, which it then answers as, normalised around some images.

    Commands that the file's network does not have as an input count for nothing as yet.

    Raises DataError if the layers are others than this version of exosight builds.
    """
    pairs = _normalised(network)
    weights = _with_commands(pretrained, network)
    for convolution, norm in pairs.items():
        bias = weights.get(f"{convolution}.bias", torch.empty(0))
        # Mean and variance are of no account as yet: `_normalise` comes before their first use.
        weights[f"{norm}.bias"] = bias
        weights[f"{norm}.weight"] = weights[f"{norm}.running_var"] = torch.ones_like(bias)
        weights[f"{norm}.running_mean"] = weights[f"{convolution}.bias"] = torch.zeros_like(bias)
        weights[f"{norm}.num_batches_tracked"] = torch.tensor(0)
    expected = network.state_dict()
    weights = {name: weights.get(name, torch.empty(0)) for name in expected}
    for name, tensor in expected.items():
        if weights[name].shape != tensor.shape:
            raise DataError(
                f"pretrained: expected {name} of shape {tuple(tensor.shape)}, the file has "
                f"{tuple(weights[name].shape)}; export the network again with this version of exosight"
            )
    network.load_state_dict(weights)
    hooks = [network.get_submodule(norm).register_forward_pre_hook(_normalise) for norm in pairs.values()]
    with torch.no_grad():
        network(images, commands)
    for hook in hooks:
        hook.remove()


def as_model(
    pretrained: Pretrained,
    images: Float[Tensor, "batch images height width"],
    commands: Float[Tensor, "batch channels"] | None,
) -> SensorModel:
    """The network of a file as it can be trained and exported again, normalised around some images."""
    card = pretrained.card
    last = max(int(name.split(".")[0]) for name in pretrained.weights)
    rows = len(pretrained.weights[f"{last}.weight"])
    beside = rows - 3 * len(card.schema.outputs) if card.network == "light" else 0
    network = build_network(card.network, card.schema, beside, card.seed, card.history, card.actuation).eval()
    unfold(pretrained, network, images, commands)
    offset = pretrained.offset if pretrained.offset.any() else None
    return SensorModel(network, pretrained.scale, nonnegative(card.schema), offset).eval()


def _with_commands(pretrained: Pretrained, network: Network) -> dict[str, Tensor]:
    """The weights of a file by the names that they have in a network, which may take commands as well."""
    weights = dict(pretrained.weights)
    embeddings = [i for i, layer in enumerate(network) if isinstance(layer, ActuationEmbedding)]
    if pretrained.card.actuation or not embeddings:
        return weights
    (place,) = embeddings
    moved = {}
    for name, tensor in weights.items():
        number, _, rest = name.partition(".")
        moved[f"{int(number) + (int(number) >= place)}.{rest}"] = tensor
    share = network.get_submodule(f"{place}.share").state_dict()
    return moved | {f"{place}.share.{name}": torch.zeros_like(tensor) for name, tensor in share.items()}


def _normalised(network: Network) -> dict[str, str]:
    """Names of the convolutions, and of the layers that normalise what comes out of them."""
    layers = [(name, layer) for name, layer in network.named_modules() if not list(layer.children())]
    return {
        before: name for (before, _), (name, layer) in pairwise(layers) if isinstance(layer, nn.BatchNorm2d)
    }


def _normalise(layer: nn.Module, arguments: tuple[Tensor]) -> None:
    """Let a layer that passes on its input, but for a bias, normalise it and undo that again."""
    assert isinstance(layer, nn.BatchNorm2d)
    assert layer.running_mean is not None
    assert layer.running_var is not None
    variance, mean = torch.var_mean(arguments[0], (0, 2, 3), correction=0)
    layer.weight.copy_((variance + layer.eps).sqrt())
    layer.bias.add_(mean)
    layer.running_mean.copy_(mean)
    layer.running_var.copy_(variance)


def _rescale(network: Network, ratio: Float[Tensor, " outputs"], shift: Float[Tensor, " outputs"]) -> None:
    """Give answers in units of another scale: values, shifted, and the logarithms of expected errors."""
    last, (values, log_spread, _) = network.last, answer_slices(network.outputs)
    last.weight[values].mul_(ratio[:, None])
    last.bias[values].mul_(ratio).add_(shift)
    if last.out_features > network.outputs:
        last.bias[log_spread].add_(ratio.log())
