"""The six runs of the paper's study, on a plant with a closed form."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from any_frames import picture
from toy import controller

from exosight.control import (
    Measurement,
    Observation,
    guarded_of,
    hold,
    hold_and_release,
    published_trials,
    run_guarded_trials,
    run_trials,
    true_measurement,
    true_reading,
)


def test_the_six_runs_of_the_paper(toy):
    found = list(run_trials(toy(0.1), true_reading(), published_trials()))
    constant, steps = found[:3], found[3:]
    assert [trial.released for trial in found] == [False] * 3 + [True] * 3
    assert [trial.gain for trial in constant] == [5, 5, 5]
    assert [trial.record.target.tolist() for trial in constant] == [
        [force] * 50 for force in (0.25, 0.30, 0.35)
    ]
    assert [trial.gain for trial in steps] == [0.1, 1, 100]
    for trial in steps:
        np.testing.assert_array_equal(trial.record.target, np.repeat([0.2, 0.0], 100))
        assert trial.record.time[100] == 10.0  # [s], where the target is switched off

    # K c = 0.5: the error is below 5 % after 5 steps (0.5⁵ = 3 %), whatever the target.
    assert [trial.settling_steps for trial in constant] == [5, 5, 5]
    slow, good, violent = (trial.response for trial in steps)
    # K c = 0.01: the error is still 0.99⁹⁹ of the target when it is released.
    assert math.isnan(slow.settling_steps)
    assert steps[0].settling_steps is None
    assert slow.largest_u == pytest.approx(2 * (1 - 0.99**99))
    # K c = 0.1: below 5 % after 29 steps (0.9²⁹ = 4.7 %); on release, one step earlier is on record.
    assert good.settling_steps == 29
    assert good.release_time == pytest.approx(2.8)
    # K c = 10: between both limits for ever; F swings from 0 to c · 6 N.
    assert math.isnan(violent.settling_steps)
    assert (violent.largest_u, violent.smallest_u, violent.ripple) == (6.0, -6.0, pytest.approx(0.6))


def test_what_is_judged_is_the_true_force(toy):
    biased = run_trials(toy(0.1), lambda seen: 0.8 * seen.reading("F_net"), published_trials()[:3])
    # The estimate settles on the target, so the truth a quarter above it: never in the band.
    for trial in biased:
        # 1 − 0.8 K c = 0.6: of the error, 0.6⁴⁹ is left.
        assert trial.record.estimated[-1] == pytest.approx(trial.record.target[-1], rel=1e-3)
        assert trial.settling_steps is None
        assert trial.response.overshoot_percent == pytest.approx(25, rel=1e-3)


@pytest.mark.parametrize("name", ["guarded", "adaptive"])
def test_a_controller_with_the_path_of_the_plant_needs_the_steps_that_its_rate_allows(toy, name):
    number = itertools.count()

    def sense(seen: Observation) -> Measurement:
        return replace(true_measurement(seen), image=picture(next(number)))

    targets = [hold(0.25, 20), hold_and_release(0.35, 20)]
    found = list(run_guarded_trials(toy(0.1), guarded_of(name, controller()), sense, targets))
    assert [trial.released for trial in found] == [False, True]
    # 2.5 and 3.5 N at 1 N a step.
    assert [trial.settling_steps for trial in found] == [3, 4]
    # At the row of the release u has already gone by 1 N; 0.0175 N are left at 0.175 N.
    assert found[1].response.release_time == pytest.approx(0.3)
    assert [trial.law for trial in found] == ["", ""]
