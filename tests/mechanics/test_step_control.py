"""Sizes of steps: the error stays at the tolerance, and reported times are met."""

import jax.numpy as jnp
import numpy as np
import pytest

from exosight.mechanics.step_control import StepLimits, after_divergence, after_step, first_step, fitted_step

ORDER = 4


def limits(tolerance: float = 1e-7, largest: float = np.inf, adaptive: bool = True) -> StepLimits:
    return StepLimits(np.array(tolerance), np.array(largest), np.array(adaptive), np.array(100))


@pytest.mark.parametrize("start", [1e-6, 1.0])
@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_accepted_steps_keep_the_error_just_below_the_tolerance(start: float, tolerance: float) -> None:
    """An error that is 2 h⁴ at first and 300 h⁴ later, from a step far too short and one far too long."""
    step, errors = start, []
    for k in range(60):
        error = (2.0 if k < 30 else 300.0) * step**ORDER
        accepted, proposed = after_step(limits(tolerance), np.array(step), jnp.array(error), ORDER)
        assert bool(accepted) == (error <= tolerance)
        assert 0.2 * step <= proposed * (1 + 1e-12) <= 5.0 * step * (1 + 2e-12)
        errors.append(error)
        step = float(proposed)
    # In the steady state, the step is 0.9 of the one whose error is the tolerance.
    for k in (29, 59):
        assert errors[k] == pytest.approx(0.9**ORDER * tolerance, rel=1e-6)


def test_a_fixed_step_is_kept_whatever_the_error_and_shortened_where_stages_have_no_solution() -> None:
    fixed = limits(largest=0.01, adaptive=False)
    accepted, proposed = after_step(fixed, np.array(0.01), jnp.array(1.0), ORDER)
    assert accepted
    assert proposed == 0.01
    shorter = after_divergence(fixed, np.array(0.01))
    assert shorter < 0.01
    assert after_step(fixed, shorter, jnp.array(0.0), ORDER)[1] == 0.01  # and comes back


def test_the_first_step_moves_by_less_than_the_tolerance() -> None:
    step = float(first_step(limits(1e-8), jnp.array(9.81)))
    assert 0 < 0.5 * 9.81 * step**2 <= 1e-8
    assert float(first_step(limits(1e-8, largest=1e-3), jnp.array(0.0))) == 1e-3


def test_steps_meet_every_reported_time_and_every_closing_contact() -> None:
    draw = np.random.default_rng(0)
    for _ in range(20):
        left, longest, count = draw.uniform(0.1, 1.0), draw.uniform(0.01, 2.0), 0
        contact = draw.uniform(0.1, 2.0)
        least = np.ceil(left / longest)
        time, taken = 0.0, []
        while left - time > 1e-12:
            ahead = contact - time if time < contact else np.inf
            taken.append(float(fitted_step(np.array(left - time), np.array(longest), np.array(ahead))))
            time += taken[-1]
            count += 1
        assert time == pytest.approx(left, abs=1e-12)
        assert max(taken) <= longest * (1 + 1e-8)
        if contact < left:
            assert np.min(np.abs(np.cumsum(taken) - contact)) < 1e-12
            assert count <= least + 1
        else:
            assert count == least
            np.testing.assert_allclose(taken, left / least)
