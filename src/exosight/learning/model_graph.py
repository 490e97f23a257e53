"""The graph in an estimator's file, checked before a runtime sees any of it.

A checksum tells damage, not trust: whoever changes a file can mend it. So a graph may hold only what the
exporter of exosight writes, with weights as large as the file says, and answers in bounded memory and time.
"""

import math
from typing import Any

import onnx
from google.protobuf.message import DecodeError, Message
from onnx import AttributeProto, TensorProto

import exosight
from exosight.errors import DataError
from exosight.learning.model_file import BATCH, card_to_metadata

# Operator set 18 with file format 8, both of ONNX 1.13 (2022): the oldest that PyTorch writes, so that
# MATLAB's importNetworkFromONNX and other readers that lag behind can follow.
OPERATOR_SET = 18
FILE_FORMAT = 8

_OPERATORS = {
    *(
        "Add",
        "AveragePool",
        "Cast",
        "Clip",
        "Concat",
        "Conv",
        "Div",
        "Exp",
        "Expand",
        "Gemm",
        "Greater",
        "GridSample",
        "Log",
    ),
    *("MatMul", "Max", "MaxPool", "Mul", "Pow", "ReduceMean", "Relu", "Reshape", "Shape", "Sigmoid"),
    *("Slice", "Softmax", "Sqrt", "Sub", "Transpose", "Unsqueeze"),
}
_FIELDS: dict[str, set[str]] = {
    "ModelProto": {
        *("ir_version", "opset_import", "producer_name", "producer_version", "graph", "metadata_props")
    },
    "GraphProto": {"node", "name", "initializer", "input", "output"},
    "NodeProto": {"input", "output", "name", "op_type", "attribute"},
    "AttributeProto": {"name", "type", "i", "f", "s", "ints"},
    "TensorProto": {"dims", "data_type", "name", "raw_data"},
    "ValueInfoProto": {"name", "type"},
}
"""What the exporter writes: no function, subgraph, sparse tensor or other file among it."""
_PLAIN = AttributeProto.INT, AttributeProto.FLOAT, AttributeProto.STRING, AttributeProto.INTS
_ITEM: dict[int, int] = {TensorProto.FLOAT: 4, TensorProto.INT64: 8}  # bytes
_RESULTS = {*_ITEM, TensorProto.BOOL}

# The networks of exosight have 66 nodes at most; an image takes at most 76 numbers a pixel (light with 8
# earlier images) or 3 million (paper), and 9,900 multiplications a pixel (paper). The light one has at least
# 64.5 bytes of weights a pixel.
_NODES, _TENSORS, _INPUTS = 256, 256, 8
_LARGEST_INTEGER = 2**31
_FEW = 2**12  # integers in a constant: places and sizes, not data
_NUMBERS, _MORE_NUMBERS = 96, 2**21
_PRODUCTS, _MORE_PRODUCTS = 2**14, 2**24
_BYTES, _FEWER_BYTES = 64, 2**20


def read_graph(data: bytes, name: str) -> onnx.ModelProto:
    """The model in serialised bytes, with nothing in it that the exporter does not write; `name` is its file.

    Raises DataError that says what else there is.
    """
    try:
        model = onnx.load_from_string(data)
    except DecodeError:
        raise DataError(f"{name}: no ONNX model; use an estimator that exosight exported") from None
    if fault := _foreign(model):
        raise _refusal(name, fault)
    return model


def check_graph(
    model: onnx.ModelProto, inputs: dict[str, list[int]], outputs: dict[str, list[int]], size: int, name: str
) -> None:
    """Raise DataError unless a graph has these inputs and outputs, in bounded memory and time.

    inputs, outputs   of float32: name → shape after the batch; the first input is the image
    size              of the file [bytes]
    """
    for kind, found, wanted in (
        ("inputs", model.graph.input, inputs),
        ("outputs", model.graph.output, outputs),
    ):
        if (shapes := {value.name: _dims(value) for value in found}) != {
            key: [None, *shape] for key, shape in wanted.items()
        } or any(value.type.tensor_type.elem_type != TensorProto.FLOAT for value in found):
            raise DataError(f"{name}: {kind} {shapes} do not fit its metadata; export it again")
    pixels = math.prod(next(iter(inputs.values()))[1:])
    if _BYTES * pixels > size + _FEWER_BYTES:
        raise _refusal(name, f"images of {pixels} pixels in a file of {size} bytes")
    shapes = _shapes(model, inputs, name)
    if {key: shapes[key] for key in outputs} != {key: [BATCH, *shape] for key, shape in outputs.items()}:
        raise _refusal(name, "answers of another shape than its outputs")
    nodes = model.graph.node
    numbers = sum(math.prod(shapes[node.output[0]]) for node in nodes)
    if numbers > BATCH * (_NUMBERS * pixels + _MORE_NUMBERS):
        raise _refusal(name, f"{numbers / BATCH:.1e} numbers in memory for an image")
    products = sum(_products(node, shapes) for node in nodes)
    if products > BATCH * (_PRODUCTS * pixels + _MORE_PRODUCTS):
        raise _refusal(name, f"{products / BATCH:.1e} multiplications for an image")


def model_of(graph: onnx.GraphProto, card: Any) -> onnx.ModelProto:
    """A graph with its card, a dataclass with a schema, as exosight writes it."""
    model = onnx.helper.make_model(
        graph,
        ir_version=FILE_FORMAT,
        opset_imports=[onnx.helper.make_opsetid("", OPERATOR_SET)],
        producer_name="exosight",
        producer_version=exosight.__version__,
    )
    onnx.helper.set_model_props(model, card_to_metadata(card))
    onnx.checker.check_model(model, full_check=True)
    return model


