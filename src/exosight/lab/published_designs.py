"""What can be set of the published system: family and parameters of the exosuit, material, finger."""

from exosight.exosuit.assembly import Exosuit, varied
from exosight.exosuit.published import NOMINAL_CAMERA, Preset, published
from exosight.exosuit.shapes import FAMILIES, Range, ranges, shape_from_dict
from exosight.exosuit.variation import Variant
from exosight.lab.designs import Choice, DesignControls, Group, Option, Slider, Values

_EXOSUIT = (
    Slider("length", "Length", "mm", 70.0, 110.0, 0.1, 95.0),
    Slider("young", "Young's modulus", "kPa", 100.0, 1000.0, 10.0, 300.0),
    Slider("gap", "Gap at the base", "mm", 0.0, 10.0, 0.1, 0.0),
)
_FRICTION = Slider("friction", "Coefficient of friction", "", 0.0, 1.0, 0.01, 0.3)
_FINGER = (
    Slider("finger_length", "Length of the links, factor", "", 0.8, 1.25, 0.01, 1.0),
    Slider("finger_radius", "Radius, factor", "", 0.8, 1.25, 0.01, 1.0),
    Slider("joint_stiffness", "Joint stiffness, factor", "", 0.5, 2.0, 0.01, 1.0),
)

# Label of each family; label and start of its parameters, ones whose radius varies.
_FAMILIES = {
    "linear": ("linear taper", ("Radius at the base", 10.0), ("Radius at the tip", 5.0)),
    "sine": ("sine", ("Mean radius", 8.0), ("Half waves A", -5.0)),
    "cosine_sum": (
        "sum of cosines",
        *((f"Amplitude B{n}", start) for n, start in enumerate((-1.5, -1.5, -1.5, -1.5, -1.2, -0.9, -0.6))),
    ),
    "sine_cosine": (
        "sine and cosine",
        *(("Mean radius", 7.0), ("Half waves C", 1.5), ("Half waves D", 2.5)),
        *(("Phase φC", 0.5), ("Phase φD", 1.0)),
    ),
    "legendre": (
        "Legendre polynomials",
        *((f"Amplitude m{n}", start) for n, start in enumerate((0.35, 0.1, 0.2, 0.3, 0.2, 0.1))),
    ),
}
_SHOWN = {"m": ("mm", 1e3), "(0.1 mm)": ("mm", 0.1)}
"""Unit of a parameter in Table II → the one shown, and how many of these it is."""


def published_controls(preset: Preset = published) -> DesignControls:
    """The designs of the published system, or of another one of its parts: an exosuit of any family and its
    finger."""
    families = tuple(
        Option(name, label, _sliders(name, words)) for name, (label, *words) in _FAMILIES.items()
    )
    nominal = preset(Exosuit(), NOMINAL_CAMERA)
    rubs = any(contact.friction is not None for contact in nominal.contacts)
    sliders = (*_EXOSUIT, *(_FRICTION,) * rubs)
    groups = (Group("Exosuit", sliders, Choice("family", "Family", families)), Group("Finger", _FINGER))
    return DesignControls(nominal.schema, groups, lambda values: preset(_worn(values), NOMINAL_CAMERA))


def _keys(family: str) -> dict[str, tuple[str, Range]]:
    """Keys of a family's numbers: the parameter, or the parameter and its place, and its range."""
    allowed = ranges(FAMILIES[family])
    return {
        name if each.count == 1 else f"{name}_{place}": (name, each)
        for name, each in allowed.items()
        for place in range(each.count)
    }


def _sliders(family: str, words: list[tuple[str, float]]) -> tuple[Slider, ...]:
    sliders = []
    for (key, (_, each)), (label, start) in zip(_keys(family).items(), words, strict=True):
        unit, scale = _SHOWN.get(each.unit, (each.unit, 1.0))
        low, high, step = (scale * value for value in (each.low, each.high, each.step))
        sliders.append(Slider(key, label, unit, low, high, step, start))
    return tuple(sliders)


def _worn(values: Values) -> Exosuit:
    family = values["family"]
    numbers: dict[str, list[float]] = {}
    for key, (name, each) in _keys(family).items():
        value = values[key] / _SHOWN.get(each.unit, ("", 1.0))[1]
        numbers.setdefault(name, []).append(min(max(value, each.low), each.high))  # not past it by round-off
    parameters = {name: own if len(own) > 1 else own[0] for name, own in numbers.items()}
    shape = {"family": family, "parameters": parameters, "length": round(values["length"] / 1e3, 12)}
    longer, stiffer = values["finger_length"], values["joint_stiffness"]
    finger = Variant(
        link_length=(longer, longer, longer, longer),
        finger_radius=values["finger_radius"],
        joint_stiffness=(stiffer, stiffer, stiffer),
    )
    exosuit = Exosuit(
        shape_from_dict(shape),
        young=1e3 * values["young"],
        gap=values["gap"] / 1e3,
        friction=values.get("friction", _FRICTION.start),
    )
    return varied(exosuit, finger)
