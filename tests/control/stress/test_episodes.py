"""What is drawn for an episode: within its limits, and by its number alone."""

import jax
import numpy as np
import pytest

from exosight.control import CONTROL_SHAPE
from exosight.control.stress import KINDS, StressConfig
from exosight.control.stress.episodes import draw_episode
from exosight.control.stress.plants import PUBLISHED_TARGETS, Creep, StressPlants, with_friction_and_creep
from exosight.control.valve import AT_ONCE
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index
from exosight.vision import Camera

CALM = StressConfig(
    latency=(0.0, 0.0),
    dropped=(0.0, 0.0),
    repeated=(0.0, 0.0),
    bursts=0,
    wrong_plant=False,
    wrong_camera=False,
    moving_user=False,
)


def same(one, other) -> bool:
    return (
        all(map(np.array_equal, jax.tree.leaves(one.system), jax.tree.leaves(other.system)))
        and one.camera == other.camera
        and one.bursts == other.bursts
        and all(
            np.array_equal(getattr(one, name), getattr(other, name))
            for name in ("target", "lost", "again", "stiffness", "rest", "latency")
        )
    )


def test_an_episode_is_the_same_each_time_and_another_for_another_number_or_seed(plants: StressPlants):
    config = StressConfig()
    once = draw_episode(config, 3, 7, plants)
    assert same(once, draw_episode(config, 3, 7, plants))
    assert not same(once, draw_episode(config, 3, 8, plants))
    assert not same(once, draw_episode(config, 4, 7, plants))


def test_every_kind_of_target_stays_within_the_limits_and_drops_when_it_is_said_to(plants: StressPlants):
    config = StressConfig(hold_seconds=3.0, release_seconds=2.0)
    low, high = PUBLISHED_TARGETS
    for number in range(40):
        episode = draw_episode(config, 0, number, plants)
        assert episode.kind == KINDS[number % 5]
        assert len(episode.target) == 50
        assert episode.drop == 30
        held = episode.target[:30]
        assert low - 1e-12 <= held.min() <= held.max() <= high + 1e-12
        assert not episode.target[30:].any()
        assert (np.ptp(held) == 0) == (episode.kind in ("constant", "snap"))


def test_frames_are_lost_and_repeated_as_often_as_was_asked_for(plants: StressPlants):
    config = StressConfig(dropped=(0.1, 0.1), repeated=(0.2, 0.2), latency=(0.1, 0.3))
    episodes = [draw_episode(config, 1, number, plants) for number in range(200)]
    # 13,000 draws: the standard error of a share is below 0.004. Of what is lost nothing can come again.
    assert np.mean([e.lost.mean() for e in episodes]) == pytest.approx(0.1, abs=0.015)
    assert np.mean([e.again.mean() for e in episodes]) == pytest.approx(0.2 * 0.9, abs=0.015)
    assert not any((e.lost & e.again).any() for e in episodes)
    assert {e.latency for e in episodes} == {1, 2, 3}


def test_what_is_switched_off_does_not_happen(plants: StressPlants):
    for number in range(10):
        episode = draw_episode(CALM, 0, number, plants)
        assert episode.system is plants.nominal
        assert episode.camera == Camera()
        assert (episode.latency, episode.bursts) == (0, ())
        assert not episode.lost.any()
        assert not episode.again.any()
        assert not episode.rest.any()
        assert (episode.stiffness == episode.stiffness[0]).all()


def test_every_other_user_moves_from_rest_and_slowly(plants: StressPlants):
    moving = [draw_episode(StressConfig(), 0, number, plants).rest for number in range(20)]
    assert [bool(rest.any()) for rest in moving] == [True, False] * 10
    for rest in moving:
        assert not rest[0].any()
        assert np.abs(np.diff(rest, axis=0)).max() <= np.deg2rad(1.0) + 1e-12  # 10° in a second
        assert rest.min() >= 0


def test_bad_settings_are_refused(plants: StressPlants):
    with pytest.raises(ValueError, match="lower limit first"):
        StressConfig(latency=(0.3, 0.1))
    with pytest.raises(ValueError, match="less than or equal to 1"):
        StressConfig(dropped=(0.0, 1.5))
    with pytest.raises(InputError, match="whole numbers"):
        draw_episode(StressConfig(), -1, 0, plants)


def test_the_second_suite_is_the_first_with_friction_creep_and_valves(plants: StressPlants):
    first, second = StressConfig(), StressConfig(suite=2)
    given = second.complete()
    for number in range(20):
        one, other = (draw_episode(config, 0, number, plants) for config in (first, second))
        assert same(one, other)
        assert (one.friction, one.creep, one.valve) == (None, None, AT_ONCE)
        assert other.friction is not None
        assert other.creep is not None
        for value, limits in (
            (other.friction, (0.0, 0.6)),
            (other.creep.share, (0.05, 0.2)),
            (other.creep.time, given.creep_time),
            (other.valve.lag, (0.0, 0.3)),
            (other.valve.dead_time, (0.0, 0.2)),
        ):
            assert limits[0] <= value <= limits[1]


def test_what_is_given_takes_the_place_of_a_suites_range():
    found = StressConfig(suite=2, friction=(0.1, 0.2)).complete()
    assert (found.friction, found.lag) == ((0.1, 0.2), (0.0, 0.3))
    assert found.complete() == found
    assert StressConfig().complete().creep == (0.0, 0.0)


def test_friction_and_creep_are_put_into_contacts_of_two_bodies_and_all_rods(plants: StressPlants):
    system = index(Exosuit(CONTROL_SHAPE))
    worn = with_friction_and_creep(system, 0.4, Creep(0.1, 2.0))
    press, fold = worn.contacts
    assert (float(press.friction), fold.friction) == (0.4, None)
    (mode,) = worn.relaxations
    assert (mode.rod, float(mode.share[0]), float(mode.time[0])) == ("exosuit", 0.1, 2.0)
    assert worn.schema == system.schema
    assert with_friction_and_creep(system, None, None) is system
