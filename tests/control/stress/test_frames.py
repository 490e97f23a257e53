"""What reaches a controller of many plants: late, lost, repeated and spoilt frames."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from toy import SCHEMA

from exosight.control import OnnxEstimator
from exosight.control.batch import BatchPlant, BatchState
from exosight.control.estimator import DEFAULT_MODEL, Reading
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import Burst, Episode, draw_episode
from exosight.control.stress.frames import FrameDelivery, camera_sensor, true_sensor
from exosight.vision import BACKGROUND, Camera

QUIET = StressConfig(dropped=(0.0, 0.0), repeated=(0.0, 0.0), bursts=0, latency=(0.0, 0.0))


class Plants(BatchPlant):
    """Two plants whose C3 shows what they are told to."""

    schema = SCHEMA

    def __init__(self) -> None:
        self.at(0.0)

    @property
    def state(self) -> BatchState:
        return self._seen

    def at(self, force: float) -> "Plants":
        readings = np.zeros((2, len(SCHEMA.sensors)))
        readings[:, SCHEMA.index("C3")] = force
        commands = np.full((2, 1), 10 * force)
        self._seen = BatchState(SCHEMA, commands, readings, np.zeros((2, 1)), np.ones(2, bool), {})
        return self

    def pictures(self, camera: Camera, which: np.ndarray) -> np.ndarray:
        images = np.full((len(which), camera.height, camera.width), BACKGROUND, np.uint8)
        images[:, 50:70, 30:90] = 100
        return images


@pytest.fixture
def episodes(plants) -> Callable[..., list[Episode]]:
    """Two quiet episodes, changed as a test says."""
    drawn = [draw_episode(QUIET, 0, number, plants) for number in range(2)]
    return lambda **changes: [replace(episode, **changes) for episode in drawn]


def told(frames: FrameDelivery, plants: Plants, force: float, step: int):
    measurement = frames.measurements(plants.at(force), step)[0]
    return None if measurement.reading is None else float(measurement.reading.forces.sum()), measurement


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_frames_are_as_old_as_they_say_and_come_with_the_u_of_their_time(episodes, latency):
    plants, frames = Plants(), FrameDelivery(episodes(latency=latency), true_sensor)
    forces = [0.0, 0.1, 0.2, 0.3, 0.4]
    for step, force in enumerate(forces):
        seen, measurement = told(frames, plants, force, step)
        then = forces[max(step - latency, 0)]  # before the first step the plant stood at rest
        assert seen == pytest.approx(then)
        assert measurement.age == pytest.approx(0.1 * latency)
        assert measurement.commands == pytest.approx([10 * then])


def test_a_lost_frame_tells_nothing_and_a_repeated_one_the_last_thing_again(episodes):
    steps = len(episodes()[0].target)
    lost, again = np.zeros(steps, bool), np.zeros(steps, bool)
    lost[1], again[3] = True, True
    plants, frames = Plants(), FrameDelivery(episodes(lost=lost, again=again), true_sensor)
    assert told(frames, plants, 0.1, 0)[0] == pytest.approx(0.1)
    nothing, measurement = told(frames, plants, 0.2, 1)
    assert nothing is None
    assert measurement.image is None
    third, before = told(frames, plants, 0.3, 2)
    assert third == pytest.approx(0.3)
    repeated, measurement = told(frames, plants, 0.4, 3)
    assert repeated == pytest.approx(0.3)
    np.testing.assert_array_equal(measurement.image, before.image)
    assert measurement.commands == pytest.approx([4.0])  # the plant itself is not fooled


def test_bytes_stand_for_pictures_where_there_is_no_camera(episodes):
    plants = Plants()
    (first, _), _ = true_sensor(plants.at(0.1), episodes(), 0)
    (same, _), _ = true_sensor(plants.at(0.1), episodes(), 1)
    (other, _), _ = true_sensor(plants.at(0.1 + 1e-6), episodes(), 2)
    np.testing.assert_array_equal(first, same)
    assert (first != other).any()
    assert np.ptp(first) == 255  # not black


def test_noise_scatters_true_forces_and_what_hides_the_picture_is_noticed(episodes):
    noisy, hidden = Burst(0, 4, 0.0, 0.1, 3), Burst(3, 9, 0.3, 0.0, 4)
    own, plants = episodes(bursts=(noisy, hidden)), Plants()
    for step, (scatters, ood) in {0: (True, False), 4: (True, True), 9: (False, True)}.items():
        _, reading = true_sensor(plants.at(0.2), own, step)
        assert (abs(float(reading.forces[0].sum()) - 0.2) > 1e-6) == scatters
        assert (reading.ood_score[0] > 1) == ood
    again = [true_sensor(plants.at(0.2), own, 1)[1].forces for _ in range(2)]
    np.testing.assert_array_equal(*again)  # the same each time


def test_a_cameras_picture_is_noisy_or_hidden_as_long_as_the_spell_lasts(episodes):
    class Looks:
        def read(self, images: np.ndarray, level: float = 0.9) -> Reading:
            self.images = images.copy()
            zeros = np.zeros((len(images), 7), np.float32)
            return Reading(zeros, zeros, zeros, zeros, np.zeros(len(images), np.float32))

    looks, plants = Looks(), Plants()
    own = episodes(bursts=(Burst(2, 3, 0.2, 0.0, 5), Burst(6, 6, 0.0, 0.01, 6)), camera=Camera())
    sense = camera_sensor(looks)
    clean = plants.pictures(Camera(), np.array([0, 1]))
    changed = {}
    for step in (1, 2, 3, 4, 6):
        (shown, _), _ = sense(plants, own, step)
        np.testing.assert_array_equal(shown, looks.images[0])  # the guard sees what the network sees
        changed[step] = (looks.images != clean).mean()
    assert changed[1] == changed[4] == 0
    assert 0.1 < changed[2] == changed[3] < 0.3  # of the picture a fifth is covered, softly
    assert changed[6] > 0.8


def test_the_networks_own_numbers_reach_the_controller(episodes):
    estimator, plants = OnnxEstimator.load(DEFAULT_MODEL), Plants()
    measurements = FrameDelivery(episodes(camera=Camera()), camera_sensor(estimator)).measurements(plants, 0)
    expected = estimator.read(plants.pictures(Camera(), np.array([0])))
    for measurement in measurements:
        assert measurement.reading is not None
        np.testing.assert_allclose(measurement.reading.forces, expected.forces, atol=1e-5)  # float32
        np.testing.assert_allclose(measurement.reading.high, expected.high, atol=1e-5)
