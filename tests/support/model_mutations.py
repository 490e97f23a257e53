"""Mutations of an estimator's file with its checksum mended, as someone would make them who means harm.

Used by a short fuzzer here in the tests and by a long one among the benchmarks.
"""

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import AttributeProto, TensorProto, helper, numpy_helper

from exosight.control.estimator import OnnxEstimator
from exosight.errors import DataError, InputError
from exosight.learning.model_file import seal

_HUGE = 2**62
_INTEGERS = (0, -1, 1, 2, 7, 64, 999, 20_000, 2**31 - 1, 2**31, _HUGE, -(2**63), 2**63 - 1)
_VALUES = (
    *(
        "NaN",
        "-Infinity",
        "1e999",
        "-1",
        "0",
        "999",
        "1e-40",
        "9" * 5000,
        "true",
        "null",
        '""',
        '"\\u001b[2J"',
    ),
    *(
        "[]",
        "{}",
        "[[]]",
        "[[[1.0]]]",
        '{"a": [NaN]}',
        "[" * 100_000,
        '{"a":' * 5000,
        '"' + "x" * 100_000 + '"',
    ),
    *("", "\x1b]0;title\x07", "not JSON", '{"estimated_zero": [], "estimated_force": []}'),
)
"""Of an entry of the card: other kinds and sizes, and what parsers stumble over."""
_OPERATORS = (
    *(
        "Loop",
        "If",
        "Scan",
        "ConstantOfShape",
        "Constant",
        "Expand",
        "Tile",
        "Range",
        "Resize",
        "Pad",
        "Upsample",
    ),
    *(
        "OneHot",
        "Einsum",
        "RandomUniform",
        "NonZero",
        "Reshape",
        "Conv",
        "MatMul",
        "MaxPool",
        "Cast",
        "Slice",
    ),
    *(
        "ConvTranspose",
        "DepthToSpace",
        "SequenceEmpty",
        "StringNormalizer",
        "LSTM",
        "Relu",
        "Concat",
        "Shape",
    ),
)


def mutate(data: bytes, draw: random.Random) -> bytes:
    """The file after one to three changes of its bytes, card, nodes, tensors or shapes."""
    model = onnx.load_from_string(data)
    del model.metadata_props[-1]  # the checksum
    for _ in range(draw.choice((1, 1, 2, 3))):
        draw.choice((_card, _card, _node, _node, _operator, _tensor, _shape, _versions))(model, draw)
    found = bytearray(model.SerializeToString())
    if draw.random() < 0.2:
        for _ in range(draw.randint(1, 4)):
            found[draw.randrange(len(found))] = draw.randrange(256)
    if draw.random() < 0.05:
        del found[draw.randrange(len(found)) :]
    return seal(bytes(found))


def outcome(path: Path) -> str:
    """What becomes of a file: "estimates", or "refused" in a sentence when it is opened or run."""
    try:
        estimator = OnnxEstimator.load(path, alone=True)
        height, width = estimator.card.schema.image_size
        reading = estimator.read(np.full((1, height, width), 128, np.uint8))
    except (DataError, InputError) as error:
        sentence = str(error)
        assert sentence.isprintable(), repr(sentence)
        assert len(sentence) < 2000, sentence
        return "refused"
    for numbers in (reading.forces, reading.low, reading.high, reading.contact, reading.ood_score):
        assert np.isfinite(numbers).all()
    return "estimates"


def _card(model: onnx.ModelProto, draw: random.Random) -> None:
    entry = draw.choice(model.metadata_props) if model.metadata_props else model.metadata_props.add()
    try:
        value = json.loads(entry.value)
    except (ValueError, RecursionError):
        value = entry.value
    if draw.random() < 0.6 and isinstance(value, dict | list) and value:
        _leaf(value, draw)
        entry.value = json.dumps(value)
    elif draw.random() < 0.1:
        model.metadata_props.remove(entry)
    else:
        entry.value = draw.choice(_VALUES)


def _leaf(value: Any, draw: random.Random) -> None:
    """Another value somewhere within nested lists and dictionaries."""
    while True:
        key = draw.choice(list(value) if isinstance(value, dict) else range(len(value)))
        if not (isinstance(value[key], dict | list) and value[key]) or draw.random() < 0.2:
            break
        value = value[key]
    change = draw.randrange(3)
    if change == 0:
        value[key] = draw.choice(
            (None, float("nan"), float("inf"), -1, 0, 1e30, 2**70, "", "x" * 300, [], {}, True)
        )
    elif change == 1:
        del value[key]
    elif isinstance(value, list):
        value.extend([value[key]] * draw.choice((1, 100)))
    else:
        value["extra"] = value[key]


