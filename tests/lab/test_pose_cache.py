from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.control.simulated import SimulatedPlant
from exosight.control.trials import CONTROL_SHAPE
from exosight.exosuit.published import published
from exosight.lab.pose_cache import CachedSystem, Move, PoseCache, grid_of, turning_points
from exosight.lab.settings import View
from exosight.lab.system import LabSystem
from exosight.system.schema import Channel

SYSTEM = published(CONTROL_SHAPE)
GRID = grid_of(SYSTEM.schema.channels[0])
TOP = GRID.top

drives = st.lists(st.tuples(st.integers(0, 2), st.integers(-5, 12)), max_size=30)


def walked(drive: tuple[Move, ...] | list[Move]) -> list[tuple[int, ...]]:
    """Every step of every channel on the way from rest."""
    now = [0, 0, 0]
    steps = [(0, 0, 0)]
    for channel, goal in drive:
        while now[channel] != goal:
            now[channel] += 1 if goal > now[channel] else -1
            steps.append((now[0], now[1], now[2]))
    return steps


@given(drives)
def test_turning_points_are_the_same_way_and_turn_every_time(drive: list[Move]) -> None:
    short = turning_points(drive)
    assert walked(short) == walked(drive)
    assert turning_points(short) == short
    way = np.diff(walked(short), axis=0)
    changes = int(np.any(way[1:] != way[:-1], axis=1).sum())
    assert len(short) == (changes + 1 if len(way) else 0)


@pytest.mark.parametrize(
    ("channel", "step", "bottom", "top"),
    [
        (Channel("u", "N", -6, 6, drive=4.0), 0.05, 0, 80),
        (Channel("u", "N", -1, 4), 0.05, -20, 80),
        (Channel("p", "kPa", 0, 80), 1.0, 0, 80),
        (Channel("t", "N m", -0.3, 0.1), 0.005, -60, 20),
        (Channel("p", "bar", 0, 0.33), 0.005, 0, 66),
    ],
    ids=str,
)
def test_a_grid_covers_the_range_of_its_channel(channel: Channel, step: float, bottom: int, top: int) -> None:
    grid = grid_of(channel)
    assert (grid.step, grid.bottom, grid.top) == (pytest.approx(step), bottom, top)
    assert grid.command(grid.peak) == pytest.approx(channel.peak)


@pytest.fixture(scope="module")
def cached() -> CachedSystem:
    return CachedSystem(SYSTEM, [GRID])


def driven(*steps: int) -> list[Move]:
    return [(0, k) for k in steps]


@pytest.mark.parametrize("steps", [(40,), (80, 40), (50, 30, 60)])
def test_poses_are_those_of_the_plant_on_the_same_way(cached: CachedSystem, steps: tuple[int, ...]) -> None:
    plant = SimulatedPlant(SYSTEM)
    plant.reset()
    *before, last = (np.array([GRID.command(k)]) for k in steps)
    for u in before:
        plant.apply(u)
    seen = plant.apply(last)
    rest = cached.at(driven(*steps))
    assert rest.converged
    # The lab's are converged to 1e-7 in the energy norm; the largest difference found was 2e-7.
    np.testing.assert_allclose(rest.q, seen.q, atol=2e-6)


def test_a_pose_does_not_depend_on_what_else_was_asked_for(cached: CachedSystem) -> None:
    fresh = CachedSystem(SYSTEM, [GRID])
    for k in range(33):
        fresh.at(driven(k))
    np.testing.assert_array_equal(fresh.at(driven(33)).q, cached.at(driven(33)).q)


def test_between_two_places_the_pose_lies_between_theirs(cached: CachedSystem) -> None:
    """And the way up to it is not needed for what comes after: poses at places stay as they are."""
    fresh = CachedSystem(SYSTEM, [GRID])
    before, at, after = (fresh.at(driven(k)).q for k in (20, 21, 22))
    assert np.abs(at - (before + after) / 2).max() < 0.1 * np.abs(after - before).max()  # smooth up to here
    np.testing.assert_array_equal(after, cached.at(driven(22)).q)


def test_rising_and_falling_differ_and_meet_again(cached: CachedSystem) -> None:
    up, down = ([cached.at(driven(*way, k)).q for k in range(0, TOP + 1, 4)] for way in ((), (TOP,)))
    apart = [np.abs(a - b).max() for a, b in zip(up, down, strict=True)]
    assert max(apart) > 0.1  # rad or strain: the exosuit snaps on the way
    assert apart[0] < 2e-6


def test_a_way_that_ends_where_a_shorter_one_does_is_told_as_that(cached: CachedSystem) -> None:
    assert cached.at(driven(TOP, 0)).drive == ()
    assert cached.at(driven(10, 5, 12)).drive == ((0, 12),)  # no snap so early: nothing is remembered
    falling = cached.at(driven(TOP, 48))
    assert falling.drive == ((0, TOP), (0, 48))
    np.testing.assert_array_equal(cached.at(driven(TOP, 40, 48, 40)).converged, True)


def test_channels_move_one_after_the_other(assisted: LabSystem) -> None:
    """Where nothing snaps their order does not matter; each moves what it acts on."""
    cached = assisted.cached(View())
    angle = cached.robot.dof_slice("proximal").start
    rest = cached.at([])
    both = cached.at([(0, 10), (1, 40)])
    np.testing.assert_allclose(both.q, cached.at([(1, 40), (0, 10)]).q, atol=2e-6)
    assert both.drive == ((0, 10), (1, 40))
    torque = cached.at([(1, 40)])
    # A hinge with a spring alone: angle = torque / stiffness, with nothing pressing yet.
    turned = torque.q[angle] - rest.q[angle]
    assert turned == pytest.approx(assisted.grids[1].command(40) / 0.05, rel=0.02)


def test_what_is_remembered_is_bounded(cached: CachedSystem) -> None:
    for k in range(1, 80):
        cached.at(driven(k, k - 1))
    assert len(cached._branches) <= 64
    poses, made = PoseCache(), []

    def make() -> CachedSystem:
        made.append(copy(cached))
        return made[-1]

    for i in range(150):
        poses.get(str(i), make)
    assert len(poses._systems) <= 128
    assert poses.get("149", make) is made[-1]
    assert len(made) == 150


def test_a_view_is_light_once_only_its_last_move_remains(lab: LabSystem) -> None:
    lab = replace(lab, poses=PoseCache())
    peak, turned, twice = (View(drive=((4.0,), (0.8,), (2.0,))[:n]) for n in (1, 2, 3))
    assert not lab.is_light(peak)
    cached = lab.cached(peak)
    assert lab.is_light(peak)
    assert not lab.is_light(turned)
    cached.at(lab.moves(peak))
    assert lab.is_light(turned)
    assert not lab.is_light(twice)
    cached.at(lab.moves(turned))
    assert lab.is_light(twice)
