"""Strain bases and quadrature rules: what they reproduce, how fast they approximate, and rods of them."""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.mechanics import (
    Chebyshev,
    Circular,
    DeadForce,
    Fourier,
    Gauss,
    Gaussian,
    Hermite,
    Legendre,
    Monomial,
    NodalCubic,
    NodalLinear,
    NodalQuadratic,
    Robot,
    Rod,
)
from exosight.mechanics.basis import Basis

ELEMENTS = st.integers(1, 8)
COEFFICIENTS = st.tuples(*[st.floats(-5, 5)] * 4)
PLACES = st.lists(st.floats(0, 1), min_size=1, max_size=20).map(np.array)
quickly = settings(deadline=None, max_examples=30)

NODAL = {1: NodalLinear, 2: NodalQuadratic, 3: NodalCubic}
POLYNOMIAL = (Monomial, Legendre, Chebyshev)
nodal = pytest.mark.parametrize(("degree", "family"), NODAL.items())
polynomial = pytest.mark.parametrize("family", POLYNOMIAL)


@nodal
@quickly
@given(elements=ELEMENTS)
def test_nodal_functions_are_one_at_their_node_and_zero_at_the_others(
    degree: int, family: Callable, elements: int
) -> None:
    basis = family(elements)
    assert basis.size == degree * elements + 1
    nodes = np.linspace(0, 1, basis.size)
    np.testing.assert_allclose(
        basis.evaluate(nodes), np.eye(basis.size), atol=1e-13
    )  # round-off in the nodes, times slopes of up to 5.5 an element


@nodal
@quickly
@given(elements=ELEMENTS, coefficients=COEFFICIENTS, x=PLACES)
def test_nodal_basis_holds_every_polynomial_of_its_degree(
    degree: int, family: Callable, elements: int, coefficients: tuple[float, ...], x: np.ndarray
) -> None:
    """A constant among them: the functions sum to one."""
    basis = family(elements)
    whole = np.polynomial.Polynomial(coefficients[: degree + 1])
    at_nodes = whole(np.linspace(0, 1, basis.size))
    np.testing.assert_allclose(basis.evaluate(x) @ at_nodes, whole(x), atol=1e-12)


@quickly
@given(ELEMENTS, COEFFICIENTS, PLACES)
def test_hermite_holds_every_cubic_by_value_and_slope(
    elements: int, coefficients: tuple[float, ...], x: np.ndarray
) -> None:
    cubic = np.polynomial.Polynomial(coefficients)
    nodes = np.linspace(0, 1, elements + 1)
    q = np.stack([cubic(nodes), cubic.deriv()(nodes)], axis=1).ravel()
    np.testing.assert_allclose(Hermite(elements).evaluate(x) @ q, cubic(x), atol=1e-12)


@pytest.mark.parametrize("family", [*NODAL.values(), Hermite])
@quickly
@given(elements=ELEMENTS)
def test_piecewise_functions_are_continuous(family: Callable, elements: int) -> None:
    inner = np.arange(1, elements) / elements
    basis, step = family(elements), 1e-9
    jump = basis.evaluate(inner + step) - basis.evaluate(inner - step)
    assert (
        np.abs(jump).max(initial=0) <= 2 * step * 5.5 * elements
    )  # the steepest slope: a cubic's, at its end


@quickly
@given(ELEMENTS)
def test_only_hermite_functions_have_continuous_slopes(elements: int) -> None:
    """One-sided differences at inner nodes: alike for Hermite, and 1 of each node's own slope function."""
    inner, step = np.arange(1, elements) / elements, 1e-6

    def slopes(basis: Basis) -> tuple[np.ndarray, np.ndarray]:
        here = basis.evaluate(inner)
        return (here - basis.evaluate(inner - step)) / step, (basis.evaluate(inner + step) - here) / step

    # Differences err by half a step times a second derivative of at most 6 elements², and by round-off.
    allowed = step * 6 * elements**2 + 1e-9
    before, after = slopes(Hermite(elements))
    np.testing.assert_allclose(before, after, atol=allowed)
    expected = np.zeros_like(after)
    expected[np.arange(elements - 1), 2 * np.arange(1, elements) + 1] = 1
    np.testing.assert_allclose(after, expected, atol=allowed)
    for family in NODAL.values():
        before, after = slopes(family(elements))
        assert np.all(np.abs(after - before).max(axis=1) > 1)


@polynomial
@quickly
@given(degree=st.integers(0, 7), x=PLACES)
def test_polynomial_bases_span_the_same(family: Callable, degree: int, x: np.ndarray) -> None:
    """Coefficients found at Chebyshev's nodes turn one basis into another at any place."""
    basis, other = family(degree), Legendre(degree)
    nodes = (1 + np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))) / 2
    change = np.linalg.solve(basis.evaluate(nodes), other.evaluate(nodes))
    # Round-off times the condition of powers up to the seventh, some 1e5.
    np.testing.assert_allclose(basis.evaluate(x) @ change, other.evaluate(x), atol=1e-10)


