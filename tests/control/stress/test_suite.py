"""Episodes in closed loop on the simulated plant, ten at a time."""

from dataclasses import replace

import numpy as np
import pytest

from exosight.control import CONTROL_SHAPE, ControllerConfig, Guarded, Proportional, Scheduled
from exosight.control.scheduled import RELEASED
from exosight.control.simulated import SimulatedPlant
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.frames import true_sensor
from exosight.control.stress.measures import measure_episode, summary
from exosight.control.stress.plants import StressPlants, stress_plants
from exosight.control.stress.suite import Traces, Unguarded, run_episodes
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.catalogue import find_system
from exosight.exosuit.published import published
from exosight.vision import Camera, resized

SHORT = StressConfig(hold_seconds=1.5, release_seconds=1.5)
COUNT = 10  # as many plants as in the other tests, so that all share their compiled code


@pytest.fixture(scope="module")
def config(plants) -> ControllerConfig:
    return plants.limits


@pytest.fixture(scope="module")
def episodes(plants) -> list[Episode]:
    return [draw_episode(SHORT, 0, number, plants) for number in range(COUNT)]


@pytest.fixture(scope="module")
def guarded(config, episodes) -> Traces:
    return run_episodes(episodes, [Guarded(Scheduled(config)) for _ in episodes], true_sensor, config)


def test_whatever_goes_wrong_commands_stay_within_limits_and_the_finger_is_let_go(config, episodes, guarded):
    measured = [measure_episode(e, guarded, i, config) for i, e in enumerate(episodes)]
    found = summary(measured, guarded)
    assert found["commands_outside"] == found["unrecovered"] == found["released_late"] == 0
    assert found["without_a_pose"] == 0
    assert guarded.true[:, -1].max() < RELEASED
    assert guarded.true.max() > 0.1  # it did press


def test_without_trouble_it_does_what_one_plant_alone_does(config, plants):
    calm = StressConfig(
        hold_seconds=1.5,
        release_seconds=1.5,
        latency=(0.0, 0.0),
        dropped=(0.0, 0.0),
        repeated=(0.0, 0.0),
        bursts=0,
        wrong_plant=False,
        wrong_camera=False,
        moving_user=False,
    )
    own = [draw_episode(calm, 0, number, plants) for number in range(COUNT)]
    traces = run_episodes(
        own, [Unguarded(Proportional(5.0, config.driven), config.weights) for _ in own], true_sensor, config
    )
    small = published(Exosuit(CONTROL_SHAPE), resized(Camera(), 48, 32))
    law, plant = Proportional(5.0, config.driven), SimulatedPlant(small)
    seen = plant.reset()
    for step in range(1, len(own[1].target)):
        seen = plant.apply(np.array([law.next(float(own[1].target[step]), seen.reading("F_net"))]))
        # Forces are told in single precision, and a gain of 5 feeds their round-off back.
        assert traces.true[1, step] == pytest.approx(seen.reading("F_net"), abs=1e-5)
        assert traces.command[1, step] == pytest.approx(seen.commands[0], abs=1e-4)


def test_every_step_is_told_as_it_passes_and_the_logs_are_kept(config, plants):
    steps = []
    short = [draw_episode(SHORT, 5, number, plants) for number in range(COUNT)]
    controllers = [Guarded(Scheduled(config)) for _ in short]
    traces = run_episodes(short, controllers, true_sensor, config, lambda step, of: steps.append((step, of)))
    assert steps == [(step, 29) for step in range(1, 30)]
    assert [list(log) for log in traces.logs] == [controller.log for controller in controllers]
    assert np.isnan(traces.estimated[:, 1:]).sum() == sum(int(e.lost[:-1].sum()) for e in short)


def test_bad_batches_are_refused(config, episodes):
    with pytest.raises(InputError, match="episodes: expected one or more"):
        run_episodes([], [], true_sensor, config)
    with pytest.raises(InputError, match="each with a controller"):
        run_episodes(episodes, [Guarded(Scheduled(config))], true_sensor, config)


def test_the_law_has_the_papers_gain_on_every_preset_and_another_for_another_sensor(
    plants: StressPlants, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = plants.limits
    of_index = replace(limits, schema=replace(limits.schema, system="index"))
    monkeypatch.setattr("exosight.control.stress.plants.tune", lambda *_: of_index)
    assert stress_plants(find_system("index")).gain == 5.0
    monkeypatch.setattr("exosight.control.stress.plants.tune", lambda *_: replace(of_index, sensor="C6"))
    assert stress_plants(find_system("index")).gain == limits.default_gain != 5.0


def test_valves_that_answer_late_slow_the_loop_and_change_nothing_else_of_the_episodes(config, plants):
    """Controllers ask as before, and each plant is under what has arrived."""
    late = replace(SHORT, lag=(0.2, 0.2), dead_time=(0.1, 0.1))
    episodes, slow = ([draw_episode(c, 0, i, plants) for i in range(COUNT)] for c in (SHORT, late))
    for one, other in zip(episodes, slow, strict=True):
        np.testing.assert_array_equal(one.target, other.target)
        np.testing.assert_array_equal(one.rest, other.rest)
        assert (one.latency, one.bursts) == (other.latency, other.bursts)
    u = 1.5
    traces = [
        run_episodes(each, [Unguarded(_Constant(u), config.weights) for _ in each], true_sensor, config)
        for each in (episodes, slow)
    ]
    np.testing.assert_array_equal(traces[0].command, traces[1].command)
    at_once, later = (trace.true for trace in traces)
    assert np.all(later[:, 1] == later[:, 0])
    still = [i for i, episode in enumerate(episodes) if not episode.moves]
    assert np.all(later[still, 2] < at_once[still, 2])
    np.testing.assert_allclose(later[still, -1], at_once[still, -1], atol=1e-4)  # 27 steps: e^-13 of it


class _Constant:
    """A law that asks for one command."""

    def __init__(self, u: float) -> None:
        self._u = u

    def reset(self) -> None:
        """Nothing to forget."""

    def next(self, target: float, measured: float) -> float:
        return self._u
