"""The controller tuned for the exosuit of the paper's study, in closed loop with it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.control import (
    CONTROL_SHAPE,
    ControllerConfig,
    Guarded,
    Scheduled,
    hold,
    hold_and_release,
    measure_response,
    run_guarded,
    true_measurement,
)
from exosight.control.scheduled import RELEASED
from exosight.control.simulated import SimulatedPlant
from exosight.control.tuning import CONTACT_LIMIT, tune
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published
from exosight.mechanics.sensitivity import differentiable
from exosight.system.observation import observe_state
from exosight.vision import Camera, resized

CAMERA = resized(Camera(), 48, 32)


@pytest.fixture(scope="module")
def config() -> ControllerConfig:
    return tune(published(Exosuit(CONTROL_SHAPE), CAMERA))


@pytest.fixture(scope="module")
def plant() -> SimulatedPlant:
    return SimulatedPlant(published(Exosuit(CONTROL_SHAPE), CAMERA))


def test_the_path_ends_before_a_contact_passes_its_limit_and_knows_the_jumps(config):
    assert config.loading.outputs.max() <= CONTACT_LIMIT
    assert 4.0 < config.u_max < 4.3  # the reference path passes 0.5 N on C4 between 4.1 and 4.2 N
    assert config.u_min == -1.0
    assert config.unloading.controlled[-1] < RELEASED
    # The published jump at 2.86 N, much larger than any before it, and the way back, 0.5 N lower.
    *smaller, published = config.loading.jumps
    assert float(config.loading.u[config.loading.snapped][-1]) == pytest.approx(2.86, abs=0.03)
    assert all(after - before < 0.25 * (published[1] - published[0]) for before, after in smaller)
    assert config.unloading.u[config.unloading.snapped].max() == pytest.approx(2.34, abs=0.03)


def test_the_slopes_of_the_path_are_the_sensitivities_of_the_equilibria(config, plant):
    system = published(Exosuit(CONTROL_SHAPE), CAMERA)
    zones = np.array(system.schema.output_indices())
    plant.reset()
    q = plant.apply(np.array([2.5])).q

    def forces(load):
        return observe_state(system, differentiable(system.robot, load, q)).readings[zones]

    _, exact = jax.jit(lambda load: jax.jvp(forces, (load,), (jnp.ones(1),)))(jnp.array([2.5]))
    place = int(np.abs(config.loading.u - 2.5).argmin())
    middle = 0.5 * (config.loading.slopes[place - 1] + config.loading.slopes[place])
    # Central difference over 0.05 N: the forces bend by less than 1 % of their slope on the way.
    np.testing.assert_allclose(middle, exact, atol=0.01 * float(np.abs(exact).max()))


@pytest.mark.parametrize("target", [0.25, 0.30, 0.35])
def test_constant_targets_settle_in_six_steps_with_the_least_overshoot_there_can_be(config, plant, target):
    guarded = Guarded(Scheduled(config))
    record = run_guarded(plant, guarded, true_measurement, hold(target, 16))
    response = measure_response(record.time, record.target, record.true, record.command, record.driven)
    assert response.settling_steps <= 6
    assert abs(response.steady_state_error) < 0.02 * target
    assert guarded.log == []
    # 0.30 N lies in the jump on the way up, so every way there shows what is just beyond it first.
    beyond = max(
        (after + 1e-3 for before, after in config.loading.jumps if before < target < after), default=0.0
    )
    assert record.true.max() <= max(1.05 * target, beyond)


def test_a_dropped_target_is_released_within_a_second(config, plant):
    guarded = Guarded(Scheduled(config))
    record = run_guarded(plant, guarded, true_measurement, hold_and_release(0.2, 12))
    assert record.true[8:12] == pytest.approx(0.2, rel=0.02)
    assert (record.true[12 + 10 :] < RELEASED).all()
    assert record.command[-1] == 0.0


def test_an_exosuit_softer_than_tuned_for_is_served_as_well(config):
    softer = SimulatedPlant(published(Exosuit(CONTROL_SHAPE, young=0.9 * 300e3), CAMERA))
    record = run_guarded(softer, Guarded(Scheduled(config)), true_measurement, hold(0.35, 16))
    response = measure_response(record.time, record.target, record.true, record.command, record.driven)
    assert response.settling_steps <= 6
    assert abs(response.steady_state_error) < 0.02 * 0.35


@pytest.mark.parametrize(
    "wrong", [{"rate": 0.0}, {"contact_limit": float("nan")}, {"pull": -1.0}, {"pull": 7.0}]
)
def test_bad_arguments_are_refused(wrong):
    with pytest.raises(InputError, match=r"expected a finite number above 0|pull: expected 0…6"):
        tune(published(Exosuit(CONTROL_SHAPE)), **wrong)


def test_an_exosuit_that_may_hardly_press_is_refused():
    with pytest.raises(
        InputError, match=r"F_net stays below 0.005 N while u rises to .* where a sensor passes"
    ):
        tune(published(Exosuit(CONTROL_SHAPE)), contact_limit=1e-4)
