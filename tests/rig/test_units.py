"""Units of instruments in SI: known ones convert, others stay."""

import pytest

from exosight.rig.units import in_si


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("N", "N", 1.0),
        ("mN", "N", 1e-3),
        ("kN", "N", 1e3),
        ("gf", "N", 9.80665e-3),
        ("kPa", "Pa", 1e3),
        ("psi", "Pa", 6894.757293168),  # NIST SP 811
        ("mbar", "Pa", 100.0),
        ("N·m", "N m", 1.0),
        ("Nmm", "N m", 1e-3),
        ("µN", "N", 1e-6),
        ("\N{GREEK SMALL LETTER MU}N", "N", 1e-6),
        ("mV", "V", 1e-3),
        ("ms", "s", 1e-3),
        ("counts", "counts", 1.0),
        ("%", "%", 1.0),
    ],
)
def test_units_in_si(unit: str, si: str, factor: float) -> None:
    assert in_si(unit) == (si, pytest.approx(factor, rel=1e-12))