@polynomial
@quickly
@given(degree=st.integers(0, 6))
def test_polynomials_are_one_at_the_tip(family: Callable, degree: int) -> None:
    np.testing.assert_allclose(family(degree).evaluate(np.array([1.0])), 1.0)


def gram(basis: Basis, rule: Gauss) -> np.ndarray:
    values = basis.evaluate(rule.points)
    return values.T @ (rule.weights[:, None] * values)


@quickly
@given(st.integers(0, 6))
def test_legendre_functions_are_orthogonal(degree: int) -> None:
    expected = np.diag(1 / (2 * np.arange(degree + 1) + 1))
    np.testing.assert_allclose(gram(Legendre(degree), Gauss(1, degree + 1)), expected, atol=1e-14)


@quickly
@given(st.integers(0, 6))
def test_chebyshev_functions_are_orthogonal_at_their_nodes(degree: int) -> None:
    """Σ T_i T_j over the roots of T_n, n > degree: n for i = j = 0, n/2 for i = j, else 0."""
    n = degree + 1
    values = Chebyshev(degree).evaluate((1 + np.cos(np.pi * (np.arange(n) + 0.5) / n)) / 2)
    expected = n / 2 * np.diag([2.0] + [1.0] * degree)
    np.testing.assert_allclose(values.T @ values, expected, atol=1e-13)


@quickly
@given(st.integers(0, 4))
def test_fourier_functions_are_orthogonal_and_periodic(harmonics: int) -> None:
    basis = Fourier(harmonics)
    expected = np.diag([1.0] + [0.5] * 2 * harmonics)
    # Twelve points an element of an eighth of the rod: Gauss's rule is exact there to round-off.
    np.testing.assert_allclose(gram(basis, Gauss(8, 12)), expected, atol=1e-13)
    ends = basis.evaluate(np.array([0.0, 1.0]))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-14)


@quickly
@given(st.integers(2, 12), st.floats(0.2, 1.5))
def test_bumps_are_one_at_their_centres_and_fall_by_their_width(count: int, spacings: float) -> None:
    """1 at the centre, e^−½ one width beside it, e^−2 two."""
    width = spacings / (count - 1)
    basis = Gaussian(count, width)
    centres = np.linspace(0, 1, count)
    for away in (-2, -1, 0, 1, 2):
        beside = np.diag(basis.evaluate(centres + away * width))
        np.testing.assert_allclose(beside, np.exp(-(away**2) / 2), rtol=1e-12)


def strain_error(basis: Basis) -> float:
    """Least-squares distance of a smooth strain from the basis, in the mean over the rod."""
    rule = Gauss(48, 6)
    strain, root = np.exp(np.sin(5 * rule.points)), np.sqrt(rule.weights)
    functions = root[:, None] * basis.evaluate(rule.points)
    q = np.linalg.lstsq(functions, root * strain, rcond=None)[0]
    return float(np.linalg.norm(functions @ q - root * strain))


@pytest.mark.parametrize(("degree", "family"), [*NODAL.items(), (3, Hermite)])
def test_piecewise_error_falls_at_the_order_of_the_degree_plus_one(degree: int, family: Callable) -> None:
    errors = np.array([strain_error(family(elements)) for elements in (24, 48)])
    # 0.15 of an order is left of the limit of small elements at this size.
    assert np.log2(errors[0] / errors[1]) == pytest.approx(degree + 1, abs=0.15)


