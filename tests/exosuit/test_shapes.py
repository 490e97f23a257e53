"""Surface families against hand-worked values, their bounds, and their slopes against finite differences."""

import json

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from exosight.errors import InputError
from exosight.exosuit.shapes import (
    FAMILIES,
    RADIUS_MAX,
    RADIUS_MIN,
    TABLE_I,
    CosineSum,
    ExosuitShape,
    Legendre,
    Linear,
    Sine,
    SineCosine,
    Surface,
    radius,
    radius_slope,
    ranges,
    shape_from_dict,
    shape_to_dict,
)

MM = 1e-3


def surfaces() -> st.SearchStrategy[tuple[type[Surface], dict]]:
    """Family and parameters of any surface that Table II allows, on or off the grid."""

    def of(kind: type[Surface]) -> st.SearchStrategy[tuple[type[Surface], dict]]:
        entries = {}
        for name, allowed in ranges(kind).items():
            number = st.floats(allowed.low, allowed.high)
            entries[name] = number if allowed.count == 1 else st.tuples(*[number] * allowed.count)
        return st.tuples(st.just(kind), st.fixed_dictionaries(entries))

    return st.one_of([of(kind) for kind in FAMILIES.values()])


def build(drawn: tuple[type[Surface], dict]) -> Surface:
    kind, parameters = drawn
    return kind(**parameters)


def test_the_families_are_the_published_five() -> None:
    assert list(FAMILIES) == ["linear", "sine", "cosine_sum", "sine_cosine", "legendre"]


def test_table_i_exosuit() -> None:
    assert TABLE_I.length == 0.10
    # Exact, not clipped by rounding: the tip must keep its slope.
    assert radius(TABLE_I.surface, 0.0) == 5.8 * MM
    assert radius(TABLE_I.surface, 1.0) == 4.0 * MM
    np.testing.assert_allclose(
        radius_slope(TABLE_I.surface, np.array([0.0, 0.5, 1.0])), -1.8 * MM, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("surface", "x", "expected_mm"),
    [
        (Linear(0.010, 0.005), 0.25, 8.75),
        (Sine(0.008, -0.5), 1.0, 8 - 8 / 20),  # sin(−π/2) = −1
        (Sine(0.008, -3.0), 0.5, 8 + 8 / 20),  # sin(−3π/2) = 1
        (CosineSum((-15, -15, -15, -15, -15, -15, -15)), 0.0, 10.0),  # |−105| × 0.1 mm = 10.5 mm, clipped
        (CosineSum((-10, -15, -15, -15, -15, -15, -15)), 0.0, 10.0),  # the sum just reaches the upper bound
        (CosineSum((-15, -15, -15, -15, -15, -15, -15)), 1.0, 4.0),  # alternating signs leave 1.5 mm, clipped
        (CosineSum((-15, -10, -15, 0, -15, 0, -15)), 1.0, 5.0),  # |−60 + 10| × 0.1 mm
        (SineCosine(0.008, 1.0, 2.0, 0.0, 0.0), 0.5, 8 + 0.8 * (1 - 1)),
        (SineCosine(0.008, 1.0, 2.0, np.pi / 2, 0.0), 0.0, 8 + 0.8 * (1 + 1)),
        # 20 m_n / 3ⁿ mm times P_n: P_0 = 1, P_1(½) = ½, P_2(½) = −1/8, P_3(½) = −7/16, …
        (Legendre((0.2, 0.3, 0.4, 0.5, 0.001, 0.001)), 0.5, 4 + 1 - 1 / 9 - 0.4375 * 10 / 27 + MM * -0.0640),
        (
            Legendre((0.2, 0.3, 0.001, 0.001, 0.001, 0.001)),
            1.0,
            6 + 0.02 * (1 / 9 + 1 / 27 + 1 / 81 + 1 / 243),
        ),
    ],
)
def test_radius_matches_the_formula_by_hand(surface: Surface, x: float, expected_mm: float) -> None:
    # 1e-5 mm: what the smallest Legendre terms, worked out to three digits above, leave open.
    assert radius(surface, x) / MM == pytest.approx(expected_mm, abs=1e-5)


