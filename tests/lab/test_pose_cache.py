import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.control import CONTROL_SHAPE
from exosight.control.simulated import SimulatedPlant
from exosight.exosuit.assembly import Exosuit
from exosight.lab.pose_cache import TOP, CachedExosuit, PoseCache, turning_points
from exosight.lab.settings import STEP

drives = st.lists(st.integers(0, TOP), min_size=1, max_size=30)


def walked(drive: tuple[int, ...] | list[int]) -> list[int]:
    """Every step of a way from rest."""
    at, steps = 0, [0]
    for goal in drive:
        while at != goal:
            at += 1 if goal > at else -1
            steps.append(at)
    return steps


@given(drives)
def test_turning_points_are_the_same_way_and_turn_every_time(drive: list[int]) -> None:
    short = turning_points(drive)
    assert walked(short) == walked(drive)
    assert turning_points(short) == short
    signs = np.sign(np.diff([0, *short]))
    assert len(short) == 1 or np.all(signs[1:] == -signs[:-1])


@pytest.fixture(scope="module")
def cached() -> CachedExosuit:
    return CachedExosuit(Exosuit(CONTROL_SHAPE))


@pytest.mark.parametrize("drive", [(40,), (80, 40), (50, 30, 60)])
def test_poses_are_those_of_the_plant_on_the_same_way(cached: CachedExosuit, drive: tuple[int, ...]) -> None:
    plant = SimulatedPlant(Exosuit(CONTROL_SHAPE))
    plant.reset()
    *before, last = (STEP * k for k in drive)
    for u in before:
        plant.apply(u)
    seen = plant.apply(last)
    rest = cached.at(drive)
    assert rest.converged
    # The lab's are converged to 1e-7 in the energy norm; the largest difference found was 2e-7.
    np.testing.assert_allclose(rest.q, seen.q, atol=2e-6)


def test_a_pose_does_not_depend_on_what_else_was_asked_for(cached: CachedExosuit) -> None:
    fresh = CachedExosuit(Exosuit(CONTROL_SHAPE))
    for k in range(33):
        fresh.at((k,))
    np.testing.assert_array_equal(fresh.at((33,)).q, cached.at((33,)).q)


def test_between_two_loads_the_pose_lies_between_theirs(cached: CachedExosuit) -> None:
    """And the way up to it is not needed for what comes after: poses at loads stay as they are."""
    fresh = CachedExosuit(Exosuit(CONTROL_SHAPE))
    before, at, after = (fresh.at((k,)).q for k in (20, 21, 22))
    assert np.abs(at - (before + after) / 2).max() < 0.1 * np.abs(after - before).max()  # smooth up to here
    np.testing.assert_array_equal(after, cached.at((22,)).q)


def test_rising_and_falling_differ_and_meet_again(cached: CachedExosuit) -> None:
    up, down = ([cached.at((*way, k)).q for k in range(0, TOP + 1, 4)] for way in ((), (TOP,)))
    apart = [np.abs(a - b).max() for a, b in zip(up, down, strict=True)]
    assert max(apart) > 0.1  # rad or strain: the exosuit snaps on the way
    assert apart[0] < 2e-6


def test_a_way_that_ends_where_a_shorter_one_does_is_told_as_that(cached: CachedExosuit) -> None:
    assert cached.at((TOP, 0)).drive == (0,)
    assert cached.at((10, 5, 12)).drive == (12,)  # no snap so early: nothing is remembered
    falling = cached.at((TOP, 48))
    assert falling.drive == (TOP, 48)
    np.testing.assert_array_equal(cached.at((TOP, 40, 48, 40)).converged, True)


def test_what_is_remembered_is_bounded(cached: CachedExosuit) -> None:
    for k in range(1, 80):
        cached.at((k, k - 1))
    assert len(cached._branches) <= 64
    poses = PoseCache()
    for i in range(40):
        poses.get(Exosuit(CONTROL_SHAPE, young=3e5 + i))
    assert len(poses._exosuits) <= 32
    assert poses.get(Exosuit(CONTROL_SHAPE)) is poses.get(Exosuit(CONTROL_SHAPE))
