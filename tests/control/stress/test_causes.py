"""Which disturbance an episode fails without: on measurements that are given."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from exosight.control.stress import StressConfig
from exosight.control.stress.causes import REMOVALS, find_causes, worst
from exosight.control.stress.episodes import Episode, draw_episode
from exosight.control.stress.measures import Measured
from exosight.control.stress.plants import StressPlants
from exosight.control.valve import AT_ONCE

GOOD = Measured(
    kind="constant",
    settling_steps=4.0,
    overshoot_percent=0.0,
    steady_state_percent=1.0,
    tracking_error=0.01,
    hold_error=0.01,
    largest_contact=0.2,
    largest_net=0.3,
    seconds_outside=0.0,
    commands_outside=0,
    release_seconds=0.2,
    recovered=True,
    given_up=False,
    latency=0.1,
    user_moves=False,
    camera_displaced=False,
    lag=0.0,
    dead_time=0.0,
    friction=0.0,
    creep=0.0,
)
MISSED = replace(GOOD, settling_steps=math.nan, tracking_error=0.1)


@pytest.fixture(scope="module")
def episodes(plants: StressPlants) -> list[Episode]:
    return [draw_episode(StressConfig(suite=2), 0, number, plants) for number in range(6)]


def test_each_removal_leaves_an_episode_without_it_and_with_all_others(plants, episodes):
    for name, (has, without) in REMOVALS.items():
        for episode in episodes:
            left = without(episode, plants.nominal)
            if name not in ("plant differs", "creep"):  # a share of 1e-9 is left of creep
                assert not has(left)
            others = [n for n, (other, _) in REMOVALS.items() if n != name and other(episode) != other(left)]
            assert others == []


def test_the_nominal_plant_keeps_what_its_user_does(plants, episodes):
    left = REMOVALS["plant differs"][1](episodes[0], plants.nominal)
    assert left.system is plants.nominal
    own = episodes[0].stiffness / episodes[0].stiffness[0]
    np.testing.assert_allclose(left.stiffness / left.stiffness[0], own, rtol=1e-12)
    np.testing.assert_array_equal(left.rest, episodes[0].rest)


def test_only_failures_are_run_again_and_only_those_with_the_disturbance_count(plants, episodes):
    """Episodes 0 and 2 fail; a run without lag and dead time settles, all others do not."""
    measured = [MISSED, GOOD, replace(GOOD, given_up=True), GOOD, MISSED, GOOD]
    bound = [GOOD] * 4 + [MISSED, GOOD]  # 4 is out of reach for anyone

    def run(others: Sequence[Episode]) -> list[Measured]:
        assert len(others) == 2
        return [GOOD if other.valve == AT_ONCE else MISSED for other in others]

    found = find_causes(episodes, measured, bound, run, plants.nominal, most=10)
    assert found.episodes == (0, 2)
    assert found.counts["lag and dead time"] == (2, 2)
    assert found.counts["friction"] == (2, 0)
    assert found.counts["camera displaced"] == (1, 0)  # every third one, episode 0
    assert find_causes(episodes, measured, bound, lambda o: [MISSED], plants.nominal, 1).episodes == (0,)


def test_the_worst_come_first():
    late = replace(GOOD, release_seconds=1.2)
    beyond = replace(GOOD, seconds_outside=0.1)
    assert worst([GOOD, MISSED, late, beyond], 3) == [3, 2, 1]
