"""The loop on a plant with a closed form: what is recorded when, and how it converges."""

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from toy import CHANNEL, SCHEMA

from exosight.control import Proportional, from_image, hold, hold_and_release, run, true_reading
from exosight.errors import InputError

with_toy = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@with_toy
@given(loop_gain=st.floats(0.05, 1.95), target=st.floats(0.05, 0.4))
def test_error_falls_as_a_geometric_series(toy, loop_gain, target):
    """F = c u and u += K e give e_k = (1 − K c)^k e_0, which falls for 0 < K c < 2."""
    stiffness = 0.2
    record = run(
        toy(stiffness), Proportional(loop_gain / stiffness, CHANNEL), true_reading(), hold(target, 40)
    )
    # Round-off of 40 sums of numbers below 0.8 N.
    np.testing.assert_allclose(record.error, target * (1 - loop_gain) ** np.arange(40), atol=1e-14)


def test_before_contact_u_rises_by_the_gain_times_the_target_each_step(toy):
    record = run(toy(0.2, contact_at=1.0), Proportional(2.0, CHANNEL), true_reading(), hold(0.25, 60))
    np.testing.assert_allclose(record.command[:3], [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(record.true[:3], 0.0)
    # In contact from u = 1 N on, with e = 0.25 N and 1 − K c = 0.6.
    np.testing.assert_allclose(record.error[2:], 0.25 * 0.6 ** np.arange(58), atol=1e-14)


def test_a_row_holds_u_and_what_the_plant_shows_under_it(toy):
    plant = toy(0.1, contact_at=0.5)
    record = run(plant, Proportional(5.0, CHANNEL), true_reading(), hold_and_release(0.2, 10))
    assert record.command[0] == 0
    assert plant.applied == record.command[1:].tolist()
    np.testing.assert_allclose(record.true, 0.1 * np.maximum(record.command - 0.5, 0))
    np.testing.assert_array_equal(record.q[:, 0], record.command)
    np.testing.assert_array_equal(record.images[:, 0, 0], np.floor(100 * record.true + 1e-9))
    # Each u comes from the target of its own row and the measurement of the row before.
    np.testing.assert_allclose(np.diff(record.command), 5 * (record.target[1:] - record.estimated[:-1]))
    assert record.converged.all()


@pytest.mark.parametrize("rate", [10.0, 4.0])
def test_time_counts_steps_at_the_rate(toy, rate):
    record = run(toy(), Proportional(1.0, CHANNEL), true_reading(), hold(0.2, 21), rate=rate)
    np.testing.assert_allclose(record.time, np.linspace(0, 20 / rate, 21))


def test_targets_are_held_and_released():
    np.testing.assert_array_equal(hold(0.25, 3), [0.25, 0.25, 0.25])
    np.testing.assert_array_equal(hold_and_release(0.2, 2), [0.2, 0.2, 0.0, 0.0])


class Reader:
    """Answers C1…C7 = 0.01, 0.02 … 0.07 N times the gray of the upper left pixel."""

    def __init__(self):
        self.shapes = []

    def estimate(self, images):
        self.shapes.append(images.shape)
        return (images[:, :1, 0] * np.linspace(0.01, 0.07, 7)).astype(np.float32)


def test_from_image_sums_the_estimated_contacts_of_the_one_image(toy):
    reader = Reader()
    seen = toy().look(0.5)
    # 5 gray · 0.28 N a gray; single precision of the estimates.
    assert from_image(reader, SCHEMA)(seen) == pytest.approx(5 * 0.28, rel=1e-6)
    assert reader.shapes == [(1, 4, 6)]


def test_the_law_sees_the_estimate_alone_and_both_forces_are_on_record(toy):
    record = run(
        toy(0.1), Proportional(4.0, CHANNEL), lambda seen: 1.25 * seen.reading("F_net"), hold(0.2, 80)
    )
    np.testing.assert_allclose(record.estimated, 1.25 * record.true)
    assert record.estimated[-1] == pytest.approx(0.2)  # 0.5^79 of the error is left
    assert record.true[-1] == pytest.approx(0.16)  # and with it the sensor's own error


def test_a_lost_frame_shows_in_the_record_and_holds_u(toy):
    answers = iter([0.0, 0.1, math.nan, 0.1, 0.1])
    record = run(toy(), Proportional(1.0, CHANNEL), lambda seen: next(answers), hold(0.2, 5))
    np.testing.assert_array_equal(np.isnan(record.estimated), [0, 0, 1, 0, 0])
    np.testing.assert_allclose(record.command, [0.0, 0.2, 0.3, 0.3, 0.4])


def test_a_second_run_starts_afresh(toy):
    plant, law = toy(), Proportional(3.0, CHANNEL)
    first, second = (run(plant, law, true_reading(), hold(0.2, 10)) for _ in range(2))
    np.testing.assert_array_equal(first.command, second.command)


def test_a_law_that_asks_for_more_than_the_plant_takes_is_stopped(toy):
    with pytest.raises(InputError, match="expected -6 to 6 N"):
        run(toy(), Proportional(100.0, replace(CHANNEL, high=9.0)), true_reading(), hold(0.2, 5))


@pytest.mark.parametrize("target", [np.array([]), np.array([0.2, np.nan]), np.array([np.inf])])
def test_a_target_that_is_empty_or_not_finite_is_refused(toy, target):
    with pytest.raises(InputError, match="target"):
        run(toy(), Proportional(1.0, CHANNEL), true_reading(), target)


@pytest.mark.parametrize("rate", [0.0, -10.0, math.nan, math.inf])
def test_a_rate_that_is_no_number_above_zero_is_refused(toy, rate):
    with pytest.raises(InputError, match="rate"):
        run(toy(), Proportional(1.0, CHANNEL), true_reading(), hold(0.2, 5), rate=rate)


@pytest.mark.parametrize(("force", "steps"), [(-0.1, 5), (math.nan, 5), (math.inf, 5), (0.2, 0)])
def test_a_target_force_or_length_out_of_range_is_refused(force, steps):
    with pytest.raises(InputError, match="target"):
        hold(force, steps)


def test_control_of_another_plant_needs_neither_jax_nor_pytorch():
    code = "import sys, exosight.control; print([m for m in ('jax', 'torch') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
