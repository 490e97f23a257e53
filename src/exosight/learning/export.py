"""Export: a trained network as one ONNX file that needs neither PyTorch nor exosight to run."""

import contextlib
import logging
import math
import os
import warnings
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import onnx
import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor, nn

import exosight
from exosight.errors import DataError, InputError
from exosight.files import replace_file
from exosight.learning.causes import CAUSES, CauseClassifier
from exosight.learning.checkpoint import Checkpoint, load_checkpoint, load_model
from exosight.learning.contact import contact_shift
from exosight.learning.intervals import Widths, calibrate_intervals
from exosight.learning.model_file import ModelCard, open_session, seal
from exosight.learning.model_graph import OPERATOR_SET, model_of
from exosight.learning.model_inputs import IMAGE_ONLY, ModelInputs, check_inputs, stacked
from exosight.learning.networks import SensorModel, answer_slices, answers
from exosight.learning.ood import OodDetector, batches, fit_ood_detector
from exosight.learning.outputs import nonnegative
from exosight.learning.registration import Registration
from exosight.learning.reliability import Reliability, fit_reliability

_TOLERANCE = 1e-5
"""Float32 keeps seven digits and a forward pass sums a few hundred terms; measured: about 5e-7 at 128×128
pixels. The dense layer sums over the image, and its round-off grows with the root of the number of pixels:
5e-5 at 1024×1024."""


def export_onnx(
    source: Path,
    path: Path,
    images: UInt8[np.ndarray, "frames height width"],
    labels: Float32[np.ndarray, "frames outputs"],
    inputs: ModelInputs = IMAGE_ONLY,
    learned: tuple[UInt8[np.ndarray, "more height width"], ModelInputs] | None = None,
) -> ModelCard:
    """Write the best network of a run as an ONNX file, after checking it against ONNX Runtime.

    Its input `image` is float32 (batch, 1, height, width) in [0, 1], its output `forces` float32 (batch,
    outputs): the estimated sensors of the schema in its metadata, in their units. A network with earlier
    images as inputs has them as further channels, the newest first; one with actuation has a second input
    `commands`, float32 (batch, channels), in the channels' units.

    source   a run's folder, or its checkpoint
    images   frames that the run has not learned from, such as its validation part, and
    labels   what their estimated sensors read: they set how wide the intervals around estimates are, and the
             probability of contact
    inputs   what the network has as inputs beside these frames
    learned  frames that it has learned from, with its inputs beside them, see `fit_ood_detector`
    returns  what the file's metadata say

    Raises InputError if `path` exists or `inputs` are not the network's, DataError if the
    checkpoint cannot be used or the exported network answers otherwise than the trained one.
    """
    if path.exists():
        raise InputError(f"{path}: exists already; choose another name")
    checkpoint, model = load_checkpoint(source), load_model(source)
    settings, schema = checkpoint.run.settings, checkpoint.run.schema
    check_inputs(images, inputs, settings.history, schema.channels if settings.actuation else ())
    seen = stacked(images, inputs), inputs.commands
    known = None if learned is None else (stacked(*learned), learned[1].commands)
    ood = fit_ood_detector(model, seen, known)
    found, error, contact = _answers(model, *seen)
    forces = nonnegative(schema)
    reliability = fit_reliability(model, ood, schema, seen, labels)
    card = _card(checkpoint, calibrate_intervals(found, error, labels, forces), ood.limit, reliability)
    _shift_contact(model, np.where(forces, contact_shift(contact, labels > 0), 0.0))
    write_network(path, model, ood, card, reliability.causes)
    return card


def write_network(
    path: Path, model: SensorModel, ood: OodDetector, card: ModelCard, causes: CauseClassifier | None
) -> None:
    """Write a network as an ONNX file, after checking it against ONNX Runtime.

    causes   the classifier whose causes the card names, if it names any

    Raises DataError if the exported network answers otherwise than the given one.
    """
    deployed = _Deployed(model, ood, card, causes).eval()
    proto = _convert(deployed, card)
    _verify(proto, deployed, card)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, seal(proto.SerializeToString()))


class _Deployed(nn.Module):
    """What goes into the file: the view, the answers, the OOD score, and what is unusual."""

    def __init__(self, model: SensorModel, ood: OodDetector, card: ModelCard, causes: CauseClassifier | None):
        super().__init__()
        self.model, self.ood, self.causes = model, ood, causes
        homography = torch.tensor(card.registration)
        self.view = Registration(homography, card.schema.image_size) if card.registration else nn.Identity()

    def forward(self, image: Tensor, commands: Tensor | None = None) -> tuple[Tensor, ...]:
        image = self.view(image)
        features = self.model.network.features(image, commands)
        found = (*self.model.read(features), self.ood(image, features))
        if self.causes is None:
            return found
        return (*found, self.causes(features, self.ood.residual(image, features)))


