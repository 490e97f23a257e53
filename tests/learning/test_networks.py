from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from schemas import mixed_schema, published_schema
from torch import nn

from exosight.errors import InputError
from exosight.learning.networks import NETWORKS, SensorModel, build_network
from exosight.learning.outputs import nonnegative


def multiply_adds(network: nn.Sequential, height: int, width: int) -> int:
    """Sum, over convolutions and dense layers, of outputs times terms in each output's sum."""
    total = 0

    def count(layer: nn.Module, _: object, output: torch.Tensor) -> None:
        nonlocal total
        if isinstance(layer, nn.Conv2d):
            total += output.numel() * layer.weight[0].numel()
        elif isinstance(layer, nn.Linear):
            total += layer.weight.numel()

    for layer in network.modules():
        layer.register_forward_hook(count)
    with torch.no_grad():
        network.eval()(torch.zeros(1, 1, height, width))
    return total


def test_paper_network_has_the_published_parameter_count():
    network = build_network("paper", published_schema(), 0, 0)
    assert sum(p.numel() for p in network.parameters() if p.requires_grad) == 78_847


def test_paper_network_is_the_one_of_the_specification():
    layers = list(build_network("paper", published_schema(), 0, 0))
    filters = [layer.out_channels for layer in layers if isinstance(layer, nn.Conv2d)]
    dense = [layer.out_features for layer in layers if isinstance(layer, nn.Linear)]
    assert filters == [64, 64, 32, 32, 8]
    assert dense == [32, 64, 64, 7]
    assert all(layer.padding == (0, 0) for layer in layers if isinstance(layer, nn.Conv2d))
    assert sum(isinstance(layer, nn.BatchNorm2d) for layer in layers) == 5
    assert sum(isinstance(layer, nn.MaxPool2d) for layer in layers) == 4
    assert isinstance(layers[-1], nn.Linear)


def test_light_network_costs_a_quarter_of_the_papers():
    light = multiply_adds(build_network("light", published_schema(), 5, 0), 128, 128)
    paper = multiply_adds(build_network("paper", published_schema(), 0, 0), 128, 128)
    # By hand: 32²·144·48 + 16²·(432 + 576)·64 + 8²·(576 + 2·864)·96 + 4²·864·64 + 1024·128 + 128·26.
    assert light == 38_767_872
    # By hand: 126²·9·64 + 61²·576·64 + 28²·576·32 + 12²·288·32 + 4²·288·8 + 128·32 + 32·64 + 64·64 + 64·7.
    assert paper == 162_140_864


@settings(max_examples=12, deadline=None)
@given(height=st.integers(8, 25), width=st.integers(8, 25), auxiliary=st.integers(0, 4))
def test_light_network_takes_any_image_of_whole_blocks(height: int, width: int, auxiliary: int):
    network = build_network("light", published_schema(4 * height, 4 * width), auxiliary, 0).eval()
    assert network(torch.zeros(2, 1, 4 * height, 4 * width)).shape == (2, 21 + auxiliary)


@settings(max_examples=20, deadline=None)
@given(low=st.floats(0, 0.7), span=st.floats(0.2, 1.0))
def test_light_network_does_not_mind_contrast(low: float, span: float):
    """Gray levels mapped linearly: a standard deviation above 0.05 is not changed by the floor of 1/100."""
    network = build_network("light", published_schema(32, 32), 0, 0).eval()
    image = torch.from_numpy(np.random.default_rng(0).random((1, 1, 32, 32), dtype=np.float32))
    with torch.no_grad():
        plain, faded = network(image), network(low + (1 - low) * span * image)
    # 1e-4 under the root, against a variance of at least (0.06/√12)² = 3e-4, shrinks it by up to 15 %.
    assert torch.nn.functional.cosine_similarity(plain, faded).item() > 0.99


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("paper", (64, 64)),
        ("paper", (128, 127)),
        ("light", (28, 64)),
        ("light", (64, 5000)),
        ("light", (64, 66)),
    ],
)
def test_sizes_that_a_network_cannot_take_are_refused(name: str, size: tuple[int, int]):
    with pytest.raises(InputError, match=f"{size[0]}×{size[1]}"):
        build_network(name, published_schema(*size), 0, 0)


