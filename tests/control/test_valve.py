"""Dead time and lag of actuators, against the solution of their equation."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from exosight.control import (
    CONTROL_SHAPE,
    GuardConfig,
    Measurement,
    Observation,
    guarded_of,
    hold,
    run_guarded,
    true_measurement,
)
from exosight.control.estimator import Reading
from exosight.control.guarded import GuardedName, Sense
from exosight.control.loop import RATE
from exosight.control.simulated import SimulatedPlant
from exosight.control.valve import AT_ONCE, Valve, ValvePlant, Valves
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published

times = st.floats(0, 2)
commands = st.lists(st.floats(-1, 4), min_size=1, max_size=30)


def arriving(valve: Valve, asked: list[float]) -> np.ndarray:
    valves = Valves([valve], 1)
    return np.array([valves.step(np.array([[u]]))[0, 0] for u in asked])


@given(commands)
def test_at_once_by_default(asked: list[float]) -> None:
    np.testing.assert_array_equal(arriving(AT_ONCE, asked), asked)


@given(commands, st.integers(0, 20))
def test_a_dead_time_of_whole_steps_shifts(asked: list[float], steps: int) -> None:
    late = arriving(Valve(dead_time=steps / RATE), asked)
    np.testing.assert_array_equal(late, [*[0.0] * steps, *asked][: len(asked)])


@given(st.floats(0.01, 2))
def test_a_step_is_reached_exponentially(lag: float) -> None:
    time = np.arange(1, 31) / RATE
    np.testing.assert_allclose(arriving(Valve(lag), [1.0] * 30), 1 - np.exp(-time / lag), rtol=1e-12)


@pytest.mark.parametrize(("lag", "dead_time"), [(0.15, 0.0), (0.15, 0.07), (0.4, 0.23), (0.05, 0.3)])
def test_any_commands_arrive_as_the_equation_has_it(lag: float, dead_time: float) -> None:
    """By SciPy's integrator, restarted wherever what arrives jumps."""
    asked = np.random.default_rng(0).uniform(-1, 4, 20)
    y, expected = 0.0, []
    for step in range(len(asked)):
        breaks = sorted({step / RATE, (step + 1) / RATE, step / RATE + dead_time % (1 / RATE)})
        for start, end in itertools.pairwise(breaks):
            number = int(np.floor((0.5 * (start + end) - dead_time) * RATE))
            goal = asked[number] if number >= 0 else 0.0
            y = solve_ivp(
                lambda _, y, goal=goal: (goal - y) / lag, (start, end), [y], rtol=1e-11, atol=1e-13
            ).y[0, -1]
        expected.append(y)
    np.testing.assert_allclose(arriving(Valve(lag, dead_time), asked.tolist()), expected, atol=1e-9)


@given(times, times, commands)
def test_nothing_arrives_that_was_not_asked_for(lag: float, dead_time: float, asked: list[float]) -> None:
    """Within the range of the commands and of 0, where the valve began; to round-off."""
    found = arriving(Valve(lag, dead_time), asked)
    assert found.min() >= min(0.0, *asked) - 1e-12
    assert found.max() <= max(0.0, *asked) + 1e-12


def test_each_plant_has_its_own_valve() -> None:
    several = [AT_ONCE, Valve(0.2), Valve(0.1, 0.25)]
    asked = np.random.default_rng(1).uniform(0, 3, (12, 3, 2))
    valves = Valves(several, 2)
    found = np.array([valves.step(now) for now in asked])
    for i, valve in enumerate(several):
        alone = Valves([valve], 2)
        np.testing.assert_array_equal(found[:, i], [alone.step(now[i : i + 1])[0] for now in asked])


@pytest.mark.parametrize("times", [(-0.1, 0.0), (0.0, 2.5), (np.nan, 0.0), (0.0, np.inf)])
def test_times_that_are_none(times: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="expected 0 to 2 s"):
        Valve(*times)


def test_a_plant_behind_a_valve_rests_where_it_does_without() -> None:
    """And shows on the way what the plant shows at what has arrived, and says so."""
    system = published(Exosuit(CONTROL_SHAPE))
    plain, late = SimulatedPlant(system), ValvePlant(SimulatedPlant(system), Valve(0.1, 0.1))
    plain.reset()
    late.reset()
    asked, seen = np.array([1.5]), []
    for step in range(40):
        observation = late.apply(asked)
        np.testing.assert_allclose(observation.commands, asked * (1 - np.exp(-step)), rtol=1e-12)
        seen.append(observation.reading("F_net"))
    assert seen[0] == 0.0
    first = SimulatedPlant(system)
    first.reset()
    first.apply(np.zeros(1))
    assert seen[1] == pytest.approx(first.apply(asked * (1 - np.exp(-1))).reading("F_net"), rel=1e-9)
    assert seen[-1] == pytest.approx(plain.apply(asked).reading("F_net"), rel=1e-9)


def measured(rng: np.random.Generator) -> Sense:
    """True readings with pictures that always differ."""

    def sense(observation: Observation) -> Measurement:
        image = rng.integers(0, 255, observation.image.shape, np.uint8)
        return true_measurement(replace(observation, image=image))

    return sense


@pytest.mark.parametrize("valve", [Valve(0.1, 0.1), Valve(0.3, 0.1), Valve(0.3, 0.3)])
@pytest.mark.parametrize("name", ["guarded", "adaptive"])
def test_behind_a_valve_that_they_are_told_of_controllers_settle_without_a_fault(
    toy, straight_config, name: GuardedName, valve: Valve
) -> None:
    controller = guarded_of(name, straight_config, GuardConfig(response_time=valve.response_time))
    sense = measured(np.random.default_rng(0))
    record = run_guarded(ValvePlant(toy(), valve), controller, sense, hold(0.25, 40))
    assert controller.log == []
    # The command of the target after three steps, and 5 % of it left: 3 steps, T and three times τ.
    late = 4 + round(RATE * (valve.dead_time + 3 * valve.lag))
    assert np.all(np.abs(record.true[late:] - 0.25) < 0.05 * 0.25)
    assert record.true.max() < 1.01 * 0.25


def test_an_actuator_that_is_stuck_is_a_fault_after_the_response_time(straight_config) -> None:
    valve = Valve(0.1, 0.2)
    guarded = guarded_of("guarded", straight_config, GuardConfig(response_time=valve.response_time))
    none = np.zeros((1, 7), np.float32)
    reading = Reading(none, none, none, none, np.zeros(1, np.float32))
    rng = np.random.default_rng(0)
    for step in range(12):
        image = rng.integers(0, 255, (4, 6), np.uint8)
        guarded.step(0.25, Measurement(image, reading, 0.0, np.zeros(1)))
        # 0.6 s: the commands of six steps before the last; u is above 0 from the first step on.
        assert (guarded.problem is not None and "not the command" in guarded.problem.cause) == (step > 6)
