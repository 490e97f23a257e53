"""The ONNX file of a learned policy: its weights, and what goes into it, checked before any of it is run.

A policy is a perceptron of rectified layers from `exosight.control.learned.INPUTS` to one number, the
correction as a share of the largest. The file is sealed as an estimator's is, and its card names the system,
the inputs in order, the period and the largest correction.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pydantic
from jaxtyping import Float32

from exosight.control.adaptive import AdaptiveConfig
from exosight.control.frame_check import GuardConfig
from exosight.control.learned import INPUTS, Learned
from exosight.control.paths import ControllerConfig
from exosight.errors import DataError, InputError
from exosight.files import write_new_file
from exosight.learning.model_file import (
    Finite,
    Text,
    read_card,
    read_model,
    run_session,
    seal,
)
from exosight.system.schema import Schema, difference

NAMED_POLICIES = {"index-policy": Path(__file__).parents[1] / "models" / "index-policy.onnx"}
"""Policies that come with the package, by the name that options call them by."""

_LARGEST_FILE = 2**20  # bytes; the one that comes with the package has a tenth of it
_KIND = "policy"
_INPUT, _OUTPUT = "inputs", "correction"
_SAME = 1e-5  # of two ways to add some hundred products of order 1 in single precision
Layers = Sequence[tuple[np.ndarray, np.ndarray]]


def policy_path(given: Path | None) -> Path:
    """The file of a policy: as given, or the package's own by its name, or where it is left out."""
    return NAMED_POLICIES.get(str(given or "index-policy"), given or Path())


@dataclass(frozen=True)
class PolicyCard:
    """What a policy was trained for, one metadata entry a field."""

    exosight_version: Text
    schema: Schema
    """of the system"""
    sensor: Text
    """that is controlled"""
    channel: Text
    """that is driven"""
    inputs: Annotated[tuple[Text, ...], pydantic.Field(max_length=1024)]
    """names and units, in order"""
    largest: Annotated[float, pydantic.Field(gt=0, le=1)]
    """correction, as a share of the channel's peak"""
    period: Annotated[float, pydantic.Field(gt=0, le=10)]
    """of a step [s]"""
    training: dict[Text, Text | int | Finite | bool]
    """how it was trained"""


@dataclass(frozen=True)
class LearnedPolicy:
    """A policy run by ONNX Runtime on one thread."""

    session: Any
    """onnxruntime.InferenceSession"""
    card: PolicyCard
    """what it was trained for"""

    @staticmethod
    def load(path: Path) -> "LearnedPolicy":
        """Open what `write_policy` wrote; nothing is unpickled, and no operator runs but the checked ones.

        Raises DataError if the file is missing, truncated, changed, too large, or no policy of this version.
        """
        # Here, as where estimators are opened: onnx takes a while to import.
        from exosight.learning.model_graph import check_graph, read_graph

        data, name = read_model(path, _LARGEST_FILE, _KIND), str(path)
        model = read_graph(data, name)
        card = read_card(PolicyCard, {x.key: x.value for x in model.metadata_props}, name, _KIND)
        if card.inputs != INPUTS:
            raise DataError(
                f"{name}: expected the {len(INPUTS)} inputs of this version of exosight, its card names "
                f"{len(card.inputs)} others; train it again"
            )
        check_graph(model, {_INPUT: [len(INPUTS)]}, {_OUTPUT: [1]}, len(data), name)
        return LearnedPolicy(run_session(data, 1, name), card)

    def __call__(self, inputs: Float32[np.ndarray, " inputs"]) -> float:
        """The correction as a share of the largest; what is no number, or beyond ±1, `Learned` bounds."""
        return float(self.session.run([_OUTPUT], {_INPUT: inputs[None]})[0][0, 0])

    def controller(
        self,
        config: ControllerConfig,
        adaptive: AdaptiveConfig | None = None,
        guard: GuardConfig | None = None,
    ) -> Learned:
        """The adaptive controller that it corrects.

        Raises InputError for another system, sensor, channel or period than it was trained for.
        """
        card = self.card
        fault = difference(card.schema, config.schema, ("channels", "sensors"))
        named = {"sensor": card.sensor, "channel": card.channel}
        for what, name in named.items():
            if fault is None and getattr(config, what) != name:
                fault = f"the {what} {name!r} there, {getattr(config, what)!r} here"
        if fault is None and not math.isclose(card.period, config.period, rel_tol=1e-6):
            fault = f"steps of {card.period:g} s there, {config.period:g} s here"
        if fault is not None:
            raise InputError(
                f"law: the policy was trained for another loop: {fault}; choose the adaptive controller, or "
                "train a policy for it"
            )
        return Learned(config, self, card.largest, adaptive, guard)


def write_policy(path: Path, card: PolicyCard, layers: Layers) -> None:
    """Write a perceptron, rectified between its layers, as a policy that `LearnedPolicy.load` opens.

    layers   (outputs, inputs) weights and (outputs,) biases of each, from the inputs to one output

    Raises DataError if the file exists, or if what was written answers otherwise than the layers.
    """
    content = seal(_model(card, layers).SerializeToString())
    inputs = np.random.default_rng(0).normal(size=(16, len(INPUTS))).astype(np.float32)
    expected = inputs
    for i, (weight, bias) in enumerate(layers):
        expected = expected @ weight.T.astype(np.float32) + bias.astype(np.float32)
        expected = np.maximum(expected, 0) if i + 1 < len(layers) else expected
    (found,) = run_session(content, 1, str(path)).run([_OUTPUT], {_INPUT: inputs})
    if not np.abs(found - expected).max() <= _SAME * max(1.0, float(np.abs(expected).max())):
        raise DataError(f"{path}: the exported policy differs from the trained one; nothing was written")
    write_new_file(path, content)


def _model(card: PolicyCard, layers: Layers) -> Any:
    import onnx

    from exosight.learning.model_graph import model_of

    nodes, tensors, before = [], [], _INPUT
    for i, (weight, bias) in enumerate(layers):
        last = i + 1 == len(layers)
        for name, array in ((f"weight {i}", weight), (f"bias {i}", bias)):
            tensors.append(onnx.numpy_helper.from_array(np.ascontiguousarray(array, np.float32), name))
        after = _OUTPUT if last else f"sum {i}"
        nodes.append(onnx.helper.make_node("Gemm", [before, f"weight {i}", f"bias {i}"], [after], transB=1))
        if not last:
            nodes.append(onnx.helper.make_node("Relu", [after], [f"layer {i}"]))
        before = f"layer {i}"
    value = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        nodes,
        "correction_from_inputs",
        [value(_INPUT, onnx.TensorProto.FLOAT, ["batch", len(INPUTS)])],
        [value(_OUTPUT, onnx.TensorProto.FLOAT, ["batch", 1])],
        tensors,
    )
    return model_of(graph, card)
