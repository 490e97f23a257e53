import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from exosight.errors import InputError
from exosight.learning.networks import NETWORKS, ForceModel, build_network


def multiply_adds(network: nn.Sequential, height: int, width: int) -> int:
    """Sum, over convolutions and dense layers, of outputs times terms in each output's sum."""
    total = 0
    signal = torch.zeros(1, 1, height, width)
    with torch.no_grad():
        for layer in network.eval():
            signal = layer(signal)
            if isinstance(layer, nn.Conv2d):
                total += signal.numel() * layer.weight[0].numel()
            elif isinstance(layer, nn.Linear):
                total += layer.weight.numel()
    return total


def test_paper_network_has_the_published_parameter_count():
    network = build_network("paper", (128, 128), 0)
    assert sum(p.numel() for p in network.parameters() if p.requires_grad) == 78_847


def test_paper_network_is_the_one_of_the_specification():
    layers = list(build_network("paper", (128, 128), 0))
    filters = [layer.out_channels for layer in layers if isinstance(layer, nn.Conv2d)]
    dense = [layer.out_features for layer in layers if isinstance(layer, nn.Linear)]
    assert filters == [64, 64, 32, 32, 8]
    assert dense == [32, 64, 64, 7]
    assert all(layer.padding == (0, 0) for layer in layers if isinstance(layer, nn.Conv2d))
    assert sum(isinstance(layer, nn.BatchNorm2d) for layer in layers) == 5
    assert sum(isinstance(layer, nn.MaxPool2d) for layer in layers) == 4
    assert isinstance(layers[-1], nn.Linear)


def test_light_network_costs_14_million_multiply_adds():
    light = multiply_adds(build_network("light", (128, 128), 0), 128, 128)
    paper = multiply_adds(build_network("paper", (128, 128), 0), 128, 128)
    # By hand: 64²·25·16 + 32²·144·32 + 16²·288·64 + 8²·576·64 + 4²·576·64 + 1024·64 + 64·7.
    assert light == 14_090_688
    # By hand: 126²·9·64 + 61²·576·64 + 28²·576·32 + 12²·288·32 + 4²·288·8 + 128·32 + 32·64 + 64·64 + 64·7.
    assert paper == 162_140_864
    assert 11 < paper / light < 12


@settings(max_examples=12, deadline=None)
@given(height=st.integers(32, 100), width=st.integers(32, 100))
def test_light_network_takes_any_image_from_32_pixels(height: int, width: int):
    network = build_network("light", (height, width), 0).eval()
    assert network(torch.zeros(2, 1, height, width)).shape == (2, 7)


@pytest.mark.parametrize(
    ("name", "size"), [("paper", (64, 64)), ("paper", (128, 127)), ("light", (31, 64)), ("light", (64, 5000))]
)
def test_sizes_that_a_network_cannot_take_are_refused(name: str, size: tuple[int, int]):
    with pytest.raises(InputError, match=f"{size[0]}×{size[1]}"):
        build_network(name, size, 0)


@pytest.mark.parametrize("name", NETWORKS)
def test_first_weights_follow_from_the_seed_alone(name: str):
    torch.manual_seed(1)
    before = torch.get_rng_state()
    first, again, other = (build_network(name, (128, 128), seed) for seed in (3, 3, 4))
    assert torch.equal(torch.get_rng_state(), before)
    for key, tensor in first.state_dict().items():
        assert torch.equal(tensor, again.state_dict()[key])
    assert not torch.equal(first[0].weight, other[0].weight)


def test_forces_are_scaled_and_never_negative():
    network = build_network("light", (32, 32), 0).eval()
    scale = torch.tensor([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    images = torch.from_numpy(np.random.default_rng(0).random((16, 1, 32, 32), dtype=np.float32))
    with torch.no_grad():
        raw = network(images)
        forces = ForceModel(network, scale)(images)
    assert (raw < 0).any()
    assert (raw > 0).any()
    assert torch.equal(forces, torch.where(raw > 0, raw * scale, 0.0))
