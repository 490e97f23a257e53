"""Strain bases and quadrature rules against the polynomials they must reproduce."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.mechanics import Gauss, Legendre, NodalQuadratic

ELEMENTS = st.integers(1, 8)
quickly = settings(deadline=None, max_examples=30)
X = np.linspace(0.0, 1.0, 97)


@quickly
@given(ELEMENTS)
def test_nodal_functions_are_one_at_their_node_and_zero_at_the_others(elements: int) -> None:
    basis = NodalQuadratic(elements)
    nodes = np.linspace(0, 1, basis.size)
    np.testing.assert_allclose(
        basis.evaluate(nodes), np.eye(basis.size), atol=1e-14
    )  # round-off in the nodes


@quickly
@given(ELEMENTS, st.tuples(*[st.floats(-5, 5)] * 3))
def test_nodal_basis_holds_every_parabola(elements: int, coefficients: tuple[float, ...]) -> None:
    basis = NodalQuadratic(elements)
    parabola = np.polynomial.Polynomial(coefficients)
    at_nodes = parabola(np.linspace(0, 1, basis.size))
    np.testing.assert_allclose(basis.evaluate(X) @ at_nodes, parabola(X), atol=1e-12)


@quickly
@given(ELEMENTS)
def test_nodal_functions_are_continuous(elements: int) -> None:
    inner = np.arange(1, elements) / elements
    basis, step = NodalQuadratic(elements), 1e-9
    jump = basis.evaluate(inner + step) - basis.evaluate(inner - step)
    assert np.abs(jump).max(initial=0) <= 2 * step * 4 * elements  # their slopes are at most 4 an element


@quickly
@given(st.integers(0, 6))
def test_legendre_functions_are_orthogonal(degree: int) -> None:
    rule = Gauss(1, degree + 1)
    values = Legendre(degree).evaluate(rule.points)
    gram = values.T @ (rule.weights[:, None] * values)
    np.testing.assert_allclose(gram, np.diag(1 / (2 * np.arange(degree + 1) + 1)), atol=1e-14)


def test_legendre_functions_are_one_at_the_tip() -> None:
    np.testing.assert_allclose(Legendre(5).evaluate(np.array([1.0])), 1.0)


@quickly
@given(ELEMENTS, st.integers(1, 8), st.booleans())
def test_gauss_integrates_its_degree_exactly(elements: int, per_element: int, element_ends: bool) -> None:
    rule = Gauss(elements, per_element, element_ends)
    for power in range(2 * per_element):
        # Sums of up to 64 products: a few times the spacing of doubles near one.
        assert rule.weights @ rule.points**power == pytest.approx(1 / (power + 1), abs=1e-14)


@quickly
@given(ELEMENTS, st.integers(1, 8), st.booleans())
def test_points_ascend_from_end_to_end(elements: int, per_element: int, element_ends: bool) -> None:
    rule = Gauss(elements, per_element, element_ends)
    assert rule.points[0] == 0
    assert rule.points[-1] == 1
    assert np.all(np.diff(rule.points) > 0)
    assert len(rule.points) == len(rule.weights) == rule.size
    assert rule.size == elements * per_element + (elements + 1 if element_ends else 2)


def test_the_published_rule_has_42_points() -> None:
    assert Gauss(5, 8).size == 42


def test_impossible_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="at least 1 element"):
        NodalQuadratic(0)
    with pytest.raises(InputError, match="degree of at least 0"):
        Legendre(-1)
    with pytest.raises(InputError, match="at least 1 element and 1 point"):
        Gauss(5, 0)
