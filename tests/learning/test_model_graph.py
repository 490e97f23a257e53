"""Estimators' files whose checksum was mended: what is in them is bounded before a runtime loads it."""

import json
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from closed_form import CARD, closed_form, write
from model_mutations import mutate, outcome
from onnx import TensorProto, helper, numpy_helper
from schemas import published_schema

from exosight.control.estimator import OnnxEstimator
from exosight.errors import DataError
from exosight.learning.model_file import card_to_metadata, seal

Change = Callable[[onnx.ModelProto], None]


def constants(model: onnx.ModelProto, **arrays: list[int]) -> None:
    for name, values in arrays.items():
        model.graph.initializer.append(numpy_helper.from_array(np.array(values), name))


def before(model: onnx.ModelProto, *nodes: onnx.NodeProto) -> None:
    """More nodes whose last one, "more", is added to the score."""
    graph = model.graph
    kept = [*graph.node]
    kept[-1].output[0] = "score"
    del graph.node[:]
    graph.node.extend([*nodes, *kept, helper.make_node("Add", ["score", "more"], ["ood_score"])])


def endless_loop(model: onnx.ModelProto) -> None:
    constants(model, count=[2**62])
    inputs = [
        helper.make_tensor_value_info("i", TensorProto.INT64, []),
        helper.make_tensor_value_info("go", TensorProto.BOOL, []),
        helper.make_tensor_value_info("x", TensorProto.FLOAT, []),
    ]
    outputs = [
        helper.make_tensor_value_info("go_on", TensorProto.BOOL, []),
        helper.make_tensor_value_info("y", TensorProto.FLOAT, []),
    ]
    body = [helper.make_node("Identity", ["go"], ["go_on"]), helper.make_node("Relu", ["x"], ["y"])]
    loop = helper.make_graph(body, "body", inputs, outputs)
    before(model, helper.make_node("Loop", ["count", "", "tenth"], ["more"], body=loop))


def large_constant(model: onnx.ModelProto) -> None:
    constants(model, size=[2**31], first=[0])
    before(
        model,
        helper.make_node("ConstantOfShape", ["size"], ["zeros"]),
        helper.make_node("Gather", ["zeros", "first"], ["more"]),
    )


def large_by_an_allowed_operator(model: onnx.ModelProto) -> None:
    constants(model, size=[2**15, 2**15], sides_of_it=[0, 1])
    before(
        model,
        helper.make_node("Expand", ["tenth", "size"], ["large"]),
        helper.make_node("ReduceMean", ["large", "sides_of_it"], ["more"], keepdims=0),
    )


def large_product(model: onnx.ModelProto) -> None:
    """Twice the product of every number with every other."""
    constants(model, column=[-1, 1], line=[1, -1], sides_of_it=[0, 1])
    squares = [
        node
        for source, square in (("image", "square"), ("square", "square_of_it"))
        for node in (
            helper.make_node("Reshape", [source, "column"], [f"{source}_column"]),
            helper.make_node("Reshape", [source, "line"], [f"{source}_row"]),
            helper.make_node("MatMul", [f"{source}_column", f"{source}_row"], [square]),
        )
    ]
    before(
        model, *squares, helper.make_node("ReduceMean", ["square_of_it", "sides_of_it"], ["more"], keepdims=0)
    )


def padded(model: onnx.ModelProto) -> None:
    model.graph.initializer.append(numpy_helper.from_array(np.ones((1, 1, 1, 1), np.float32), "one"))
    before(
        model,
        helper.make_node("Conv", ["image", "one"], ["large"], pads=[20_000] * 4),
        helper.make_node("ReduceMean", ["large", "sides"], ["more"], keepdims=0),
    )


def size_of_a_sum_of_pixels(model: onnx.ModelProto) -> None:
    """What the picture shows decides how large it gets."""
    constants(model, one=[1], all=[-1], sides_of_it=[0])
    before(
        model,
        helper.make_node("Reshape", ["image", "all"], ["flat_image"]),
        helper.make_node("Cast", ["flat_image"], ["sizes"], to=TensorProto.INT64),
        helper.make_node("Expand", ["tenth", "sizes"], ["large"]),
        helper.make_node("ReduceMean", ["large"], ["more"], keepdims=0),
    )


def large_image(model: onnx.ModelProto) -> None:
    card = replace(CARD, schema=published_schema(20_000, 20_000))
    helper.set_model_props(model, card_to_metadata(card))
    dims = model.graph.input[0].type.tensor_type.shape.dim
    dims[2].dim_value = dims[3].dim_value = 20_000


def claimed_size(model: onnx.ModelProto) -> None:
    model.graph.initializer[0].dims[0] = 2**31


def function(model: onnx.ModelProto) -> None:
    model.functions.append(
        helper.make_function("", "Relu", ["x"], ["y"], [helper.make_node("Abs", ["x"], ["y"])], [])
    )


def text_tensor(model: onnx.ModelProto) -> None:
    model.graph.initializer.append(helper.make_tensor("text", TensorProto.STRING, [1], [b"x"]))


def sparse_tensor(model: onnx.ModelProto) -> None:
    values = helper.make_tensor("sparse", TensorProto.FLOAT, [1], [1.0])
    places = helper.make_tensor("places", TensorProto.INT64, [1], [0])
    model.graph.sparse_initializer.append(helper.make_sparse_tensor(values, places, [2**40]))


def many_nodes(model: onnx.ModelProto) -> None:
    before(
        model,
        *(helper.make_node("Relu", [f"r{i}" if i else "tenth"], [f"r{i + 1}"]) for i in range(1000)),
        helper.make_node("Relu", ["r1000"], ["more"]),
    )


