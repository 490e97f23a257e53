import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.system import units
from exosight.system.units import Kind, split_quantity, to_si

KINDS = [each for each in vars(units).values() if isinstance(each, Kind)]
numbers = st.floats(-1e9, 1e9, allow_subnormal=False)


@given(numbers, st.sampled_from(KINDS), st.data())
def test_a_number_written_with_its_unit_reads_back(value: float, kind: Kind, data: st.DataObject) -> None:
    unit = data.draw(st.sampled_from(sorted(kind.units)))
    space = data.draw(st.sampled_from(["", " ", "  "]))
    assert to_si(kind)(f"{value!r}{space}{unit}") == value * kind.units[unit]


@given(st.text(max_size=80))
def test_any_text_is_a_finite_quantity_or_refused(text: str) -> None:
    with suppress(ValueError):
        value, unit = split_quantity(text, "45 mm")
        assert math.isfinite(value)
        assert unit.isprintable()


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("45 mm", units.LENGTH, 0.045),
        ("180 deg", units.ANGLE, math.pi),
        ("300 kPa", units.MODULUS, 3e5),
        ("1 g/cm³", units.DENSITY, 1000.0),
        ("1 N mm/deg", units.ROTARY_STIFFNESS, 1e-3 * 180 / math.pi),
        ("40 N·mm/rad", units.ROTARY_STIFFNESS, 0.04),
        ("2 N/mm", units.STIFFNESS, 2000.0),
    ],
)
def test_units_are_those_of_physics(text: str, kind: Kind, value: float) -> None:
    np.testing.assert_allclose(to_si(kind)(text), value, rtol=1e-15)  # one multiplication


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_another_quantity_is_refused(kind: Kind) -> None:
    other = units.MASS if kind is not units.MASS else units.LENGTH
    with pytest.raises(ValueError, match=f"expected {kind.name} in"):
        to_si(kind)(other.example)
