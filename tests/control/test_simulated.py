"""The simulated plant on the exosuit of the paper's controller study."""

import math

import numpy as np
import pytest

import exosight.control.simulated as simulated
from exosight.control import CONTROL_SHAPE, Proportional, hold, judge_response, run, true_force
from exosight.control.simulated import SimulatedPlant
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.vision import BACKGROUND, Camera, resized

CAMERA = resized(Camera(), 48, 32)


@pytest.fixture(scope="module")
def plant() -> SimulatedPlant:
    return SimulatedPlant(Exosuit(CONTROL_SHAPE), CAMERA)


def test_at_rest_nothing_presses(plant):
    seen = plant.reset()
    assert (seen.u, seen.converged, seen.net_force) == (0.0, True, 0.0)
    np.testing.assert_array_equal(seen.forces, 0.0)
    np.testing.assert_allclose(seen.q, 0.0, atol=1e-9)  # the solver's tolerance, 1e-10 of a strain of 0.01
    assert seen.image.shape == (32, 48)
    assert 0 < (seen.image != BACKGROUND).mean() < 0.5


def test_forces_are_those_of_the_reference_program(plant):
    plant.reset()
    for u, force in ((1.0, 0.058), (2.4, 0.22), (4.0, 0.49)):
        seen = plant.apply(u)
        assert seen.converged
        assert seen.min_eigenvalue > 0
        assert seen.net_force == pytest.approx(force, rel=0.02)  # the reference is printed to two digits
        assert seen.u == u


def test_the_same_u_shows_another_force_on_the_way_down_and_the_same_path_the_same(plant):
    def visit(plant):
        plant.reset()
        return [plant.apply(u) for u in (2.6, 3.2, 2.6)]

    up, _, down = visit(plant)
    assert down.net_force - up.net_force > 0.05  # published hysteresis: up to 0.1 N
    assert (up.image != down.image).any()
    again = visit(SimulatedPlant(Exosuit(CONTROL_SHAPE), CAMERA))  # which remembers nothing
    np.testing.assert_array_equal([up.q, down.q], [again[0].q, again[2].q])
    np.testing.assert_array_equal([up.image, down.image], [again[0].image, again[2].image])


def test_the_pose_does_not_depend_on_how_many_calls_led_to_it(plant):
    plant.reset()
    far = plant.apply(1.6)
    plant.reset()
    for u in (0.013, 0.5, 0.5, 1.27):
        plant.apply(u)
    near = plant.apply(1.6)
    # Strains up to 1; the solver stops at 1e-10 relative, divided by the smallest eigenvalue, above 0.5.
    np.testing.assert_allclose(near.q, far.q, atol=1e-8)
    np.testing.assert_allclose(near.forces, far.forces, atol=1e-7)
    np.testing.assert_array_equal(near.image, far.image)


@pytest.mark.parametrize("u", [math.nan, math.inf, -math.inf, 6.001, -6.001])
def test_u_beyond_the_limits_is_refused_and_changes_nothing(plant, u):
    plant.reset()
    before = plant.apply(0.4)
    with pytest.raises(InputError, match="within ±6 N"):
        plant.apply(u)
    np.testing.assert_allclose(plant.apply(0.4).q, before.q, atol=1e-9)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_that_is_no_number_above_zero_is_refused(limit):
    with pytest.raises(InputError, match="plant limit"):
        SimulatedPlant(Exosuit(CONTROL_SHAPE), CAMERA, limit)


def test_a_way_that_was_just_walked_is_remembered_not_solved_again(plant, monkeypatch):
    plant.reset()
    first = plant.apply(1.1)
    monkeypatch.setattr(simulated, "advance", None)
    plant.reset()
    again = plant.apply(1.1)
    np.testing.assert_array_equal(again.q, first.q)
    np.testing.assert_array_equal(again.image, first.image)


def test_where_no_stable_pose_is_found_the_last_one_stays(monkeypatch):
    plant = SimulatedPlant(Exosuit(CONTROL_SHAPE), CAMERA)  # the ways of which are not yet remembered
    plant.reset()
    expected = plant.apply(0.7)
    solve = simulated.advance

    def fails_beyond(robots, state, loads):
        if loads[0, 0] < 0.71:
            return solve(robots, state, loads)
        reached, found = solve(robots, state, np.minimum(loads, 0.7))
        return reached, type(found)(**{**vars(found), "converged": np.array([False])})

    plant.reset()
    monkeypatch.setattr(simulated, "advance", fails_beyond)
    stopped = plant.apply(1.0)
    assert not stopped.converged
    assert stopped.u == pytest.approx(0.7)
    np.testing.assert_allclose(stopped.q, expected.q, atol=1e-8)
    assert plant.apply(0.9).u == stopped.u  # nowhere to go yet
    monkeypatch.undo()
    assert plant.apply(0.95).converged


def test_the_first_apply_starts_from_rest(plant):
    plant.reset()
    expected = plant.apply(0.3)
    fresh = SimulatedPlant(Exosuit(CONTROL_SHAPE), CAMERA)
    np.testing.assert_array_equal(fresh.apply(0.3).q, expected.q)


def test_loads_are_even_and_at_most_a_step_apart():
    for start, end, count in (
        (0.0, 1.0, 20),
        (1.0, 0.98, 1),
        (0.3, 0.3, 1),
        (-6.0, 6.0, 240),
        (0.0, 0.12, 3),
    ):
        loads = simulated._steps(start, end)
        assert len(loads) == count
        assert loads[-1] == end
        np.testing.assert_allclose(np.diff(loads, prepend=start), (end - start) / count, atol=1e-12)


def test_the_papers_law_brings_it_to_the_target(plant):
    record = run(plant, Proportional(5.0), true_force, hold(0.25, 24))
    response = judge_response(record.time, record.target, record.F_net_true, record.u)
    assert record.converged.all()
    assert response.settling_steps <= 7  # the paper's own count
    assert response.steady_state_error == pytest.approx(0, abs=1e-3)
    assert len(np.unique(record.images, axis=0)) > 4  # the pictures move
