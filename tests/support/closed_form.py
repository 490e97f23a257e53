"""A network in closed form: C_i = i · mean gray value, minus 1 N on C7, never negative; 6×8 pixels."""

from pathlib import Path

import numpy as np
import onnx
from cards import made_up
from onnx import TensorProto, helper, numpy_helper

from exosight.learning.intervals import Widths
from exosight.learning.model_file import OUTPUTS, card_to_metadata, seal

CARD = made_up(
    6,
    8,
    network="closed form",
    training={"network": "closed form"},
    data={"camera": "512 px/m"},
    widths=Widths(((1.0,) * 7,) * 5, ((1.0,) * 7, (2.0,) * 7, (3.0,) * 7, (4.0,) * 7, (5.0,) * 7)),
    ood_limit=0.5,
)


def closed_form() -> onnx.ModelProto:
    weight = np.tile(np.arange(1, 8, dtype=np.float32) / 48, (48, 1))
    bias = np.array([0, 0, 0, 0, 0, 0, -1], np.float32)
    nodes = [
        helper.make_node("Reshape", ["image", "row"], ["flat"]),
        helper.make_node("Gemm", ["flat", "weight", "bias"], ["raw"]),
        helper.make_node("Relu", ["raw"], ["forces"]),
        helper.make_node("Mul", ["forces", "tenth"], ["tenths"]),
        helper.make_node("Add", ["tenths", "tenth"], ["expected_error"]),
        helper.make_node("Sigmoid", ["raw"], ["contact"]),
        helper.make_node("ReduceMean", ["image", "sides"], ["ood_score"], keepdims=0),
    ]
    graph = helper.make_graph(
        nodes,
        "closed_form",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["batch", 1, 6, 8])],
        [
            *(helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", 7]) for name in OUTPUTS[:3]),
            helper.make_tensor_value_info("ood_score", TensorProto.FLOAT, ["batch"]),
        ],
        [
            numpy_helper.from_array(weight, "weight"),
            numpy_helper.from_array(bias, "bias"),
            numpy_helper.from_array(np.array(0.1, np.float32), "tenth"),
            numpy_helper.from_array(np.array([1, 2, 3]), "sides"),
            numpy_helper.from_array(np.array([-1, 48]), "row"),
        ],
    )
    model = helper.make_model(graph, ir_version=8, opset_imports=[helper.make_opsetid("", 18)])
    helper.set_model_props(model, card_to_metadata(CARD))
    return model


def write(path: Path, model: onnx.ModelProto) -> Path:
    path.write_bytes(seal(model.SerializeToString()))
    return path