def _names(model: onnx.ModelProto) -> list[str]:
    graph = model.graph
    return [
        *(x.name for x in (*graph.input, *graph.initializer, *graph.output)),
        *(name for node in graph.node for name in node.output),
        "",
    ]


def _node(model: onnx.ModelProto, draw: random.Random) -> None:
    node = draw.choice(model.graph.node) if model.graph.node else model.graph.node.add()
    change = draw.randrange(6)
    if change == 0:
        node.op_type = draw.choice(_OPERATORS)
    elif change == 1 and node.input:
        node.input[draw.randrange(len(node.input))] = draw.choice(_names(model))
    elif change == 2 and node.output:
        node.output[draw.randrange(len(node.output))] = draw.choice(_names(model))
    elif change == 3:
        name = draw.choice(
            ("axis", "axes", "kernel_shape", "pads", "strides", "dilations", "to", "group", "alpha")
        )
        number = draw.choice(_INTEGERS)
        node.attribute.append(helper.make_attribute(name, draw.choice((number, [number] * 2, [number] * 4))))
    elif change == 4:
        node.domain = draw.choice(("com.elsewhere", "ai.onnx.ml", "com.microsoft"))
    else:
        model.graph.node.extend([node] * draw.choice((1, 2, 500)))


def _operator(model: onnx.ModelProto, draw: random.Random) -> None:
    """One more operator, whose result is added to the answers."""
    graph = model.graph
    size = numpy_helper.from_array(
        np.array([draw.choice(_INTEGERS) for _ in range(draw.randint(1, 3))]), "size"
    )
    graph.initializer.append(size)
    node = helper.make_node(draw.choice(_OPERATORS), [draw.choice(_names(model)), "size"], ["more"])
    body = helper.make_graph([], "body", [], [])
    if node.op_type in ("Loop", "If", "Scan"):
        node.attribute.append(helper.make_attribute(draw.choice(("body", "then_branch")), body))
    graph.node.insert(draw.randrange(len(graph.node) + 1), node)
    if draw.random() < 0.5:
        graph.node.append(helper.make_node("Add", [graph.output[0].name, "more"], ["sum"]))
        graph.output[0].name = "sum"


def _tensor(model: onnx.ModelProto, draw: random.Random) -> None:
    tensor = (
        draw.choice(model.graph.initializer) if model.graph.initializer else model.graph.initializer.add()
    )
    change = draw.randrange(6)
    if change == 0:
        tensor.dims.append(draw.choice(_INTEGERS))
    elif change == 1 and tensor.dims:
        tensor.dims[draw.randrange(len(tensor.dims))] = draw.choice(_INTEGERS)
    elif change == 2:
        tensor.data_type = draw.choice((0, 1, 2, 3, 6, 7, 8, 9, 10, 11, 16, 99))
    elif change == 3:
        tensor.data_location = TensorProto.EXTERNAL
        entry = tensor.external_data.add()
        entry.key, entry.value = "location", "/dev/zero"
    elif change == 4:
        numbers = np.array([draw.choice((np.nan, np.inf, -1e38, 0, 1e38))], np.float32)
        tensor.raw_data = numbers.tobytes() * (len(tensor.raw_data) // 4)
    else:
        integers = np.array([draw.choice(_INTEGERS)])
        tensor.raw_data = integers.tobytes() * (len(tensor.raw_data) // 8)


def _shape(model: onnx.ModelProto, draw: random.Random) -> None:
    values = [*model.graph.input, *model.graph.output]
    dims = draw.choice(values).type.tensor_type.shape.dim if values else []
    if dims:
        draw.choice(dims).dim_value = draw.choice(_INTEGERS)


def _versions(model: onnx.ModelProto, draw: random.Random) -> None:
    change = draw.randrange(4)
    if change == 0:
        model.ir_version = draw.choice(_INTEGERS)
    elif change == 1:
        model.opset_import[0].version = draw.choice(_INTEGERS)
    elif change == 2:
        model.functions.add().name = "f"
    else:
        model.graph.node[0].attribute.append(
            AttributeProto(name="t", type=AttributeProto.TENSOR, t=numpy_helper.from_array(np.zeros(4)))
        )
