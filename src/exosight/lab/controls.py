"""How the page shows the settings: labels, units, steps and starting values, so that it knows no numbers."""

from dataclasses import asdict, dataclass
from typing import Any, get_args

import pydantic

from exosight import __version__
from exosight.exosuit.shapes import FAMILIES, ranges
from exosight.lab.settings import LARGEST, STEP, Corruption, Disturbance, Law, LoopSettings, Sensor, View


@dataclass(frozen=True)
class Slider:
    """One number on the page.

    key     of the setting; empty for a parameter of a family
    scale   shown = scale × value
    """

    key: str
    label: str
    unit: str
    scale: float
    low: float
    high: float
    step: float
    start: float


_GROUPS: dict[str, tuple[tuple[str, str, str, float, float], ...]] = {
    "Exosuit": (
        ("length", "Length", "mm", 1e3, 1e-4),
        ("young", "Young's modulus", "kPa", 1e-3, 1e4),
        ("gap", "Gap at the base", "mm", 1e3, 1e-4),
    ),
    "Finger": (
        ("finger_length", "Length", "%", 100.0, 0.01),
        ("finger_radius", "Radius", "%", 100.0, 0.01),
        ("joint_stiffness", "Joint stiffness", "%", 100.0, 0.01),
    ),
    "Camera": (
        ("shift_x", "Shift right", "%", 100.0, 0.01),
        ("shift_y", "Shift down", "%", 100.0, 0.01),
        ("roll", "Turn", "rad", 1.0, 0.01),
        ("zoom", "Zoom", "%", 100.0, 0.01),
        ("tilt", "Tilt", "rad", 1.0, 0.01),
    ),
}

_PARAMETERS = {
    "linear": ("Radius at the base", "Radius at the tip"),
    "sine": ("Mean radius", "Half waves A"),
    "cosine_sum": tuple(f"Amplitude B{n}" for n in range(7)),
    "sine_cosine": ("Mean radius", "Half waves C", "Half waves D", "Phase φC", "Phase φD"),
    "legendre": tuple(f"Amplitude m{n}" for n in range(6)),
}

STARTS: dict[str, tuple[float, ...]] = {
    "linear": View().parameters,
    "sine": (0.008, -5.0),
    "cosine_sum": (-15.0, -15.0, -15.0, -15.0, -12.0, -9.0, -6.0),
    "sine_cosine": (0.007, 1.5, 2.5, 0.5, 1.0),
    "legendre": (0.35, 0.1, 0.2, 0.3, 0.2, 0.1),
}
"""Parameters of each family when it is chosen: ones whose radius varies."""

_FAMILY_WORDS = {
    "linear": "linear taper",
    "sine": "sine",
    "cosine_sum": "sum of cosines",
    "sine_cosine": "sine and cosine",
    "legendre": "Legendre polynomials",
}
_CORRUPTION_WORDS = {
    "none": "none",
    "noise-low": "noise, variance 0.001",
    "noise-medium": "noise, variance 0.01",
    "noise-high": "noise, variance 0.1",
    "contrast-low": "contrast, a third lost",
    "contrast-high": "contrast, three quarters lost",
    "blur": "blur",
    "occlusion": "an object in front",
    "background": "a background",
}
_LAW_WORDS = {"scheduled": "scheduled, behind the guard", "proportional": "proportional, the paper's"}
_SENSOR_WORDS = {"network": "network, from the picture", "true": "true force"}
_DISTURBANCE_WORDS = {
    "none": "none",
    "noise": "noise on the picture, 2 to 3 s",
    "lost": "no pictures, 2 to 3 s",
    "frozen": "frozen camera, 2 to 3 s",
    "elsewhere": "another picture, 2 to 3 s",
    "softer": "exosuit 20 % softer than known",
}


def about() -> dict[str, Any]:
    """All that the page needs to build itself, as JSON values."""
    view, run = View(), LoopSettings()
    bounds = pydantic.TypeAdapter(View).json_schema()["properties"]
    groups = {
        name: [asdict(_slider(*words, bounds, view)) for words in sliders]
        for name, sliders in _GROUPS.items()
    }
    of_run = pydantic.TypeAdapter(LoopSettings).json_schema()["properties"]
    return {
        "version": __version__,
        "start": pydantic.TypeAdapter(View).dump_python(view, mode="json"),
        "drive": {"step": STEP, "largest": LARGEST},
        "groups": groups,
        "families": [
            {"name": name, "label": _FAMILY_WORDS[name], "parameters": [asdict(s) for s in _sliders(name)]}
            for name in FAMILIES
        ],
        "corruptions": _options(get_args(Corruption), _CORRUPTION_WORDS),
        "run": {
            "target": asdict(_slider("target", "Target F_net", "N", 1.0, 0.01, of_run, run)),
            "gain": {**asdict(_slider("gain", "Gain K_P", "N/N", 1.0, 0.01, of_run, run)), "log": True},
            "laws": _options(get_args(Law), _LAW_WORDS),
            "sensors": _options(get_args(Sensor), _SENSOR_WORDS),
            "disturbances": _options(get_args(Disturbance), _DISTURBANCE_WORDS),
        },
    }


def _slider(
    key: str,
    label: str,
    unit: str,
    scale: float,
    step: float,
    bounds: dict[str, Any],
    start: View | LoopSettings,
) -> Slider:
    low, high = bounds[key]["minimum"], bounds[key]["maximum"]
    return Slider(key, label, unit, scale, low, high, step, getattr(start, key))


def _sliders(family: str) -> list[Slider]:
    allowed = [each for each in ranges(FAMILIES[family]).values() for _ in range(each.count)]
    shown = {"m": ("mm", 1e3), "(0.1 mm)": ("mm", 0.1)}
    return [
        Slider("", label, *shown.get(each.unit, (each.unit, 1.0)), each.low, each.high, each.step, start)
        for label, each, start in zip(_PARAMETERS[family], allowed, STARTS[family], strict=True)
    ]


def _options(names: tuple[str, ...], words: dict[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "label": words[name]} for name in names]
