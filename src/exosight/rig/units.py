"""SI units of what instruments read."""

from exosight.system.units import FORCE, KINDS, MODULUS, TORQUE, Kind

_LBF = 4.4482216152605  # N, exactly: international pound × standard gravity
_KGF = 9.80665  # N, exactly: standard gravity

FURTHER = (
    Kind(
        *FORCE[:2],
        {
            "N": 1.0,
            **{"µN": 1e-6, "uN": 1e-6, "MN": 1e6, "dyn": 1e-5, "cN": 1e-2},
            **{"kgf": _KGF, "gf": _KGF / 1e3, "lbf": _LBF, "ozf": _LBF / 16},
        },
    ),
    Kind(
        "a pressure",
        "20 kPa",
        {
            **MODULUS.units,
            **{"hPa": 1e2, "bar": 1e5, "mbar": 1e2, "atm": 101325.0},
            **{"psi": _LBF / 0.0254**2, "mmHg": 133.322387415},
        },
    ),
    Kind(*TORQUE[:2], {**TORQUE.units, "Nm": 1.0, "mNm": 1e-3, "Nmm": 1e-3, "N cm": 1e-2, "Ncm": 1e-2}),
    Kind("a voltage", "5 V", {"V": 1.0, "mV": 1e-3, "µV": 1e-6, "uV": 1e-6, "kV": 1e3}),
    Kind("a current", "20 mA", {"A": 1.0, "mA": 1e-3, "µA": 1e-6, "uA": 1e-6}),
    Kind("a time", "20 ms", {"s": 1.0, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}),
    Kind("a volume", "5 mL", {"m^3": 1.0, "L": 1e-3, "l": 1e-3, "mL": 1e-6, "ml": 1e-6}),
    Kind("an angle", "20 mrad", {"rad": 1.0, "mrad": 1e-3}),
)
"""Units of measured quantities that system files do not take.

Sources: BIPM, The International System of Units, 9th edition, 2019; NIST SP 811, appendix B.8 (gf, lbf, psi,
mmHg).
"""


def in_si(unit: str) -> tuple[str, float]:
    """The SI unit of a quantity, and what one of the given unit is in it; of an unknown unit itself and 1."""
    plain = " ".join(unit.replace("·", " ").replace("*", " ").replace("²", "^2").replace("³", "^3").split())
    plain = plain.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}")
    for kind in (*KINDS, *FURTHER):
        if plain in kind.units:
            return next(iter(kind.units)), kind.units[plain]
    return plain, 1.0
