"""A network calibrated for the exosuit of the paper's study."""

from dataclasses import replace

import numpy as np
import pytest

from exosight.control import CONTROL_SHAPE, ControllerConfig, OnnxEstimator
from exosight.control.calibration import Calibrated, calibrate_estimator
from exosight.control.estimator import DEFAULT_MODEL, Reading
from exosight.control.tuning import tune
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published
from exosight.vision import Camera, resized


class Misreads:
    """Answers the forces that it was given, instead of looking."""

    def __init__(self, forces: np.ndarray) -> None:
        self.forces = forces.astype(np.float32)

    def read(self, images: np.ndarray, level: float = 0.9) -> Reading:
        half = np.float32(0.01)
        return Reading(
            self.forces,
            self.forces - half,
            self.forces + half,
            self.forces,
            np.zeros(len(self.forces), np.float32),
        )


TRUE = np.linspace(0, 0.3, 11)[:, None] * np.array([0, 0, 1.0, 0, 0.5, 0, 0])


def calibrated(estimates: np.ndarray, error: np.ndarray) -> Calibrated:
    return Calibrated(
        Misreads(estimates),
        estimated=TRUE + error,
        true=TRUE,
        joined=np.ones(len(TRUE) - 1, bool),
    )


def test_on_the_path_forces_become_the_true_ones_also_between_its_points():
    error = np.linspace(0.01, 0.03, 11)[:, None] * np.eye(7)[2]
    between = 0.5 * (TRUE[1:] + TRUE[:-1])
    seen = calibrated(between + 0.5 * (error[1:] + error[:-1]), error).read(np.zeros((10, 1, 1), np.uint8))
    np.testing.assert_allclose(seen.forces, between, atol=1e-6)  # float32
    # Intervals move with the forces, and end at 0 N.
    np.testing.assert_allclose(seen.high, between + 0.01, atol=1e-6)
    np.testing.assert_allclose(seen.low, np.maximum(between - 0.01, 0), atol=1e-6)


def test_far_from_the_path_nothing_changes():
    far = TRUE + 0.3 * np.eye(7)[6]
    seen = calibrated(far, 0.02 * np.ones_like(TRUE)).read(np.zeros((11, 1, 1), np.uint8))
    np.testing.assert_allclose(seen.forces, far, atol=1e-6)


def test_nothing_is_corrected_across_a_jump():
    joined = np.ones(10, bool)
    joined[4] = False
    error = 0.02 * np.eye(7)[2] * (np.arange(11) > 4)[:, None]
    before = TRUE[4][None]
    seen = replace(calibrated(before, error), joined=joined).read(np.zeros((1, 1, 1), np.uint8))
    np.testing.assert_allclose(seen.forces, before, atol=1e-6)


def test_a_path_that_is_none_is_refused():
    good = calibrated(TRUE, 0 * TRUE)
    for wrong in (
        {"estimated": TRUE[:1], "true": TRUE[:1], "joined": np.ones(0, bool)},
        {"joined": np.ones(3, bool)},
        {"joined": np.zeros(10, bool)},
        {"true": TRUE + np.nan},
    ):
        with pytest.raises(InputError, match="calibration"):
            replace(good, **wrong)


@pytest.fixture(scope="module")
def config() -> ControllerConfig:
    return tune(published(Exosuit(CONTROL_SHAPE)))


def test_the_shipped_network_reads_its_own_exosuit_to_the_forces_of_the_simulation(config):
    network = OnnxEstimator.load(DEFAULT_MODEL)
    own = calibrate_estimator(network, published(Exosuit(CONTROL_SHAPE)), config)
    paths = np.concatenate([config.loading.outputs, config.unloading.outputs[1:]])
    # Both paths were solved from rest over the same loads, but for how the solver was restarted.
    np.testing.assert_allclose(own.true, paths, atol=1e-6)
    jumps = config.loading.snapped.sum() + config.unloading.snapped.sum()
    assert own.joined.sum() == len(paths) - 1 - jumps
    plain = np.abs(own.estimated.sum(axis=1) - own.true.sum(axis=1))
    assert plain.max() > 0.01  # what there is to be taken off
    corrected = np.array([row - own._error(row) for row in own.estimated])
    # Where two poses look nearly alike to the network the nearest may be the other.
    assert np.quantile(np.abs(corrected - own.true), 0.95) < 1e-3


def test_a_camera_of_another_size_is_refused(config):
    small = published(Exosuit(CONTROL_SHAPE), resized(Camera(), 48, 32))
    with pytest.raises(InputError, match="camera camera: expected width 48, got 128"):
        calibrate_estimator(OnnxEstimator.load(DEFAULT_MODEL), small, config)
