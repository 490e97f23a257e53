"""Starting from a network that has learned already: the same answers at first, and better ones soon."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from schemas import mixed_schema, published_schema

from exosight.errors import DataError, InputError
from exosight.learning import (
    TrainConfig,
    TrainingData,
    export_onnx,
    load_model,
    load_pretrained,
    read_history,
    train,
)
from exosight.learning.checkpoint import RunIdentity, load_checkpoint
from exosight.learning.config import PRETRAINED_SHARE, resolve
from exosight.learning.model_file import open_model, seal
from exosight.learning.model_inputs import ModelInputs
from exosight.learning.networks import ActuationEmbedding, Network, SensorModel, build_network
from exosight.learning.outputs import nonnegative
from exosight.learning.pretrained import Pretrained, check_pretrained, first_weights
from exosight.learning.recipes import RECIPES
from exosight.system.schema import Schema

_KINDS = {
    "light": (TrainConfig(epochs=2, batch=16, threads=1, precision="float32"), (40, 40)),
    "light, history and u": (
        TrainConfig(epochs=2, batch=16, threads=1, precision="float32", history=1, actuation=True),
        (40, 40),
    ),
    "paper": (TrainConfig(network="paper", epochs=1, batch=8, threads=1), (128, 128)),
}


@pytest.fixture(scope="module")
def pretrained(trained: Path, blobs: TrainingData, tmp_path_factory: pytest.TempPathFactory) -> Pretrained:
    path = tmp_path_factory.mktemp("pretrained") / "light.onnx"
    export_onnx(trained, path, blobs.images[64:], blobs.labels[64:])
    return load_pretrained(path)


def as_network(identity: RunIdentity, weights: dict[str, torch.Tensor]) -> Network:
    network = identity.build_network()
    network.load_state_dict(weights)
    return network


@pytest.mark.parametrize("kind", _KINDS)
def test_it_answers_as_the_file_whatever_the_units_of_its_forces(
    kind: str, tmp_path: Path, identity: dict
) -> None:
    config, size = _KINDS[kind]
    rng = np.random.default_rng(4)
    images = rng.integers(0, 256, (24, *size), np.uint8)
    labels = rng.random((24, 7), dtype=np.float32)
    commands, previous = rng.uniform(0, 4, (24, 1)).astype(np.float32), np.maximum(np.arange(24) - 1, 0)
    data = TrainingData(
        *(published_schema(*size), images, labels, np.arange(16), np.arange(16, 24), identity),
        commands=commands,
        previous=previous,
    )
    train(config, data, tmp_path)
    history = images[previous][:, None] if config.history else None
    given_commands = commands if config.actuation else None
    export_onnx(tmp_path, tmp_path / "model.onnx", images, labels, ModelInputs(history, given_commands))

    session, card = open_model(tmp_path / "model.onnx", 1)
    seen = rng.random((8, *card.inputs["image"]), dtype=np.float32)
    given = {"image": seen, "commands": commands[:8]} if config.actuation else {"image": seen}
    expected = session.run(["forces", "expected_error"], given)

    run = load_checkpoint(tmp_path).run
    mine = replace(run, output_scale=tuple(rng.uniform(0.1, 3, 7).tolist()))
    asked = torch.from_numpy(seen), torch.from_numpy(commands[:8]) if config.actuation else None
    weights = first_weights(load_pretrained(tmp_path / "model.onnx"), mine, *asked)
    with torch.inference_mode():
        model = SensorModel(
            as_network(mine, weights), torch.tensor(mine.output_scale), nonnegative(mine.schema)
        ).eval()
        found = model(*asked)
    # Folded and unfolded again: float32 rounds elsewhere, and forces are of order one.
    np.testing.assert_allclose(found[0].numpy(), expected[0], atol=2e-5)
    if kind != "paper":  # which tells no error of its own
        np.testing.assert_allclose(found[1].numpy(), expected[1], rtol=2e-5)


def test_commands_that_join_count_for_nothing_at_first(
    pretrained: Pretrained, trained: Path, blobs: TrainingData
) -> None:
    run = load_checkpoint(trained).run
    driven = replace(run, settings=replace(run.settings, actuation=True))
    images = torch.from_numpy(blobs.images[64:]).float()[:, None] / 255
    commands = torch.linspace(-6, 6, len(images))[:, None]
    alone = as_network(run, first_weights(pretrained, run, images, None)).eval()
    joined = as_network(driven, first_weights(pretrained, driven, images, commands))
    with torch.no_grad():
        # Sums in the same order, but a layer that adds zeros: float32 rounds alike.
        np.testing.assert_allclose(joined.eval()(images, commands), alone(images), atol=1e-6)
    joined.train()(images, commands).square().sum().backward()
    (place,) = (layer for layer in joined if isinstance(layer, ActuationEmbedding))
    gradient = place.share.weight.grad
    assert gradient is not None
    assert gradient.abs().max() > 0  # and they are learned from


def test_images_are_normalised_by_their_own_mean_and_deviation(
    pretrained: Pretrained, trained: Path, blobs: TrainingData
) -> None:
    """In training, where each batch is, the answers are the same: nothing is lost in the first step."""
    run = load_checkpoint(trained).run
    images = torch.from_numpy(blobs.images).float()[:, None] / 255
    network = as_network(run, first_weights(pretrained, run, images, None))
    with torch.no_grad():
        still, moving = network.eval()(images), network.train()(images)
    # Channels that are zero throughout are divided by the root of their 1e-5.
    np.testing.assert_allclose(moving.numpy(), still.numpy(), atol=1e-3)
    fresh = build_network("light", run.schema, 2, 0)
    with torch.no_grad():
        gap = (fresh.train()(images) - fresh.eval()(images)).abs().max()
    assert gap > 0.1  # where it is not so, it shows


def test_a_run_begins_where_the_other_ended(
    pretrained: Pretrained,
    trained: Path,
    blobs: TrainingData,
    small: TrainConfig,
    tmp_path: Path,
    identity: dict,
) -> None:
    still = replace(small, recipe="clean", epochs=1, learning_rate=1e-9)
    train(still, blobs, tmp_path / "run", pretrained=pretrained)
    images = torch.from_numpy(blobs.images[64:]).float()[:, None] / 255
    with torch.inference_mode():
        before, after = (load_model(folder)(images)[0] for folder in (trained, tmp_path / "run"))
    # Forces go up to 2; the running statistics move with batches of 16 images, by about a percent.
    np.testing.assert_allclose(after.numpy(), before.numpy(), atol=0.04)
    settings = load_checkpoint(tmp_path / "run").run.settings
    assert settings.pretrained == pretrained.sha256
    assert read_history(tmp_path / "run")[0].learning_rate < 1e-9


def test_it_is_ahead_of_random_weights(
    pretrained: Pretrained, blobs: TrainingData, small: TrainConfig, tmp_path: Path, identity: dict
) -> None:
    config = replace(small, epochs=1)
    losses = []
    for name, first in (("random", None), ("learned", pretrained)):
        folder = tmp_path / name
        train(config, blobs, folder, pretrained=first)
        losses.append(read_history(folder)[0].validation_loss or np.inf)
    assert losses[1] < 0.7 * losses[0]


def test_a_run_is_taken_up_only_with_the_same_start(
    pretrained: Pretrained, blobs: TrainingData, small: TrainConfig, tmp_path: Path, identity: dict
) -> None:
    """Killed after its first epoch and taken up, it ends as one that never stopped, to the last bit."""
    config = replace(small, epochs=2)

    def go(folder: Path, **options) -> None:
        train(config, blobs, folder, **options)

    def stop(at) -> None:
        if at.epoch == 2:
            raise KeyboardInterrupt

    go(tmp_path / "whole", pretrained=pretrained)
    with pytest.raises(KeyboardInterrupt):
        go(tmp_path / "stopped", pretrained=pretrained, progress=stop)
    with pytest.raises(InputError, match=f"its pretrained is {pretrained.sha256}, asked for is none"):
        go(tmp_path / "stopped", resume=True)
    go(tmp_path / "stopped", pretrained=pretrained, resume=True)
    whole, stopped = (load_checkpoint(tmp_path / name).tensors for name in ("whole", "stopped"))
    assert all(torch.equal(whole[name], stopped[name]) for name in whole)


def test_commands_in_another_unit_count_where_they_are_inputs_alone(
    pretrained: Pretrained, trained: Path
) -> None:
    run = load_checkpoint(trained).run
    (channel,) = run.schema.channels
    other = replace(run, schema=replace(run.schema, channels=(replace(channel, unit="kPa"),)))
    check_pretrained(pretrained, other)
    driven = replace(pretrained, card=replace(pretrained.card, actuation=True))
    with pytest.raises(InputError, match="expected unit N, got kPa"):
        check_pretrained(driven, replace(other, settings=replace(run.settings, actuation=True)))
    none = replace(run, schema=replace(run.schema, channels=()))
    with pytest.raises(InputError, match="expected the channels u, got"):
        check_pretrained(pretrained, none)


def test_it_is_driven_less_hard() -> None:
    for recipe in ("modern", "clean"):
        config = TrainConfig(recipe=recipe)
        usual = resolve(config, "cpu", "float32").learning_rate
        assert resolve(config, "cpu", "float32", pretrained="x").learning_rate == pytest.approx(
            usual * PRETRAINED_SHARE
        )
        assert usual == RECIPES[recipe].learning_rate
        asked = replace(config, learning_rate=0.5)
        assert resolve(asked, "cpu", "float32", pretrained="x").learning_rate == 0.5


@pytest.mark.parametrize(
    ("config", "schema", "said"),
    [
        (
            TrainConfig(),
            published_schema(64, 40),
            "for another system: camera camera: expected height 40, got 64",
        ),
        (
            TrainConfig(),
            mixed_schema(40, 40),
            "for another system: expected the sensors C0, C1, .* got zone_0, ",
        ),
        (TrainConfig(history=2), published_schema(40, 40), "its history is 0, asked for is 2"),
    ],
)
def test_a_network_of_another_kind_is_refused(
    config: TrainConfig, schema: Schema, said: str, pretrained: Pretrained, tmp_path: Path, identity: dict
) -> None:
    images = np.zeros((24, *schema.image_size), np.uint8)
    data = TrainingData(
        *(schema, images, np.ones((24, len(schema.outputs)), np.float32)),
        *(np.arange(16), np.arange(16, 24), identity),
        commands=np.zeros((24, len(schema.channels)), np.float32),
        previous=np.arange(24),
    )
    with pytest.raises(InputError, match=f"pretrained: .*{said}.*; start from one of the same kind"):
        train(replace(config, batch=8), data, tmp_path / "run", pretrained=pretrained)
    assert not (tmp_path / "run").exists()


def test_other_layers_than_ours_are_refused(
    pretrained: Pretrained, trained: Path, blobs: TrainingData, small: TrainConfig
) -> None:
    run = load_checkpoint(trained).run
    images = torch.from_numpy(blobs.images[:8]).float()[:, None] / 255
    other = dict(pretrained.weights)
    other["10.weight"] = other["10.weight"][:, :-1]
    with pytest.raises(
        DataError, match=r"pretrained: expected 10.weight of shape \(128, 256\), the file has"
    ):
        first_weights(replace(pretrained, weights=other), run, images, None)


def test_what_is_not_a_finite_weight_is_refused(trained: Path, blobs: TrainingData, tmp_path: Path) -> None:
    path = tmp_path / "light.onnx"
    export_onnx(trained, path, blobs.images[64:], blobs.labels[64:])
    proto = onnx.load(path)
    del proto.metadata_props[-1]  # its seal
    (broken,) = [x for x in proto.graph.initializer if x.name == "model.network.10.weight"]
    shape = tuple(broken.dims)
    broken.CopyFrom(onnx.numpy_helper.from_array(np.full(shape, np.nan, np.float32), broken.name))
    path.write_bytes(seal(proto.SerializeToString()))
    with pytest.raises(DataError, match="its weights are not those of an estimator of exosight"):
        load_pretrained(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataError, match="truncated or changed"):
        load_pretrained(path)
    with pytest.raises(DataError, match="cannot be read"):
        load_pretrained(tmp_path / "none.onnx")