@pytest.mark.parametrize("name", NETWORKS)
def test_first_weights_follow_from_the_seed_alone(name: str):
    torch.manual_seed(1)
    before = torch.get_rng_state()
    first, again, other = (build_network(name, published_schema(), 0, seed) for seed in (3, 3, 4))
    assert torch.equal(torch.get_rng_state(), before)
    for key, tensor in first.state_dict().items():
        assert torch.equal(tensor, again.state_dict()[key])
    assert not torch.equal(first[-1].weight, other[-1].weight)


def test_forces_are_scaled_and_never_negative():
    network = build_network("light", published_schema(32, 32), 2, 0).eval()
    scale = torch.tensor([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    images = torch.from_numpy(np.random.default_rng(0).random((16, 1, 32, 32), dtype=np.float32))
    with torch.no_grad():
        raw = network(images)
        forces, error, contact = SensorModel(network, scale, np.ones(7, dtype=bool))(images)
    assert (raw[:, :7] < 0).any()
    assert (raw[:, :7] > 0).any()
    assert torch.equal(forces, torch.where(raw[:, :7] > 0, raw[:, :7] * scale, 0.0))
    assert torch.equal(error, raw[:, 7:14].clamp(-6, 4).exp() * scale)
    assert torch.equal(contact, torch.sigmoid(raw[:, 14:21]))


def test_a_network_that_tells_forces_alone_errs_by_its_scale_and_sees_contact_where_it_sees_force():
    scale = torch.arange(1.0, 8.0)
    with torch.no_grad():
        network = build_network("paper", published_schema(), 0, 0).eval()
        forces, error, contact = SensorModel(network, scale, np.ones(7, dtype=bool))(
            torch.rand(3, 1, 128, 128)
        )
    assert torch.equal(error, scale.expand(3, 7))
    assert torch.equal(contact, (forces > 0).float())


@pytest.mark.parametrize(("name", "size"), [("light", (32, 32)), ("paper", (128, 128))])
def test_any_sensors_can_be_outputs_and_only_forces_are_limited_at_zero(name: str, size: tuple[int, int]):
    schema = mixed_schema(*size)
    network = build_network(name, schema, 3, 0).eval()
    images = torch.from_numpy(np.random.default_rng(0).random((64, 1, *size), dtype=np.float32))
    scale = torch.tensor([1.0, 2.0, 3.0, 4.0])
    with torch.no_grad():
        network.last.bias[:4] -= network(images)[:, :4].median(dim=0).values  # about half of each below zero
        raw = network(images)[:, :4] * scale
        values, error, contact = SensorModel(network, scale, nonnegative(schema))(images)
    assert (raw < 0).any(dim=0).all()
    assert torch.equal(values[:, 1], raw[:, 1])  # the angle
    forces = [0, 2, 3]
    assert torch.equal(values[:, forces], raw[:, forces].clamp(min=0))
    assert (error > 0).all()
    assert (contact[:, 1] == 0).all()
    assert (contact[:, forces] > 0).any()


def test_commands_count_in_quarters_of_their_peaks():
    """Two channels in units of their own: scaled with its channel's range, a command adds the same."""
    schema = mixed_schema()
    first = replace(schema.channels[0], high=8000.0)
    finer = replace(schema, channels=(first, schema.channels[1]))
    image = torch.rand(5, 1, 32, 32)
    commands = torch.rand(5, 2) * torch.tensor([80.0, 4.0])
    with torch.no_grad():
        plain, scaled = (build_network("light", s, 0, 0, actuation=True).eval() for s in (schema, finer))
        found = plain(image, commands)
        assert torch.allclose(found, scaled(image, commands * torch.tensor([100.0, 1.0])), atol=1e-6)
        assert not torch.allclose(found, plain(image, 0 * commands), atol=1e-3)
