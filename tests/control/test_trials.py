"""The six runs of the paper's study, on a plant with a closed form."""

import math

import numpy as np
import pytest

from exosight.control import published_trials, run_trials, true_reading


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