@polynomial
def test_polynomial_error_falls_faster_than_any_power(family: Callable) -> None:
    errors = np.array([strain_error(family(degree)) for degree in (4, 8, 16)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders[0] > 4
    assert orders[1] > 1.5 * orders[0]


# A cantilever that only bends, under a tip force of 2 EI/L² across it: it deflects by half its length.
LENGTH, RADIUS, YOUNG = 0.3, 0.01, 1e6
FORCE = 2 * YOUNG * np.pi * RADIUS**4 / 4 / LENGTH**2
POINTS = Gauss(12, 8, element_ends=True)
FINE = NodalCubic(12)


def cantilevers(*bases: Basis) -> Robot:
    """One beside the other, all under the one load."""
    rods = [
        Rod(
            f"rod_{i}",
            LENGTH,
            Circular(jnp.full(POINTS.size, RADIUS)),
            young=YOUNG,
            strains={"bend_y": basis},
            quadrature=POINTS,
        )
        for i, basis in enumerate(bases)
    ]
    upwards = jnp.array([0.0, 0.0, 1.0])
    return Robot(tuple(rods), tuple(DeadForce(rod.name, -1, 0, upwards) for rod in rods))


def tips(evaluate: Callable, robot: Robot, within: np.ndarray | None = None) -> np.ndarray:
    """x/L and z/L of the loaded tips, by Newton's method, of all coordinates or `within` some columns."""
    columns = np.eye(robot.dofs) if within is None else within
    q = np.zeros(columns.shape[1])
    for _ in range(12):
        here, motion = evaluate(robot, columns @ q, np.array([FORCE]))
        step = np.linalg.solve(columns.T @ here.hessian @ columns, -columns.T @ here.gradient)
        q = q + step
        if np.abs(step).max() < 1e-10:
            ends = [robot.frame(body.name, -1) for body in robot.bodies]
            return np.asarray(motion.position)[ends][:, [0, 2]] / LENGTH
    raise AssertionError("Newton's method did not end")


@pytest.fixture(scope="module")
def exact(evaluate: Callable) -> np.ndarray:
    """The tip with a basis finer than all others here, at the same points along the rod."""
    return tips(evaluate, cantilevers(FINE))[0]


def test_the_finest_is_the_elastica(exact: np.ndarray) -> None:
    """Deflected by 0.4935 of the length under 2 EI/L², and shortened by 0.1606 of it.

    Source: Bisshopp and Drucker, Large deflection of cantilever beams, 1945; from its integrals.
    """
    np.testing.assert_allclose(exact, [0.83935828, 0.49345748], atol=1e-8)


@pytest.mark.parametrize(("degree", "family"), [*NODAL.items(), (3, Hermite)])
def test_cantilever_tip_converges_faster_than_its_strain(
    evaluate: Callable, exact: np.ndarray, degree: int, family: Callable
) -> None:
    """Energies, and with them the tip, err by the square of the strain's error: order 2 (p + 1) in the limit.

    On three to six elements (cubics: two to four), where points along the rod do not yet matter, it is 4.1,
    5.1, 6.9 and 6.3.
    Every coarse basis lies in the finest, so its coordinates are columns of it and nothing is compiled anew.
    """
    nodes = np.linspace(0, 1, FINE.size)
    coarse = 2 if degree == 3 else 3
    errors = [
        np.abs(tips(evaluate, cantilevers(FINE), family(n).evaluate(nodes))[0] - exact).max()
        for n in (coarse, 2 * coarse)
    ]
    order = np.log2(errors[0] / errors[1])
    assert order > 1.5 * (degree + 1), (errors, order)


@dataclass(frozen=True)
class Root:
    """A user's own basis: 1 and √X."""

    size: int = 2

    def evaluate(self, x: np.ndarray) -> np.ndarray:
        return np.stack([np.ones_like(x), np.sqrt(x)], axis=1)


def test_every_basis_bends_a_rod(evaluate: Callable, exact: np.ndarray) -> None:
    """Within what its functions can do: waves end as they begin, which a cantilever's strain does not."""
    allowed = {
        Monomial(4): 1e-6,
        Chebyshev(4): 1e-6,
        Gaussian(6, 0.2): 1e-3,
        Fourier(3): 2e-2,
        Root(): 2e-2,
    }
    found = tips(evaluate, cantilevers(*allowed))
    errors = np.abs(found - exact).max(axis=1)
    assert np.all(errors < [*allowed.values()]), errors
    np.testing.assert_allclose(found[0], found[1], atol=1e-12)  # two bases of one space


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


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: NodalQuadratic(0), "NodalQuadratic: expected a number of elements of at least 1"),
        (lambda: NodalLinear(-1), "NodalLinear: expected a number of elements of at least 1"),
        (lambda: Hermite(0), "Hermite: expected a number of elements of at least 1"),
        (lambda: Legendre(-1), "Legendre: expected a degree of at least 0"),
        (lambda: Chebyshev(-2), "Chebyshev: expected a degree of at least 0, got -2"),
        (lambda: Monomial(-1), "Monomial: expected a degree of at least 0"),
        (lambda: Fourier(-1), "Fourier: expected a number of harmonics of at least 0"),
        (lambda: Gaussian(1, 0.1), "Gaussian: expected a number of bumps of at least 2"),
        (lambda: Gaussian(4, 0.0), "Gaussian: expected a finite width above 0"),
        (lambda: Gaussian(4, float("nan")), "Gaussian: expected a finite width above 0"),
        (lambda: Gaussian(11, 0.2), "overlap too much to be told apart; expected .* at most some 0.15"),
        (lambda: Gauss(5, 0), "at least 1 element and 1 point"),
    ],
)
def test_impossible_sizes_are_refused(make: Callable, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make()
