"""The observer on plants in closed form: F = s F₀((u − d)/s) with F₀ bent, and a user who moves."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy import controller, force_path

from exosight.control.observer import Observer, ObserverConfig

GRID = np.linspace(0.0, 5.0, 201)


def nominal(w: np.ndarray | float) -> np.ndarray:
    """F₀ [N]: no contact below 0.3 N, then steeper and steeper."""
    pressed = np.maximum(np.asarray(w, float) - 0.3, 0.0)
    return 0.06 * pressed + 0.01 * pressed**2


def zones(force: float) -> np.ndarray:
    found = np.zeros(7)
    found[2] = force
    return found


def bent() -> Observer:
    outputs = np.stack([zones(force) for force in nominal(GRID)])
    falling = np.linspace(5.0, -1.0, 241)
    back = np.stack([zones(force) for force in nominal(falling)])
    return Observer(controller(force_path(GRID, outputs), force_path(falling, back)))


def plant(u: float, s: float, d: float) -> float:
    return s * float(nominal((u - d) / s))


def test_the_nominal_plant_is_the_path_itself():
    observer = bent()
    for u in (0.1, 1.3, 4.2):
        seen = observer.predict(u)
        # Linear between points 0.025 N apart: 0.01/8 · 0.025² of a square, and its corner at 0.3 N.
        assert seen.controlled == pytest.approx(float(nominal(u)), abs=1e-3)
        assert seen.outputs.sum() == pytest.approx(seen.controlled, abs=1e-12)
    assert observer.command(float(nominal(2.2))) == pytest.approx(2.2, abs=0.01)


@pytest.mark.parametrize(("s", "d"), [(1.2, 0.1), (0.85, -0.15), (1.0, 0.3), (1.15, -0.2)])
def test_another_plant_is_found_from_its_forces(s: float, d: float):
    observer = bent()
    for k in range(40):
        u = 2.5 + 1.2 * math.sin(0.5 * k)
        observer.advance(1)
        assert observer.update(u, zones(plant(u, s, d)), 0.0)
    for target in (0.1, 0.2, 0.3):
        # Each measurement is believed to half a percent of the largest force, the path's slope is
        # 0.06 to 0.15.
        assert plant(observer.command(target), s, d) == pytest.approx(target, rel=0.02)
    assert observer.state[0] == pytest.approx(s, rel=0.05)


def test_late_frames_of_a_user_who_moves_evenly_are_extrapolated():
    late, speed = 3, 0.2  # steps, N/s
    observer, errors = bent(), []
    for k in range(40):
        u = 2.5
        observer.advance(1)
        observer.update(u, zones(plant(u, 1.0, 0.1 * speed * k)), 0.0)
        true = plant(u, 1.0, 0.1 * speed * (k + late))
        errors.append([abs(observer.predict(u, ahead).controlled - true) for ahead in (0, late)])
    still, ahead = np.mean(errors[20:], axis=0)
    # It takes any speed to decay within 0.7 s, both in what it learns and in what it predicts.
    assert ahead < 0.5 * still
    assert 0.5 * speed < observer.state[2] < 1.2 * speed


def test_the_spread_of_errors_is_the_one_that_it_states():
    """Normalised by the stated deviation, errors of plants drawn as it expects them have variance 1."""
    rng, given_ = np.random.default_rng(0), ObserverConfig()
    normalised = []
    for _ in range(200):
        s, d = math.exp(rng.normal(0, given_.stiffness)), rng.normal(0, given_.shift * 4)
        observer = bent()
        for u in (2.0, 3.0):
            observer.advance(1)
            noise = rng.normal(0, 0.01)
            observer.update(u, zones(plant(u, s, d) + noise), 0.01)
        seen = observer.predict(2.5)
        normalised.append((seen.controlled - plant(2.5, s, d)) / seen.deviation)
    # It allows for a user who moves, and these do not: it may state too much, not too little.
    assert 0.3 < np.std(normalised) < 1.2


def test_an_outlier_changes_nothing_and_three_that_agree_are_believed():
    observer = bent()
    for _ in range(20):
        observer.advance(1)
        observer.update(2.5, zones(plant(2.5, 1.0, 0.0)), 0.0)
    before, known = observer.state, observer.covariance
    assert not observer.update(2.5, zones(0.5), 0.0)
    np.testing.assert_array_equal(observer.state, before)
    np.testing.assert_array_equal(observer.covariance, known)
    there = plant(2.5, 1.0, -0.8)  # the user has moved at once
    taken = [observer.update(2.5, zones(there), 0.0) for _ in range(3)]
    assert taken == [False, False, True]
    assert observer.predict(2.5).controlled == pytest.approx(there, rel=0.1)


def test_what_presses_where_nothing_can_is_noise():
    """The same force, once with scatter on zones that are free: it is believed less."""
    shares = []
    for scatter in (0.0, 0.03):
        observer = bent()
        measured = zones(plant(2.5, 1.0, -0.1))
        measured[5], measured[6] = scatter, -scatter
        observer.update(2.5, measured, 0.0)
        shares.append(observer.state[1])
    assert shares[0] < 0.8 * shares[1] < 0


def test_without_frames_less_and_less_is_known():
    observer = bent()
    observer.update(2.5, zones(plant(2.5, 1.0, 0.0)), 0.0)
    deviations = [observer.predict(2.5, ahead).deviation for ahead in range(20)]
    assert np.all(np.diff(deviations) > 0)


def test_the_largest_command_keeps_every_output_within_its_limit():
    observer = bent()  # limits of 0.4 N, the path ends at 0.5 N
    for _ in range(10):
        observer.advance(1)
        observer.update(3.0, zones(plant(3.0, 0.9, -0.1)), 0.0)
    largest = observer.largest()
    assert 0.38 < observer.predict(largest).outputs.max() <= 0.4


@given(
    st.lists(
        st.tuples(
            st.floats(-1, 5),
            st.lists(st.floats(-50, 50), min_size=7, max_size=7),
            st.floats(0, 50),
            st.integers(0, 9),
        ),
        max_size=30,
    )
)
def test_whatever_is_measured_state_and_covariance_stay_finite(seen):
    observer = bent()
    for u, outputs, deviation, steps in seen:
        observer.advance(steps)
        observer.update(u, np.array(outputs), deviation)
        assert np.isfinite(observer.state).all()
        eigenvalues = np.linalg.eigvalsh(observer.covariance)
        assert eigenvalues.min() > -1e-9 * eigenvalues.max()
        assert math.isfinite(observer.command(0.3))
        assert observer.predict(u).deviation >= 0


def test_noise_is_what_all_zones_show_and_a_contact_elsewhere_is_none():
    u, force = 3.0, plant(3.0, 1.0, 0.0)
    elsewhere, noisy = zones(force / 2), zones(force)
    elsewhere[1] = force / 2  # where the model has none
    noisy += force / 2 * np.array([1, -1, 0, 1, -1, 1, -1]) / np.sqrt(6)  # as much in all
    found = []
    for outputs in (zones(force), elsewhere, noisy):
        observer = bent()
        assert observer.update(u, outputs, 0.0)
        found.append(observer.covariance[1, 1])
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[2] > 1.5 * found[0]
