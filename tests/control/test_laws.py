"""The paper's law: a clipped sum of errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy import CHANNEL, controller, force_path

from exosight.control import OpenLoop, Proportional
from exosight.errors import InputError

unhurried = settings(deadline=None)  # a busy machine is no failure
anything = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(allow_nan=False, allow_infinity=False)
gains = st.floats(1e-3, 1e3)


@unhurried
@given(gains, st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), max_size=30))
def test_u_is_the_sum_of_the_errors_times_the_gain(gain, steps):
    law = Proportional(gain, replace(CHANNEL, low=-1e9, high=1e9))  # out of reach
    u = [law.next(target, measured) for target, measured in steps]
    errors = np.array([target - measured for target, measured in steps])
    # Round-off of a sum of 30 terms, each up to gain in size.
    np.testing.assert_allclose(u, gain * np.cumsum(errors), atol=1e-13 * gain)


@unhurried
@given(st.floats(1e-6, 1e308), st.floats(1e-6, 1e6), st.lists(st.tuples(finite, anything), max_size=30))
def test_no_measurement_whatsoever_takes_u_beyond_the_limit(gain, limit, steps):
    law = Proportional(gain, replace(CHANNEL, low=-limit, high=limit, drive=None))
    for target, measured in steps:
        assert abs(law.next(target, measured)) <= limit  # false for NaN too


@pytest.mark.parametrize("lost", [math.nan, math.inf, -math.inf])
def test_a_lost_frame_leaves_u_as_it_is(lost):
    law = Proportional(2.0, CHANNEL)
    before = law.next(0.3, 0.1)
    assert before == pytest.approx(0.4)
    assert law.next(0.3, lost) == before
    assert law.next(0.3, 0.2) == pytest.approx(0.6)  # and then it goes on


def test_u_leaves_the_limit_at_the_first_error_of_the_other_sign():
    law = Proportional(5.0, CHANNEL)
    for _ in range(100):
        law.next(1.0, 0.0)
    assert law.next(0.0, 0.2) == pytest.approx(6.0 - 5.0 * 0.2)


def test_reset_returns_to_no_actuation():
    law = Proportional(5.0, CHANNEL)
    first = law.next(0.2, 0.0)
    law.next(0.2, 0.1)
    law.reset()
    assert law.next(0.2, 0.0) == first == pytest.approx(1.0)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_gain_that_is_no_number_above_zero_is_refused(value):
    with pytest.raises(InputError, match="gain K_P: expected a finite number above 0"):
        Proportional(value, CHANNEL)


@pytest.mark.parametrize("target", [math.nan, math.inf])
def test_a_target_that_is_no_number_is_refused(target):
    law = Proportional(1.0, CHANNEL)
    with pytest.raises(InputError, match="target: expected a finite"):
        law.next(target, 0.1)


def test_the_open_loop_answers_with_the_load_of_the_path_whatever_is_measured():
    """F = 0.1 (u − 0.5 N) from 0.5 N on, so U(F) = 0.5 N + 10 F."""

    def path(u):
        forces = np.zeros((len(u), 7))
        forces[:, 3] = 0.1 * np.maximum(u - 0.5, 0.0)
        return force_path(u, forces)

    up, down = path(np.linspace(0, 4, 41)), path(np.linspace(4, -1, 51))
    law = OpenLoop(controller(up, down))
    for target, u in ((0.2, 2.5), (0.35, 4.0), (9.0, 4.0), (0.0, 0.0), (-1.0, 0.0)):
        for measured in (0.0, 7.0, math.nan):
            assert law.next(target, measured) == pytest.approx(u)
    with pytest.raises(InputError, match="target: expected a finite"):
        law.next(math.nan, 0.0)
