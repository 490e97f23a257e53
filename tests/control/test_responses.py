"""Measures of a response, on responses with closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from toy import CHANNEL

from exosight.control import hold, hold_and_release, measure_response
from exosight.errors import InputError

STEPS = np.arange(80)
unhurried = settings(deadline=None)  # a busy machine is no failure


def judge(force, target, u=None, channel=CHANNEL, **options):
    time = np.arange(len(target)) / 10
    return measure_response(
        time, target, force, np.zeros(len(target)) if u is None else u, channel, **options
    )


@unhurried
@given(ratio=st.floats(0.05, 0.95), target=st.floats(0.01, 1.0), tolerance=st.floats(0.02, 0.1))
def test_first_order_response(ratio, target, tolerance):
    """F_k = F_t (1 − r^k) settles at the first k with r^k ≤ tolerance, and never overshoots."""
    exact = math.log(tolerance) / math.log(ratio)
    assume(abs(exact - round(exact)) > 1e-6)  # where round-off decides
    found = judge(target * (1 - ratio**STEPS), hold(target, 80), tolerance=tolerance)
    if math.ceil(exact) <= 60:  # the last quarter of 80 steps must be in the band
        assert found.settling_steps == math.ceil(exact)
    else:
        assert math.isnan(found.settling_steps)
    assert found.overshoot == found.overshoot_percent == 0
    assert found.steady_state_error == pytest.approx(target * np.mean(ratio ** STEPS[60:]), abs=1e-12)
    assert found.ripple == pytest.approx(target * (ratio**60 - ratio**79), abs=1e-12)
    assert math.isnan(found.release_time)


@unhurried
@given(ratio=st.floats(0.05, 0.8), target=st.floats(0.01, 1.0))
def test_alternating_response(ratio, target):
    """F_k = F_t (1 − (−r)^k) overshoots by r F_t, at its first step."""
    found = judge(target * (1 - (-ratio) ** STEPS), hold(target, 80))
    assert found.overshoot == pytest.approx(target * ratio)
    assert found.overshoot_percent == pytest.approx(100 * ratio)
    exact = math.log(0.05) / math.log(ratio)
    assume(abs(exact - round(exact)) > 1e-6)
    assert found.settling_steps == math.ceil(exact)


@unhurried
@given(ratio=st.floats(0.05, 0.9))
def test_release(ratio):
    """F = F_t r^k after the switch is within 5 % of F_t from k = log 0.05 / log r on; steps of 0.1 s."""
    exact = math.log(0.05) / math.log(ratio)
    assume(abs(exact - round(exact)) > 1e-6)
    force = np.concatenate([np.full(80, 0.2), 0.2 * ratio**STEPS])
    found = judge(force, hold_and_release(0.2, 80))
    assert found.settling_steps == 0
    assert found.steady_state_error == pytest.approx(0)  # of the held part alone
    assert found.release_time == pytest.approx(math.ceil(exact) / 10)


def test_a_force_that_leaves_the_band_settles_only_when_it_is_back_for_good():
    force = np.full(40, 0.2)
    force[[0, 17]] = 0.0, 0.25
    assert judge(force, hold(0.2, 40)).settling_steps == 18
    force[-1] = 0.25
    assert math.isnan(judge(force, hold(0.2, 40)).settling_steps)


def test_a_force_that_stays_after_the_release_has_no_release_time():
    force = np.full(40, 0.2)
    found = judge(force, hold_and_release(0.2, 20))
    assert math.isnan(found.release_time)
    assert found.settling_steps == 0


def test_a_loop_that_swings_for_ever_never_settles_and_shows_its_ripple():
    force = np.where(STEPS % 2, 1.1, 0.0)
    found = judge(force, hold(0.2, 80), u=np.where(STEPS % 2, 6.0, -6.0))
    assert math.isnan(found.settling_steps)
    assert found.ripple == pytest.approx(1.1)
    assert (found.largest_u, found.smallest_u) == (6.0, -6.0)
    assert not found.locked_up  # its mean error is large, but the pose does answer


def test_locked_up_means_at_the_limit_and_off_target_to_the_end():
    target, stuck = hold_and_release(0.2, 20), np.full(40, 0.23)
    u = np.r_[np.zeros(25), np.full(15, -6.0)]
    assert judge(stuck, target, u=u).locked_up
    assert not judge(stuck, target, u=0.9 * u).locked_up  # the law has something left
    assert not judge(np.where(target > 0, 0.23, 0.0), target, u=u).locked_up  # on target
    assert judge(stuck, target, u=0.9 * u, channel=replace(CHANNEL, low=-5.4)).locked_up


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_the_shortest_runs_have_a_late_part_too(steps):
    found = judge(np.full(steps, 0.15), hold(0.2, steps))
    assert found.steady_state_error == pytest.approx(0.05)


@pytest.mark.parametrize(
    "target",
    [np.zeros(4), np.array([0.2, 0.3, 0.3, 0.3]), np.array([0.2, 0.0, 0.2, 0.2]), np.full(4, -0.2)],
)
def test_a_target_that_is_not_held_and_released_is_refused(target):
    with pytest.raises(InputError, match="target"):
        judge(np.zeros(4), target)


def test_a_lost_frame_and_bounds_out_of_range_are_refused():
    target = hold(0.2, 4)
    with pytest.raises(InputError, match="not; a lost frame"):
        judge(np.array([0.0, np.nan, 0.2, 0.2]), target)
    for tolerance in (0.0, math.nan):
        with pytest.raises(InputError, match="tolerance"):
            judge(target, target, tolerance=tolerance)
    with pytest.raises(InputError, match="one length above 0"):
        judge(np.zeros(0), np.zeros(0))


def test_a_swing_that_ends_in_the_band_has_not_settled():
    force = np.where(np.arange(80) % 2 == 0, 0.2, 0.4)
    force[-1] = 0.3
    assert math.isnan(judge(force, hold(0.3, 80)).settling_steps)
