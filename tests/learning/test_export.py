from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from schemas import published_schema

from exosight.errors import DataError, InputError
from exosight.learning import TrainConfig, TrainingData, export, export_onnx, load_model, train
from exosight.learning.model_file import OUTPUTS, open_model
from exosight.learning.networks import SensorModel, build_network
from exosight.learning.outputs import nonnegative


@pytest.fixture(scope="module")
def exported(trained: Path, blobs: TrainingData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "light.onnx"
    export_onnx(trained, path, blobs.images[64:], blobs.labels[64:])
    return path


@pytest.mark.parametrize("count", [1, 2, 37])
def test_onnx_runtime_answers_as_pytorch_does_for_any_batch(exported: Path, trained: Path, count: int):
    images = np.random.default_rng(count).random((count, 1, 40, 40), dtype=np.float32)
    session, _ = open_model(exported, 1)
    found = session.run(list(OUTPUTS), {"image": images})
    with torch.inference_mode():
        expected = load_model(trained)(torch.from_numpy(images))
    assert found[3].shape == (count,)
    for mine, true in zip(found[:2], expected[:2], strict=True):
        assert mine.shape == (count, 7)
        # Batch normalisation is folded into the convolutions, so float32 rounds elsewhere.
        assert np.abs(mine - true.numpy()).max() < 1e-5
    # The log odds of contact differ by the same number in every image, see `contact_shift`.
    shift = logit(found[2]) - logit(expected[2].numpy())
    assert np.abs(shift - shift[0]).max() < 1e-4


def logit(probability: np.ndarray) -> np.ndarray:
    p = np.clip(probability.astype(np.float64), 1e-3, 1 - 1e-3)
    return np.log(p / (1 - p))


def test_contact_is_as_likely_as_it_is_frequent(trained: Path, blobs: TrainingData, exported: Path):
    """On the frames that the file was exported with; the network itself says otherwise."""
    session, _ = open_model(exported, 1)
    images = blobs.images[64:, None].astype(np.float32) / 255
    (found,) = session.run(["contact"], {"image": images})
    with torch.inference_mode():
        before = load_model(trained)(torch.from_numpy(images))[2].numpy().mean(axis=0)
    share = (blobs.labels[64:] > 0).mean(axis=0)
    tells = (share > 0) & (share < 1)
    assert tells.any()
    np.testing.assert_allclose(found.mean(axis=0)[tells], share[tells], atol=1e-4)
    assert np.abs(before - share)[tells].max() > 1e-3


def test_metadata_say_what_the_network_is(exported: Path):
    _, card = open_model(exported, 1)
    assert (card.network, card.seed) == ("light", 5)
    assert card.schema == published_schema(40, 40)
    assert card.data == {"camera": "512 px/m", "shapes": 3, "young": 300e3}
    assert card.training["learning_rate"] == 3e-3
    assert 1 <= card.epoch <= 6


def test_the_file_is_plain_onnx_and_holds_nothing_of_the_machine_that_wrote_it(exported: Path):
    model = onnx.load(exported)
    onnx.checker.check_model(model, full_check=True)
    assert [(entry.domain, entry.version) for entry in model.opset_import] == [("", 18)]
    assert model.ir_version == 8
    assert not any(node.metadata_props or node.doc_string for node in model.graph.node)
    assert {node.op_type for node in model.graph.node}.isdisjoint({"Loop", "If", "Scan"})
    data = exported.read_bytes()
    assert str(Path(export.__file__).parent).encode() not in data
    assert b".py" not in data


def test_the_paper_network_exports(tmp_path: Path, identity: dict):
    images = np.random.default_rng(0).integers(0, 256, (4, 128, 128), np.uint8)
    labels = np.ones((4, 7), np.float32)
    config = TrainConfig(network="paper", epochs=1, threads=1)
    data = TrainingData(published_schema(), images, labels, np.arange(3), np.arange(3, 4), identity)
    train(config, data, tmp_path / "run")
    card = export_onnx(tmp_path / "run", tmp_path / "models" / "paper.onnx", images, labels)
    assert (card.network, card.schema.image_size) == ("paper", (128, 128))
    assert open_model(tmp_path / "models" / "paper.onnx", 1)[1] == card


def test_an_existing_file_is_not_overwritten(trained: Path, blobs: TrainingData, tmp_path: Path):
    path = tmp_path / "mine.onnx"
    path.write_bytes(b"mine")
    with pytest.raises(InputError, match="exists already"):
        export_onnx(trained, path, blobs.images[64:], blobs.labels[64:])
    assert path.read_bytes() == b"mine"


def test_a_missing_run_is_a_data_error(blobs: TrainingData, tmp_path: Path):
    with pytest.raises(DataError, match="cannot be read"):
        export_onnx(tmp_path / "nowhere", tmp_path / "model.onnx", blobs.images, blobs.labels)


def test_a_network_that_answers_otherwise_is_not_written(
    trained: Path, blobs: TrainingData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    convert = export._convert

    def wrong(deployed: torch.nn.Module, card) -> onnx.ModelProto:
        other = build_network("light", card.schema, 2, 9).eval()
        model = SensorModel(other, deployed.model.scale, nonnegative(card.schema))
        return convert(export._Deployed(model, deployed.ood, card, None).eval(), card)

    monkeypatch.setattr(export, "_convert", wrong)
    with pytest.raises(DataError, match="differs from the trained one"):
        export_onnx(trained, tmp_path / "model.onnx", blobs.images[64:], blobs.labels[64:])
    assert list(tmp_path.iterdir()) == []
