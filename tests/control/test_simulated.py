"""The simulated plant on the exosuit of the paper's controller study."""

import math
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

from exosight.control import CONTROL_SHAPE, Proportional, hold, measure_response, run, true_reading
from exosight.control.simulated import SimulatedPlant
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index_friction
from exosight.exosuit.published import published
from exosight.vision import BACKGROUND, Camera, resized

SYSTEM = published(Exosuit(CONTROL_SHAPE), resized(Camera(), 48, 32))


@pytest.fixture(scope="module")
def plant() -> SimulatedPlant:
    return SimulatedPlant(SYSTEM)


def test_at_rest_nothing_presses(plant):
    seen = plant.reset()
    assert seen.converged
    assert (seen.commands[0], seen.reading("F_net")) == (0.0, 0.0)
    np.testing.assert_array_equal(seen.outputs, 0.0)
    np.testing.assert_allclose(seen.q, 0.0, atol=1e-9)  # the solver's tolerance, 1e-10 of a strain of 0.01
    assert seen.image.shape == (32, 48)
    assert 0 < (seen.image != BACKGROUND).mean() < 0.5


def test_forces_are_those_of_the_reference_program(plant):
    plant.reset()
    for u, force in ((1.0, 0.058), (2.4, 0.22), (4.0, 0.49)):
        seen = plant.apply(np.array([u]))
        assert seen.converged
        assert seen.min_eigenvalue > 0
        assert seen.reading("F_net") == pytest.approx(
            force, rel=0.02
        )  # the reference is printed to two digits
        assert seen.commands == [u]


def test_the_same_u_shows_another_force_on_the_way_down_and_the_same_path_the_same(plant):
    def visit(plant):
        plant.reset()
        return [plant.apply(np.array([u])) for u in (2.6, 3.2, 2.6)]

    up, _, down = visit(plant)
    assert down.reading("F_net") - up.reading("F_net") > 0.05  # published hysteresis: up to 0.1 N
    assert (up.image != down.image).any()
    again = visit(SimulatedPlant(SYSTEM))  # which remembers nothing
    np.testing.assert_array_equal([up.q, down.q], [again[0].q, again[2].q])
    np.testing.assert_array_equal([up.image, down.image], [again[0].image, again[2].image])


def test_the_pose_does_not_depend_on_how_many_calls_led_to_it(plant):
    plant.reset()
    far = plant.apply(np.array([1.6]))
    plant.reset()
    for u in (0.013, 0.5, 0.5, 1.27):
        plant.apply(np.array([u]))
    near = plant.apply(np.array([1.6]))
    # Strains up to 1; the solver stops at 1e-10 relative, divided by the smallest eigenvalue, above 0.5.
    np.testing.assert_allclose(near.q, far.q, atol=1e-8)
    np.testing.assert_allclose(near.readings, far.readings, atol=1e-7)
    np.testing.assert_array_equal(near.image, far.image)


@pytest.mark.parametrize("u", [math.nan, math.inf, -math.inf, 6.001, -6.001])
def test_u_beyond_the_limits_is_refused_and_changes_nothing(plant, u):
    plant.reset()
    before = plant.apply(np.array([0.4]))
    with pytest.raises(InputError, match="expected -6 to 6 N"):
        plant.apply(np.array([u]))
    np.testing.assert_allclose(plant.apply(np.array([0.4])).q, before.q, atol=1e-9)


def test_where_no_stable_pose_is_found_the_last_one_stays():
    """Far beyond what silicone bears, at 125 N, the way ends; from there the plant still goes back."""
    strong = eqx.tree_at(lambda actuator: actuator.gain, SYSTEM.actuators[0], np.array(1e4))
    plant = SimulatedPlant(replace(SYSTEM, actuators=(strong,)))
    stopped = plant.apply(np.array([6.0]))
    assert not stopped.converged
    assert 0 < stopped.commands[0] < 6.0
    # In steps, as a limited rate has it: at once, the way back may take more evaluations than one load has.
    back = [plant.apply(share * stopped.commands) for share in np.linspace(0.95, 0.5, 10)][-1]
    assert back.converged
    assert back.commands == 0.5 * stopped.commands


def test_the_first_apply_starts_from_rest(plant):
    plant.reset()
    expected = plant.apply(np.array([0.3]))
    fresh = SimulatedPlant(SYSTEM)
    np.testing.assert_array_equal(fresh.apply(np.array([0.3])).q, expected.q)


def test_commands_of_another_number_are_refused(plant):
    with pytest.raises(InputError, match="one for each channel"):
        plant.apply(np.zeros(2))


def test_the_papers_law_brings_it_to_the_target(plant):
    record = run(plant, Proportional(5.0, SYSTEM.schema.channels[0]), true_reading(), hold(0.25, 24))
    response = measure_response(record.time, record.target, record.true, record.command, record.driven)
    assert record.converged.all()
    assert response.settling_steps <= 7  # the paper's own count
    assert response.steady_state_error == pytest.approx(0, abs=1e-3)
    assert len(np.unique(record.images, axis=0)) > 4  # the pictures move


def test_with_friction_it_remembers_what_stuck_and_forgets_it_on_reset():
    plant = SimulatedPlant(index_friction(Exosuit(CONTROL_SHAPE), resized(Camera(), 48, 32)))
    up = plant.apply(np.array([2.0]))
    plant.apply(np.array([3.0]))
    down = plant.apply(np.array([2.0]))
    # Held by friction, the exosuit presses on: 0.142 N on the way up, 0.154 N on the way down.
    assert down.reading("F_net") - up.reading("F_net") > 0.005
    plant.reset()
    np.testing.assert_array_equal(plant.apply(np.array([2.0])).q, up.q)
