"""What is measured on an episode, on traces made by hand."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from toy import controller, straight

from exosight.control import State, Transition
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import draw_episode
from exosight.control.stress.measures import measure_episode, summary
from exosight.control.stress.suite import Traces

SHORT = StressConfig(hold_seconds=2.0, release_seconds=1.5)  # 20 and 15 steps


LIMITS = controller(straight(np.linspace(0.0, 5.0, 11)), straight(np.linspace(5.0, -1.0, 13)), limit=0.5)


def measure(plants, net: np.ndarray, u: np.ndarray | None = None, target: float = 0.2, kind="constant"):
    episode = draw_episode(SHORT, 0, 0, plants)
    goal = np.append(np.full(20, target), np.zeros(15))
    episode = replace(episode, kind=kind, target=goal)
    forces = np.zeros((1, 35, 7))
    forces[0, :, 3] = net
    traces = Traces(
        target=goal[None],
        command=np.zeros((1, 35)) if u is None else u[None],
        outputs=forces,
        true=net[None],
        estimated=net[None],
        converged=np.ones((1, 35), bool),
        logs=((Transition(3, State.NORMAL, State.HOLD, "a stale frame, 0.61 s old"),),),
    )
    return measure_episode(episode, traces, 0, LIMITS), traces


@pytest.fixture
def measured(plants):
    return partial(measure, plants)


def test_a_perfect_episode(measured):
    net = np.append(np.full(20, 0.2), np.zeros(15))
    found, _ = measured(net)
    assert found.settling_steps == found.overshoot_percent == found.steady_state_percent == 0
    assert (
        found.tracking_error == found.release_seconds == found.seconds_outside == found.commands_outside == 0
    )
    assert found.recovered
    assert not found.given_up


def test_overshoot_limits_and_release_are_told_in_their_units(measured):
    net = np.append(np.full(20, 0.2), np.zeros(15))
    net[2:5] = 0.6  # 200 % above; beyond 0.5 N for 0.3 s
    net[20:26] = 0.1  # released after 0.6 s
    found, _ = measured(net)
    assert found.settling_steps == 5
    assert found.overshoot_percent == pytest.approx(200)
    assert found.seconds_outside == pytest.approx(0.3)
    assert found.largest_contact == found.largest_net == 0.6
    assert found.release_seconds == pytest.approx(0.6)


def test_what_still_presses_in_the_end_has_not_recovered_and_was_never_released(measured):
    net = np.append(np.full(20, 0.2), np.full(15, 0.006))
    found, traces = measured(net)
    assert not found.recovered
    assert math.isnan(found.release_seconds)
    told = summary([found], traces)
    assert (told["unrecovered"], told["released_late"], told["release_seconds"]) == (1, 1, None)


def test_late_is_more_than_a_second(measured):
    for steps, late in ((10, 0), (11, 1)):
        net = np.append(np.full(20, 0.2), np.zeros(15))
        net[20 : 20 + steps] = 0.1
        found, traces = measured(net)
        assert summary([found], traces)["released_late"] == late


def test_commands_beyond_amplitude_and_rate_are_counted(measured):
    u = np.zeros(35)
    u[5:] = 1.0  # within the rate of 1 N a step
    u[10] = 2.1  # beyond the rate up, and down again
    u[30:] = -1.0  # as far down as it may; but by 2 N in a step
    found, _ = measured(np.zeros(35), u)
    assert found.commands_outside == 3
    u = np.linspace(0, 6, 35)  # slowly beyond u_max = 5 N
    found, _ = measured(np.zeros(35), u)
    assert found.commands_outside == int((u > 5.0 + 1e-9).sum()) > 0


def test_a_target_that_moves_is_judged_on_its_tracking_alone(measured):
    net = np.append(np.full(20, 0.2), np.zeros(15))
    net[:15] += 0.06  # half of the time from 1 s on
    found, traces = measured(net, kind="sine")
    assert math.isnan(found.settling_steps)
    assert math.isnan(found.overshoot_percent)
    assert found.tracking_error == pytest.approx(0.06 * math.sqrt(0.5))
    assert found.hold_error == pytest.approx(0.03)
    told = summary([found], traces)
    assert told["constant_targets"] == 0
    assert told["tracking_error"]["sine"]["median"] == found.tracking_error
    assert told["hold_error"] == {"user at rest": None, "user moves": found.hold_error}


def test_the_summary_counts_causes_without_their_numbers(measured):
    found, traces = measured(np.append(np.full(20, 0.2), np.zeros(15)))
    assert summary([found], traces)["transitions"] == {"hold: a stale frame, … s old": 1}