def _refusal(name: str, fault: str) -> DataError:
    return DataError(f"{name}: not an estimator that exosight exports, it has {fault}; export it again")


def _foreign(model: onnx.ModelProto) -> str | None:
    """What a model holds that the exporter does not write, or None."""
    graph = model.graph
    attributes = [attribute for node in graph.node for attribute in node.attribute]
    parts: list[Message] = [
        *(model, graph),
        *graph.node,
        *attributes,
        *graph.initializer,
        *graph.input,
        *graph.output,
    ]
    for part in parts:
        kind = type(part).__name__
        for field, _ in part.ListFields():
            if field.name not in _FIELDS[kind]:
                return f"{field.name} in its {kind}"
    versions = [(entry.domain, entry.version) for entry in model.opset_import]
    if (model.ir_version, versions) != (FILE_FORMAT, [("", OPERATOR_SET)]):
        return f"format {model.ir_version} and operator sets {versions[:3]}"
    if len(graph.node) > _NODES or len(graph.initializer) > _TENSORS:
        return f"{len(graph.node)} nodes and {len(graph.initializer)} tensors"
    names = [value.name for value in (*graph.input, *graph.initializer)]
    if len(set(names)) < len(names):
        return "two inputs or tensors of one name"
    for node in graph.node:
        if node.op_type not in _OPERATORS:
            return f"the operator {node.op_type[:40]!r}"
        if len(node.input) > _INPUTS or len(node.output) != 1:
            return f"an operator {node.op_type} of {len(node.input)} inputs, {len(node.output)} outputs"
    for attribute in attributes:
        if attribute.type not in _PLAIN or any(
            abs(x) > _LARGEST_INTEGER for x in (attribute.i, *attribute.ints)
        ):
            return f"the attribute {attribute.name[:40]!r} of another kind or size"
    return next((fault for tensor in graph.initializer if (fault := _foreign_tensor(tensor))), None)


def _foreign_tensor(tensor: TensorProto) -> str | None:
    name, dims = repr(tensor.name[:40]), list(tensor.dims)
    if tensor.data_type not in _ITEM:
        return f"a tensor {name} that is neither float32 nor int64"
    if min(dims, default=1) < 0 or math.prod(dims) * _ITEM[tensor.data_type] != len(tensor.raw_data):
        return f"a tensor {name} of shape {dims[:8]} in {len(tensor.raw_data)} bytes"
    if tensor.data_type == TensorProto.INT64:
        values = onnx.numpy_helper.to_array(tensor)
        if values.size > _FEW or (abs(values.astype(float)) > _LARGEST_INTEGER).any():
            return f"integers in {name} that are no places or sizes"
    return None


def _dims(value: onnx.ValueInfoProto) -> list[Any]:
    """The shape of a value; None for a size that is not fixed."""
    return [dim.dim_value if dim.HasField("dim_value") else None for dim in value.type.tensor_type.shape.dim]


def _shapes(model: onnx.ModelProto, inputs: dict[str, list[int]], name: str) -> dict[str, list[int]]:
    """The shape of every value for a full batch, without any of it computed."""
    graph = model.graph
    few = [tensor for tensor in graph.initializer if tensor.data_type == TensorProto.INT64]
    floats = {x.name: list(x.dims) for x in graph.initializer if x.data_type == TensorProto.FLOAT}
    known = {key: [BATCH, *shape] for key, shape in inputs.items()} | floats
    value = onnx.helper.make_tensor_value_info
    try:
        outline = onnx.helper.make_graph(
            graph.node,
            "outline",
            [value(key, TensorProto.FLOAT, dims) for key, dims in known.items()],
            [value(answer.name, TensorProto.FLOAT, [None] * len(_dims(answer))) for answer in graph.output],
            few,
        )
        whole = onnx.helper.make_model(outline, ir_version=FILE_FORMAT, opset_imports=model.opset_import)
        onnx.checker.check_model(whole)
        found = onnx.shape_inference.infer_shapes(whole, check_type=True, strict_mode=True, data_prop=True)
    except Exception as error:  # its exceptions share no base of their own
        raise DataError(f"{name}: its graph is not valid ({str(error)[:200]}); export it again") from error
    shapes = known | {tensor.name: list(tensor.dims) for tensor in few}
    results = [*found.graph.value_info, *found.graph.output]
    shapes |= {value.name: _dims(value) for value in results if value.type.tensor_type.elem_type in _RESULTS}
    for node in graph.node:
        dims = shapes.get(node.output[0], [None])
        if any(dim is None or dim < 0 for dim in dims):
            raise _refusal(name, f"an operator {node.op_type} whose result may have any size")
    return shapes


def _products(node: onnx.NodeProto, shapes: dict[str, list[int]]) -> int:
    """At least the multiplications of a node."""
    results = math.prod(shapes[node.output[0]])
    if node.op_type == "Conv":
        return results * math.prod(shapes[node.input[1]][1:])
    if node.op_type in ("Gemm", "MatMul"):
        return results * max(shapes[node.input[0]], default=1)
    kernel = [attribute.ints for attribute in node.attribute if attribute.name == "kernel_shape"]
    return results * math.prod(kernel[0]) if kernel else results