HOSTILE: dict[Change, str] = {
    endless_loop: "g in its AttributeProto",
    large_constant: "operator 'ConstantOfShape'",
    large_by_an_allowed_operator: "numbers in memory for an image",
    large_product: "numbers in memory for an image",
    padded: "numbers in memory for an image",
    size_of_a_sum_of_pixels: "whose result may have any size",
    large_image: "images of 400000000 pixels",
    claimed_size: "tensor 'weight' of shape",
    function: "functions in its ModelProto",
    text_tensor: "TensorProto",
    sparse_tensor: "sparse_initializer in its GraphProto",
    many_nodes: "nodes",
}


@pytest.mark.parametrize("change", HOSTILE)
def test_what_would_take_all_memory_or_time_is_refused(change: Change, tmp_path: Path):
    model = closed_form()
    change(model)
    with pytest.raises(DataError, match=HOSTILE[change]) as refused:
        OnnxEstimator.load(write(tmp_path / "model.onnx", model))
    assert "export it again" in str(refused.value)


ROWS = [[1.0] * 7] * 5


def tower() -> dict[str, Any]:
    """Each sensor the sum of the one before it, twice."""
    schema = json.loads(card_to_metadata(CARD)["schema"])
    zone = next(sensor for sensor in schema["sensors"] if sensor["estimated"])
    sums = [
        {**zone, "name": f"C{i}", "quantity": "net force", "estimated": False, "parts": [f"C{i - 1}"] * 2}
        for i in range(8, 100)
    ]
    return {**schema, "sensors": [*schema["sensors"], *sums]}


CARDS = {
    "a limit that is no number": ({"ood_limit": "NaN"}, "ood_limit: not JSON"),
    "an endless limit": ({"ood_limit": "1e999"}, "ood_limit"),
    "a limit of nothing": ({"ood_limit": "0.0"}, "ood_limit"),
    "no widths": ({"widths": '{"estimated_zero": [], "estimated_force": []}'}, "widths"),
    "widths of another number of sensors": (
        {"widths": json.dumps({"estimated_zero": ROWS, "estimated_force": [[1.0] * 6] * 5})},
        "widths.estimated_force: expected 5 rows of 7",
    ),
    "nested widths": (
        {"widths": json.dumps({"estimated_zero": [[[1.0]] * 7] * 5, "estimated_force": ROWS})},
        "widths.estimated_zero.0.0",
    ),
    "widths below zero": (
        {"widths": json.dumps({"estimated_zero": [[-1.0] * 7] * 5, "estimated_force": ROWS})},
        "widths.estimated_zero",
    ),
    "widths that fall": (
        {"widths": json.dumps({"estimated_zero": ROWS, "estimated_force": [[2.0] * 7, *ROWS[1:]]})},
        "rise with the level",
    ),
    "999 earlier images": ({"history": "999"}, "history"),
    "more seeds than there are": ({"seed": str(2**70)}, "seed"),
    "an epoch before the first": ({"epoch": "-1"}, "epoch"),
    "a loss that is no number": ({"validation_l1": "Infinity"}, "validation_l1: not JSON"),
    "an escape sequence": ({"network": "\x1b]0;title\x07"}, "network"),
    "settings in settings": ({"training": '{"batch": {"size": 8}}'}, "training.batch"),
    "data that are no number": ({"data": '{"seed": NaN}'}, "data: not JSON"),
    "brackets without end": ({"data": "[" * 100_000}, "data: not JSON"),
    "no sensor to estimate": (
        {"schema": card_to_metadata(CARD)["schema"].replace('"estimated": true', '"estimated": false')},
        "schema: expected a sensor to estimate",
    ),
    "sums of sums without end": ({"schema": json.dumps(tower())}, "C8: it counts a sensor twice"),
    "a large card": ({"input": "x" * 2**21}, "more than 1 MiB"),
    "no card": (dict.fromkeys(card_to_metadata(CARD), None), "Field required|missing"),
}


@pytest.mark.parametrize("case", CARDS)
def test_a_card_is_checked_to_the_last_field(case: str, tmp_path: Path):
    changes, said = CARDS[case]
    model = closed_form()
    entries = {**card_to_metadata(CARD), **changes}
    helper.set_model_props(model, {key: value for key, value in entries.items() if value is not None})
    with pytest.raises(DataError, match=said):
        OnnxEstimator.load(write(tmp_path / "model.onnx", model))


def test_a_network_that_fails_while_it_runs_says_so_in_a_sentence(tmp_path: Path):
    """Sizes that fit for 64 images alone."""
    model = closed_form()
    constants(model, all_of_them=[64, 1, 6, 8])
    model.graph.node.insert(0, helper.make_node("Reshape", ["image", "all_of_them"], ["same"]))
    model.graph.node[1].input[0] = "same"
    estimator = OnnxEstimator.load(write(tmp_path / "model.onnx", model))
    with pytest.raises(DataError, match="the network does not run"):
        estimator.estimate(np.zeros((1, 6, 8), np.uint8))


def test_mutations_estimate_or_are_refused_in_a_sentence(tmp_path: Path):
    valid = seal(closed_form().SerializeToString())
    path, found = tmp_path / "model.onnx", Counter[str]()
    for seed in range(800):
        path.write_bytes(mutate(valid, random.Random(seed)))
        found[outcome(path)] += 1
    assert found["refused"] > 400
    assert found["estimates"] > 10