@given(surfaces(), st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_radius_stays_within_the_bounds(drawn, x: list[float]) -> None:
    values = radius(build(drawn), np.array(x))
    assert values.shape == (len(x),)
    assert np.all((values >= RADIUS_MIN) & (values <= RADIUS_MAX))


@given(surfaces(), st.integers(0, 99))
def test_slope_is_the_derivative_of_the_clipped_radius(drawn, place: int) -> None:
    surface = build(drawn)
    x, h = (place + 0.5) / 100, 1e-5
    around = np.array([x - h, x, x + h])
    unclipped, _ = surface.profile(around)
    assume(all(np.ptp(np.sign(unclipped - bound)) == 0 for bound in (RADIUS_MIN, RADIUS_MAX)))  # no kink here
    before, _, after = radius(surface, around)
    # Central difference: h²/6 times the third derivative, at most (15π)³ × 0.5 mm = 52 m, is 0.9e-9 m.
    assert radius_slope(surface, x) == pytest.approx((after - before) / (2 * h), abs=2e-9)


def test_slope_is_zero_where_the_profile_is_cut_off() -> None:
    surface = Legendre((1.0, 1.0, 0.001, 0.001, 0.001, 0.001))  # 2 cm and more
    x = np.linspace(0, 1, 11)
    assert np.all(surface.profile(x)[1] > 0)
    assert np.all(radius_slope(surface, x) == 0)


def test_points_of_any_shape() -> None:
    x = np.linspace(0, 1, 12).reshape(3, 4)
    for function in (radius, radius_slope):
        whole = function(SineCosine(0.006, 1, 2, 0.5, 1), x)
        assert whole.shape == (3, 4)
        assert whole[1, 2] == function(SineCosine(0.006, 1, 2, 0.5, 1), float(x[1, 2]))


@pytest.mark.parametrize(
    ("make", "parts"),
    [
        (lambda: Linear(0.0101, 0.005), ["linear", "r0", "0.004…0.01 m", "0.0101"]),
        (lambda: Linear(0.006, 0.0039), ["linear", "r1", "0.0039"]),
        (lambda: Linear(0.58, 0.40), ["linear", "r0", " m", "0.58"]),
        (lambda: Sine(0.006, 0.1), ["sine", " a ", "-15…0.001", "0.1"]),
        (lambda: Sine(float("nan"), -1), ["sine", "r0", "nan"]),
        (lambda: CosineSum((0.0,) * 6), ["cosine_sum", " b ", "7 numbers", "6"]),
        (lambda: CosineSum((0.0,) * 6 + (1.0,)), ["cosine_sum", " b ", "0.1 mm", "1.0"]),
        (lambda: SineCosine(0.006, 0, 1, 0, 0), ["sine_cosine", " c ", "0.0001…5", "0"]),
        (lambda: SineCosine(0.006, 1, 1, 0, 7), ["sine_cosine", "phi_d", "rad", "7"]),
        (lambda: Legendre((0.5,) * 5 + (float("inf"),)), ["legendre", " m ", "cm", "inf"]),
        (lambda: ExosuitShape(Linear(0.006, 0.005), -0.1), ["exosuit", "length", "0.07…0.11 m", "-0.1"]),
        (lambda: radius(TABLE_I.surface, 1.5), ["x", "[0, 1]"]),
        (lambda: radius_slope(TABLE_I.surface, np.array([0.5, np.nan])), ["x", "[0, 1]"]),
    ],
)
def test_out_of_range_is_one_sentence(make, parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        make()
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_whole_numbers_and_numpy_scalars_become_plain_floats() -> None:
    surface = SineCosine(0.008, 1, np.float64(2), 0, 1)
    assert [type(getattr(surface, name)) for name in ranges(SineCosine)] == [float] * 5
    assert [type(value) for value in CosineSum((0,) * 7).b] == [float] * 7


@given(surfaces(), st.floats(0.07, 0.11))
def test_shape_survives_json(drawn, length: float) -> None:
    shape = ExosuitShape(build(drawn), length)
    assert shape_from_dict(json.loads(json.dumps(shape_to_dict(shape)))) == shape


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"family": "spline"}, ["'spline'", "linear, sine, cosine_sum, sine_cosine, legendre"]),
        ({"family": []}, ["[]", "legendre"]),
        ({"parameters": {"r0": 0.005}}, ["linear", "r0", "r1"]),
        ({"parameters": {"r0": 0.005, "r1": 0.005, "a": 1}}, ["linear", "'a'"]),
        ({"parameters": [0.005, 0.005]}, ["linear", "0.005"]),
        ({"parameters": {"r0": 0.005, "r1": "thin"}}, ["linear", "r1", "thin"]),
        ({"parameters": {"r0": 0.005, "r1": True}}, ["linear", "r1", "True"]),
        ({"length": None}, ["length", "None"]),
        ({"colour": "red"}, ["colour"]),
    ],
)
def test_a_damaged_description_is_one_sentence(change: dict, parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        shape_from_dict(shape_to_dict(TABLE_I) | change)
    for part in parts:
        assert part in str(caught.value)
