import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.system.profile import from_formula, from_points

INSIDE = np.linspace(0.01, 0.99, 37)


@pytest.mark.parametrize(
    "text",
    [
        "5.8 - 1.8*X",
        "5 + 0.2*sin(3*pi*X) - cos(X)**2",
        "4 + X**2.5 + X**3 + 2**X",
        "exp(-X) + log(1 + X) + sqrt(1 + X) + tan(X/2)",
        "maximum(3, 5 - 3*X) + minimum(X, 0.4) + abs(X - 0.3)",
        "-(1 - X)**3 / (2 + X) + +7",
    ],
)
def test_slope_of_a_formula_is_its_derivative(text: str) -> None:
    profile, h = from_formula(text, 1e-3), 1e-6
    difference = (profile.value(INSIDE + h) - profile.value(INSIDE - h)) / (2 * h)
    # Central differences: h² of the third derivative, and round-off of 1e-16 · 10 / h.
    np.testing.assert_allclose(profile.slope(INSIDE), difference, rtol=1e-7, atol=1e-11)


def test_formula_is_in_its_unit() -> None:
    np.testing.assert_allclose(
        from_formula("5 - 2*X", 1e-3).value(np.array([0.0, 0.5, 1.0])), [5e-3, 4e-3, 3e-3]
    )
    np.testing.assert_allclose(from_formula("7", 1e-3).slope(INSIDE), 0)


@given(
    st.lists(st.floats(0.01, 0.99), min_size=1, max_size=8, unique=True).filter(
        lambda x: min(np.diff(sorted([0, *x, 1]))) > 1e-3
    ),
    st.data(),
)
def test_curve_through_points_rises_and_falls_where_they_do(inner: list[float], data: st.DataObject) -> None:
    x = np.array([0.0, *sorted(inner), 1.0])
    radius = np.array(data.draw(st.lists(st.floats(1, 9), min_size=len(x), max_size=len(x))))
    curve = from_points(x, radius)
    np.testing.assert_allclose(curve.value(x), radius, rtol=1e-12)
    for i in range(len(x) - 1):
        between = curve.value(np.linspace(x[i], x[i + 1], 20))
        steps = np.diff(between) * np.sign(radius[i + 1] - radius[i])
        assert np.all(steps >= -1e-9)  # round-off of radii up to 9