def _answers(
    model: SensorModel,
    images: UInt8[np.ndarray, "frames stack height width"],
    commands: Float32[np.ndarray, "frames channels"] | None,
) -> tuple[Float32[np.ndarray, "frames outputs"], ...]:
    """Values and the errors to be expected of them [their units], and the probability of contact."""
    with torch.inference_mode():
        parts = [[answer.numpy() for answer in model(*part)] for part in batches(images, commands)]
    return tuple(np.concatenate(answer) for answer in zip(*parts, strict=True))


def _shift_contact(model: SensorModel, shift: Float[np.ndarray, " outputs"]) -> None:
    """Add to the log odds of contact among a network's answers; the paper's has none."""
    last, (_, _, contact) = model.network.last, answer_slices(model.network.outputs)
    if last.out_features > model.network.outputs:
        with torch.no_grad():
            last.bias[contact] += torch.from_numpy(shift).float()


def _card(checkpoint: Checkpoint, widths: Widths, ood_limit: float, reliability: Reliability) -> ModelCard:
    run, best = checkpoint.run, checkpoint.history[checkpoint.position.best_epoch - 1]
    history, actuation = run.settings.history, run.settings.actuation
    order = ", the newest first" if history else ""
    names = ", ".join(f"{channel.name} [{channel.unit}]" for channel in run.schema.channels)
    commands = f"; commands: {names}, float32, (batch, {len(run.schema.channels)})" if actuation else ""
    return ModelCard(
        exosight_version=exosight.__version__,
        network=run.settings.network,
        seed=run.settings.seed,
        schema=run.schema,
        input=f"gray image, float32 in 0…1, (batch, {1 + history}, height, width){order}{commands}",
        epoch=best.epoch,
        validation_l1=best.validation_l1 or 0.0,
        training=asdict(run.settings),
        data=run.data_identity,
        widths=widths,
        ood_limit=ood_limit,
        large_error=reliability.large_error,
        causes=CAUSES if reliability.causes else (),
        history=history,
        actuation=actuation,
    )


def _convert(model: nn.Module, card: ModelCard) -> onnx.ModelProto:
    """Trace the network, and keep only the graph: around it PyTorch writes paths of this machine."""
    examples = tuple(torch.zeros(2, *shape) for shape in card.inputs.values())
    batch = torch.export.Dim("batch")
    with _quiet():
        program = torch.onnx.export(
            model,
            examples,
            dynamo=True,
            input_names=list(card.inputs),
            output_names=list(card.outputs),
            dynamic_shapes={name: {0: batch} for name in card.inputs},
            opset_version=OPERATOR_SET,
            external_data=False,
            verbose=False,
        )
    if program is None:
        raise DataError("PyTorch exported nothing; is the extra exosight[train] installed as a whole?")
    graph = program.model_proto.graph
    for part in [*graph.node, *graph.input, *graph.output, *graph.initializer]:
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
    clean = onnx.helper.make_graph(
        graph.node, "sensors_from_image", graph.input, graph.output, graph.initializer
    )
    return model_of(clean, card)


def _verify(proto: onnx.ModelProto, deployed: _Deployed, card: ModelCard) -> None:
    """Compare both networks on random images, before the limit at zero: behind it, wrong may look right."""
    unlimited = onnx.ModelProto()
    unlimited.CopyFrom(proto)
    nodes = unlimited.graph.node
    (limit,) = [node for node in nodes if "forces" in node.output]
    if limit.op_type not in ("Relu", "Max"):
        raise DataError(f"the exported values end in {limit.op_type}, not in the limit at zero")
    (before,) = [node for node in nodes if limit.input[0] in node.output]
    nodes.remove(limit)
    before.output[0] = "forces"
    session, _ = open_session(unlimited.SerializeToString(), 1, "the exported network")

    model = deployed.model
    generator, size = np.random.default_rng(0), card.schema.image_size
    given = {
        name: generator.random((8, *shape), dtype=np.float32)  # one unit of a command is as good as any
        for name, shape in card.inputs.items()
    }
    given["image"] *= np.linspace(0, 1, 8, dtype=np.float32)[:, None, None, None]
    with torch.inference_mode():
        image, *rest = (torch.from_numpy(array) for array in given.values())
        tensors = [deployed.view(image), *rest]
        raw = answers(model.network(*tensors), model.network.outputs).values * model.scale
        raw = raw if model.offset is None else raw + model.offset
        expected = [raw.numpy(), model(*tensors)[1].numpy()]
    found = session.run(["forces", "expected_error"], given)
    for mine, true in zip(found, expected, strict=True):
        error = np.abs(np.asarray(mine) - true).max()
        terms = max(1.0, math.prod(size) / 128**2)
        limit = _TOLERANCE * math.sqrt(terms) * max(1.0, float(np.abs(true).max()))
        if not error <= limit:
            raise DataError(
                f"the exported network differs from the trained one by {error:.1e}, allowed are "
                f"{limit:.1e}; nothing was written"
            )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep PyTorch's exporter from printing, and from warning about its own code."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
