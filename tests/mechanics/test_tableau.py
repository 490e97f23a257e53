"""The implicit Runge–Kutta method by its order conditions and its stability function."""

import numpy as np
import pytest

from exosight.mechanics.tableau import ARK4_IMPLICIT as METHOD

A = METHOD.lower + np.diag([0.0, *[METHOD.diagonal] * (METHOD.stages - 1)])
C = METHOD.nodes


def order_residuals(b: np.ndarray) -> dict[int, list[float]]:
    """What the weights leave of Butcher's conditions, by the order they belong to."""
    return {
        1: [b.sum() - 1],
        2: [b @ C - 1 / 2],
        3: [b @ C**2 - 1 / 3, b @ A @ C - 1 / 6],
        4: [b @ C**3 - 1 / 4, b @ (C * (A @ C)) - 1 / 8, b @ A @ C**2 - 1 / 12, b @ A @ A @ C - 1 / 24],
    }


def test_the_solution_is_of_order_four_and_the_embedded_one_of_order_three() -> None:
    # Round-off: the coefficients are fractions of numbers of up to 12 digits.
    np.testing.assert_allclose(np.concatenate(list(order_residuals(METHOD.weights).values())), 0, atol=1e-14)
    embedded = order_residuals(METHOD.embedded)
    np.testing.assert_allclose(np.concatenate([embedded[k] for k in (1, 2, 3)]), 0, atol=1e-14)
    assert np.abs(embedded[4]).max() > 1e-4  # of order four, it would estimate no error


def test_stages_are_of_order_two_and_the_last_is_the_solution() -> None:
    np.testing.assert_allclose(A.sum(axis=1), C, atol=1e-14)
    np.testing.assert_allclose((A @ C)[1:], C[1:] ** 2 / 2, atol=1e-14)
    np.testing.assert_allclose(A[-1], METHOD.weights, atol=0)
    assert C[-1] == 1


def stability(z: complex) -> complex:
    """R(z) = 1 + z bᵀ (1 − z A)⁻¹ 1: what a step of y' = z y makes of 1."""
    return 1 + z * METHOD.weights @ np.linalg.solve(np.eye(METHOD.stages) - z * A, np.ones(METHOD.stages))


def test_the_method_is_l_stable() -> None:
    """No vibration grows (the imaginary axis bounds the left half-plane), and the fastest vanish."""
    assert max(abs(stability(1j * w)) for w in np.logspace(-3, 6, 400)) <= 1 + 1e-14
    assert abs(stability(-1e8)) < 1e-6


def test_phase_and_energy_of_a_vibration_are_off_as_stated() -> None:
    """In each step (ωh)⁵/1200 of phase and (ωh)⁶/18000 of energy: round numbers, to 2 %."""
    angle = 0.05
    amplified = stability(1j * angle)
    assert abs(np.angle(amplified) - angle) == pytest.approx(angle**5 / 1200, rel=0.02)
    assert 1 - abs(amplified) ** 2 == pytest.approx(angle**6 / 18000, rel=0.02)
