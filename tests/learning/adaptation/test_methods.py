"""What of a network changes: closed forms of the linear methods, and what stays."""

import copy

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from schemas import published_schema

from exosight.learning.adaptation import METHODS, Labelled, Method
from exosight.learning.adaptation.labelled import features, folds
from exosight.learning.adaptation.methods import fit, scaled
from exosight.learning.networks import SensorModel, answers, build_network
from exosight.learning.outputs import nonnegative

SCHEMA = published_schema(32, 32)
OUTPUTS = len(SCHEMA.outputs)


@pytest.fixture(scope="module")
def model() -> SensorModel:
    scale = torch.linspace(0.5, 2, OUTPUTS)
    return SensorModel(
        build_network("light", SCHEMA, 2, 3).eval(), scale, nonnegative(SCHEMA), torch.linspace(0, 3, OUTPUTS)
    ).eval()


def pictures(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, 1, 32, 32), np.uint8)


def labelled(images: np.ndarray, labels: np.ndarray) -> Labelled:
    """Five of each sequence."""
    return Labelled(images, None, labels, np.arange(len(images)) // 5)


def values(model: SensorModel, images: np.ndarray) -> np.ndarray:
    """In the sensors' units, before forces are kept from being negative."""
    data = labelled(images, np.zeros((len(images), OUTPUTS), np.float32))
    with torch.no_grad():
        found = answers(model.network.last(features(model, data)), OUTPUTS).values
        assert model.offset is not None
        return (found * model.scale + model.offset).numpy()


def test_gain_and_offset_are_found(model: SensorModel) -> None:
    few = pictures(40)
    gain, shift = np.linspace(-1.5, 2, OUTPUTS), np.linspace(2, -1, OUTPUTS)
    wanted = (gain * values(model, few) + shift).astype(np.float32)
    # What is held as by a tenth of a label is lost in values that vary by a thousand scales.
    loud = copy.deepcopy(model)
    with torch.no_grad():
        loud.network.last.weight[:OUTPUTS] *= 1e3
    wanted = (gain * values(loud, few) + shift).astype(np.float32)
    found = fit("affine", loud, labelled(few, wanted), 0)
    others = pictures(10, 1)
    expected = gain * values(loud, others) + shift
    np.testing.assert_allclose(values(found, others), expected, atol=2e-3 * np.abs(expected).max())


def test_with_one_label_only_the_offset_changes(model: SensorModel) -> None:
    few = pictures(1)
    wanted = values(model, few) + np.arange(OUTPUTS, dtype=np.float32)
    for method in ("affine", "last"):
        found = fit(method, model, labelled(few, wanted), 0)
        others = pictures(10, 1)
        np.testing.assert_allclose(
            values(found, others) - values(model, others), [range(OUTPUTS)] * 10, atol=1e-4
        )


def test_the_last_layer_is_the_ridge_regression_that_leaving_out_sequences_prefers(
    model: SensorModel,
) -> None:
    few = pictures(25)
    rng = np.random.default_rng(2)
    data = labelled(few, rng.normal(size=(25, OUTPUTS)).astype(np.float32))
    found = fit("last", model, data, 0)
    seen = features(model, data).double().numpy()
    with torch.no_grad():
        left = (
            scaled(model, data) - answers(model.network.last(features(model, data)), OUTPUTS).values
        ).numpy()

    def solve(rows: np.ndarray, ridge: float) -> tuple[np.ndarray, np.ndarray]:
        mean, centre = seen[rows].mean(0), left[rows].mean(0)
        apart = seen[rows] - mean
        change = np.linalg.solve(
            apart.T @ apart + ridge * np.eye(seen.shape[1]), apart.T @ (left[rows] - centre)
        )
        return change, centre - mean @ change

    everything = np.arange(25)
    spread = ((seen - seen.mean(0)) ** 2).sum() / seen.shape[1]
    errors = {}
    for ridge in spread * 10.0 ** np.arange(-4, 3):
        errors[ridge] = 0.0
        for rows in np.split(everything, 5):
            change, shift = solve(np.setdiff1d(everything, rows), ridge)
            errors[ridge] += ((left[rows] - seen[rows] @ change - shift) ** 2).sum()
    best = min(errors, key=lambda ridge: errors[ridge])
    change, shift = solve(everything, best)
    with torch.no_grad():
        mine = (found.network.last.weight - model.network.last.weight)[:OUTPUTS].T.double().numpy()
        moved = (found.network.last.bias - model.network.last.bias)[:OUTPUTS].double().numpy()
    np.testing.assert_allclose(mine, change, atol=1e-5 * np.abs(change).max() + 1e-6)
    np.testing.assert_allclose(moved, shift, atol=1e-5)


@given(st.lists(st.integers(0, 6), min_size=2, max_size=40), st.integers(2, 6))
def test_every_row_is_left_out_once_and_sequences_stay_whole(sequence: list[int], count: int) -> None:
    found = folds(np.array(sequence), count)
    np.testing.assert_array_equal(np.sort(np.concatenate(found)), np.arange(len(sequence)))
    assert 2 <= len(found) <= count
    assert all(len(rows) for rows in found)
    if len(set(sequence)) > 1:
        kept = [{sequence[row] for row in rows} for rows in found]
        assert sum(map(len, kept)) == len(set(sequence))


@pytest.mark.parametrize("method", METHODS)
def test_what_is_given_stays_and_errors_expected_are_not_learned_from_few_labels(
    model: SensorModel, method: Method
) -> None:
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    data = labelled(pictures(24), np.random.default_rng(0).random((24, OUTPUTS), np.float32))
    found = fit(method, model, data, 0)
    assert all(torch.equal(tensor, before[name]) for name, tensor in model.state_dict().items())
    assert torch.equal(found.network.last.weight[OUTPUTS:], model.network.last.weight[OUTPUTS:]) == (
        method != "all"
    )
    for name, tensor in found.state_dict().items():
        if "running" in name:
            assert torch.equal(tensor, before[name])


def test_all_layers_learn_what_the_last_one_cannot(model: SensorModel) -> None:
    """Forty pictures, each with an answer of its own, from features of which 128 are not enough in noise."""
    rng = np.random.default_rng(5)
    few = pictures(40)
    data = labelled(few, (rng.normal(size=(40, OUTPUTS)) + np.arange(OUTPUTS)).astype(np.float32))
    errors = {
        method: np.abs(values(fit(method, model, data, 0), few) - data.labels).mean() for method in METHODS
    }
    assert errors["all"] < errors["last"] <= errors["none"]
