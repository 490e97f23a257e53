"""The estimator on a model with a closed form: C_i = i · mean gray value, minus 1 N on C7, never negative."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from cards import made_up
from closed_form import CARD, closed_form, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper
from schemas import mixed_schema, published_schema

from exosight.control.estimator import DEFAULT_MODEL, NAMED_MODELS, SHIPPED_MODELS, OnnxEstimator, model_path
from exosight.errors import DataError, InputError
from exosight.learning.model_file import card_to_metadata, seal
from exosight.system.schema import network_difference

with_files = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write(tmp_path / "model.onnx", closed_form())


@pytest.mark.parametrize("count", [0, 1, 64, 200])
def test_forces_follow_the_closed_form_for_any_number_of_images(model: Path, count: int):
    images = np.random.default_rng(0).integers(0, 256, (count, 6, 8), np.uint8)
    mean = images.mean(axis=(1, 2)) / 255
    expected = mean[:, None] * np.arange(1, 8)
    expected[:, 6] = np.maximum(0, expected[:, 6] - 1)
    forces = OnnxEstimator.load(model).estimate(images)
    assert forces.dtype == np.float32
    # Single precision over sums of 48 terms.
    assert forces == pytest.approx(expected, abs=1e-5)


def test_a_probability_that_round_off_carries_past_one_is_one(model: Path):
    """As runtimes for single precision answer where contact is certain."""
    estimator = OnnxEstimator.load(model)

    class Certain:
        def run(self, names: list[str], given: dict[str, np.ndarray]) -> list[np.ndarray]:
            values, error, contact, score = estimator.session.run(names, given)
            return [values, error, np.full_like(contact, np.nextafter(np.float32(1), np.float32(2))), score]

    found = replace(estimator, session=Certain()).read(np.zeros((2, 6, 8), np.uint8))
    assert np.all(found.contact == 1)


def test_intervals_follow_the_closed_form(model: Path):
    """Half widths at 90 %: three times the expected error, 0.1 N + 0.1 F; once where the estimate is zero."""
    images = np.stack([np.zeros((6, 8), np.uint8), np.full((6, 8), 51, np.uint8)])  # mean 0 and 0.2
    read = OnnxEstimator.load(model).read(images)
    forces = np.array([[0.0] * 7, [0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 0.4]])
    half = np.where(forces > 0, 3, 1) * (0.1 + 0.1 * forces)
    # Single precision over sums of 48 terms.
    assert read.forces == pytest.approx(forces, abs=1e-5)
    assert read.low == pytest.approx(np.maximum(0, forces - half), abs=1e-5)
    assert read.high == pytest.approx(forces + half, abs=1e-5)
    assert read.contact[0] == pytest.approx([0.5] * 6 + [1 / (1 + np.e)], abs=1e-5)
    assert read.ood_score == pytest.approx([0, 0.2 / 0.5], abs=1e-5)
    wide, narrow = (OnnxEstimator.load(model).read(images, level) for level in (0.99, 0.5))
    assert np.all(wide.high - wide.low >= narrow.high - narrow.low)
    with pytest.raises(InputError, match=r"level: expected one of 0.5, 0.8, 0.9, 0.95, 0.99, got 0.7"):
        OnnxEstimator.load(model).read(images, 0.7)


def test_the_card_reads_back(model: Path):
    assert OnnxEstimator.load(model, threads=2).card == CARD


@pytest.mark.parametrize(
    "images",
    [
        np.zeros((1, 8, 6), np.uint8),
        np.zeros((6, 8), np.uint8),
        np.zeros((2, 1, 6, 8), np.uint8),
        np.zeros((1, 6, 8), np.float32),
    ],
)
def test_images_of_another_size_or_type_are_refused(model: Path, images: np.ndarray):
    with pytest.raises(InputError, match=r"needs uint8 \(frames, 6, 8\), got .* to 6×8 pixels"):
        OnnxEstimator.load(model).estimate(images)


@with_files
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_truncated_model_is_a_data_error(model: Path, share: float):
    data = seal(closed_form().SerializeToString())
    model.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DataError, match="truncated or changed"):
        OnnxEstimator.load(model)


@with_files
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_one_flipped_bit_is_a_data_error(model: Path, share: float, bit: int):
    data = bytearray(seal(closed_form().SerializeToString()))
    data[int(share * len(data))] ^= 1 << bit
    model.write_bytes(data)
    with pytest.raises(DataError, match="truncated or changed"):
        OnnxEstimator.load(model)


@with_files
@given(data=st.binary(max_size=300), sealed=st.booleans())
def test_random_bytes_are_a_data_error(model: Path, data: bytes, sealed: bool):
    model.write_bytes(seal(data) if sealed else data)
    with pytest.raises(DataError):
        OnnxEstimator.load(model)


@with_files
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_sealed_part_of_a_model_is_a_data_error(model: Path, share: float):
    """Even where a cut falls between two fields, and the seal fits."""
    data = closed_form().SerializeToString()
    model.write_bytes(seal(data[: int(share * len(data))]))
    with pytest.raises(DataError):
        OnnxEstimator.load(model)


def test_a_missing_model_is_a_data_error(tmp_path: Path):
    with pytest.raises(DataError, match="cannot be read"):
        OnnxEstimator.load(tmp_path / "nowhere.onnx")


def test_an_onnx_file_of_someone_else_is_a_data_error(tmp_path: Path):
    model = closed_form()
    del model.metadata_props[:]
    onnx.save(model, tmp_path / "theirs.onnx")
    with pytest.raises(DataError, match="not an estimator that exosight exported"):
        OnnxEstimator.load(tmp_path / "theirs.onnx")


def other_size(model: onnx.ModelProto) -> None:
    helper.set_model_props(model, card_to_metadata(replace(CARD, schema=published_schema(128, 8))))


def no_card(model: onnx.ModelProto) -> None:
    del model.metadata_props[:]


def nonsense_in_the_card(model: onnx.ModelProto) -> None:
    helper.set_model_props(model, card_to_metadata(CARD) | {"schema": "{}"})


def operator_of_a_plug_in(model: onnx.ModelProto) -> None:
    model.graph.node[0].domain = "com.elsewhere"
    model.opset_import.append(helper.make_opsetid("com.elsewhere", 1))


@pytest.mark.parametrize("change", [other_size, no_card, nonsense_in_the_card, operator_of_a_plug_in])
def test_a_model_that_is_no_estimator_is_a_data_error(
    tmp_path: Path, change: Callable[[onnx.ModelProto], None]
):
    model = closed_form()
    change(model)
    with pytest.raises(DataError, match=r"fit its metadata|not an estimator|cannot use this model"):
        OnnxEstimator.load(write(tmp_path / "model.onnx", model))


@pytest.mark.parametrize("place", ["weights.bin", "../weights.bin", "absolute"])
def test_weights_in_another_file_are_refused(tmp_path: Path, place: str, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "folder"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for where in (tmp_path, folder):
        (where / "weights.bin").write_bytes(np.ones(48 * 7, np.float32).tobytes())
    model = closed_form()
    weight = model.graph.initializer[0]
    weight.ClearField("raw_data")
    weight.data_location = TensorProto.EXTERNAL
    entry = weight.external_data.add()
    entry.key, entry.value = "location", str(folder / "weights.bin") if place == "absolute" else place
    with pytest.raises(DataError, match="it has external_data"):
        OnnxEstimator.load(write(folder / "model.onnx", model))


def test_answers_that_are_not_finite_are_refused(tmp_path: Path):
    model = closed_form()
    bias = numpy_helper.from_array(np.array([np.inf] * 7, np.float32), "bias")
    model.graph.initializer[1].CopyFrom(bias)
    estimator = OnnxEstimator.load(write(tmp_path / "model.onnx", model))
    with pytest.raises(DataError, match="not finite"):
        estimator.estimate(np.zeros((1, 6, 8), np.uint8))


def test_large_images_are_answered_in_smaller_groups():
    """A layer of 96 numbers a pixel, the most that a file may have, then takes 0.4 GB at any size."""
    counts: list[int] = []

    class Session:
        def run(self, names: list[str], given: dict[str, np.ndarray]) -> list[np.ndarray]:
            counts.append(len(given["image"]))
            rows = np.zeros((counts[-1], 7), np.float32)
            return [rows, rows, rows, rows[:, 0]]

    for (height, width), largest in (((128, 128), 64), ((480, 640), 3), ((2000, 2000), 1)):
        counts.clear()
        OnnxEstimator(Session(), made_up(height, width)).read(np.zeros((5, height, width), np.uint8))
        assert sum(counts) == 5
        assert max(counts) == min(5, largest)


def test_networks_by_name_fit_their_system() -> None:
    for name, path in NAMED_MODELS.items():
        assert model_path(Path(name), "index") == path
        named, shipped = OnnxEstimator.load(path).card, OnnxEstimator.load(model_path(None, "index")).card
        assert network_difference(named.schema, shipped.schema) is None
    assert model_path(Path("other.onnx"), "index") == Path("other.onnx")


def test_a_system_of_another_name_gets_the_network_of_its_sensors_and_cameras() -> None:
    """As an identified rig does, whose loads may be in another unit."""
    for name in ("published", "index"):  # that of index-friction estimates the same as that of index
        path = SHIPPED_MODELS[name]
        known = OnnxEstimator.load(path).card.schema
        (channel,) = known.channels
        renamed = replace(known, system="my_rig", channels=(replace(channel, unit="kPa"),))
        assert model_path(None, renamed) == model_path(Path("shipped"), renamed) == path, name
    assert model_path(None, published_schema(64, 64)) == DEFAULT_MODEL
    assert model_path(None, replace(mixed_schema(), system="other")) == DEFAULT_MODEL
