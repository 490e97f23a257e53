"""The bound of all controllers, on the episodes of the other tests."""

import numpy as np
import pytest

from exosight.control import Adaptive
from exosight.control.scheduled import RELEASED
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.frames import last_seen, true_sensor
from exosight.control.stress.measures import attained, measure_episode, summary
from exosight.control.stress.oracle import run_oracle
from exosight.control.stress.suite import Traces, run_episodes

SHORT = StressConfig(hold_seconds=1.5, release_seconds=1.5)
COUNT = 10  # as many plants as in the other tests, so that all share their compiled code


@pytest.fixture(scope="module")
def episodes(plants) -> list[Episode]:
    return [draw_episode(SHORT, 0, number, plants) for number in range(COUNT)]


@pytest.fixture(scope="module")
def best(plants, episodes) -> Traces:
    return run_oracle(episodes, plants.limits)


def test_it_keeps_the_limits_of_all_and_is_on_target_wherever_they_let_it(plants, episodes, best):
    limits = plants.limits
    measured = [measure_episode(e, best, i, limits) for i, e in enumerate(episodes)]
    found = summary(measured, best)
    assert found["commands_outside"] == found["unrecovered"] == found["released_late"] == 0
    assert best.true[:, -1].max() < RELEASED
    change = np.abs(np.diff(best.command, axis=1))
    free = (change < limits.step - 1e-9) & (best.command[:, 1:] < limits.u_max) & (best.target[:, 1:] > 0.01)
    error = np.abs(best.true - best.target)[:, 1:][free] / best.target[:, 1:][free]
    # It stops within half a percent; where the published exosuit snaps, the target may lie in a jump.
    assert np.quantile(error, 0.8) < 0.01


def test_what_it_settles_at_is_what_others_are_measured_by(plants, episodes, best):
    limits = plants.limits
    bound = [measure_episode(e, best, i, limits) for i, e in enumerate(episodes)]
    own = attained(bound, bound)
    assert own["attained"] == own["attainable"] > 0
    assert own["not_attained"] == {}
    traces = run_episodes(episodes, [Adaptive(limits) for _ in episodes], true_sensor, limits)
    measured = [measure_episode(e, traces, i, limits) for i, e in enumerate(episodes)]
    found = attained(measured, bound)
    assert found["attainable"] == own["attainable"]
    assert sum(found["not_attained"].values()) == found["attainable"] - found["attained"]
    told = summary(measured, traces)
    assert told["commands_outside"] == told["unrecovered"] == told["released_late"] == 0


def test_delayed_by_nothing_it_is_the_same_and_by_frames_it_knows_less(plants, episodes, best):
    limits = plants.limits
    now = np.tile(np.arange(len(episodes[0].target)), (len(episodes), 1))
    at_once = run_oracle(episodes, limits, seen=now)
    np.testing.assert_allclose(at_once.command, best.command, atol=1e-6)  # solved once more in each step
    delayed = run_oracle(episodes, limits, seen=last_seen(episodes))
    rests = [i for i, episode in enumerate(episodes) if not episode.moves]
    assert rests
    np.testing.assert_allclose(delayed.command[rests], best.command[rests], atol=1e-6)
    late, exact = (np.abs(traces.true - traces.target)[:, :15].mean() for traces in (delayed, best))
    assert late > exact


def test_the_newest_usable_frame_is_neither_lost_nor_repeated_nor_of_the_future(episodes):
    seen = last_seen(episodes)
    for episode, own in zip(episodes, seen, strict=True):
        assert own[0] == 0
        for step in range(1, len(own)):
            assert own[step] <= max(step - 1 - episode.latency, 0)
            assert own[step] >= own[step - 1]
            if episode.lost[step - 1] or episode.again[step - 1]:
                assert own[step] == own[step - 1]
    assert (seen[:, -1] > len(seen[0]) // 2).any()
