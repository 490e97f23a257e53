"""How the page shows the settings: labels, units, steps and starting values, so that it knows no numbers."""

from dataclasses import asdict
from typing import Any, get_args

import pydantic

from exosight import __version__
from exosight.control.estimator import OnnxEstimator
from exosight.lab.designs import Slider
from exosight.lab.settings import CameraSettings, Corruption, Disturbance, Law, LoopSettings, Measured, View
from exosight.lab.system import LabSystem
from exosight.system.schema import SensorSpec
from exosight.system.system import System

_CAMERA = (
    ("shift_x", "Shift right", "%", 100.0, 0.01),
    ("shift_y", "Shift down", "%", 100.0, 0.01),
    ("roll", "Turn", "rad", 1.0, 0.01),
    ("zoom", "Zoom", "%", 100.0, 0.01),
    ("tilt", "Tilt", "rad", 1.0, 0.01),
)
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
_MEASURED_WORDS = {"network": "network, from the picture", "true": "true reading"}
_DISTURBANCE_WORDS = {
    "none": "none",
    "noise": "noise on the picture, 2 to 3 s",
    "lost": "no pictures, 2 to 3 s",
    "frozen": "frozen camera, 2 to 3 s",
    "elsewhere": "another picture, 2 to 3 s",
    "softer": "plant 20 % softer than known",
}


def about(lab: LabSystem, start: View) -> dict[str, Any]:
    """All that the page needs to build itself, as JSON values.

    start   the view that it opens with
    """
    schema = lab.schema
    system = lab.cached(start).system
    return {
        "version": __version__,
        "system": schema.system,
        "start": {
            **pydantic.TypeAdapter(View).dump_python(start, mode="json"),
            "design": lab.controls.complete(start.design),
        },
        "channels": [
            {
                "name": grid.channel.name,
                "unit": grid.channel.unit,
                "step": grid.step,
                "low": grid.command(grid.bottom),
                "high": grid.command(grid.top),
                "peak": grid.command(grid.peak),
            }
            for grid in lab.grids
        ],
        "sensors": [_sensor(sensor) for sensor in schema.sensors],
        "controllable": schema.controllable,
        "controlled": schema.controlled,
        "scene": _scene(system),
        "network": _network(lab.network, lab.refusal),
        "design": [asdict(group) for group in lab.controls.groups],
        "camera": [asdict(_bounded(CameraSettings, *words)) for words in _CAMERA],
        "corruptions": _options(get_args(Corruption), _CORRUPTION_WORDS),
        "run": _run(lab),
    }


def _sensor(sensor: SensorSpec) -> dict[str, str]:
    return {"name": sensor.name, "quantity": sensor.quantity, "unit": sensor.unit}


def _scene(system: System) -> dict[str, Any]:
    """What stays of a drawing: tubes, zones, and the rectangle that the camera sees [mm]."""
    camera = system.camera
    links = {body.name for body in system.bodies if not hasattr(body, "strains")}
    surfaces = {each.name: each for each in system.surfaces}
    zones = system.zones
    zoned = {body for zone in zones for body in surfaces[zone.surface].bodies}
    return {
        "tubes": [
            {
                "name": tube.name,
                "shade": tube.shade,
                "jointed": tube.nodes[0][0] in links,
                "zoned": not zoned.isdisjoint(body for body, _ in tube.nodes),
            }
            for tube in system.tubes
        ],
        "zones": [zone.spec.name for zone in zones],
        "centre": [1e3 * value for value in camera.centre],
        "size": [1e3 * camera.metres_per_pixel * side for side in (camera.width, camera.height)],
        "pixels": [camera.width, camera.height],
    }


def _network(network: OnnxEstimator, refusal: str | None) -> dict[str, Any]:
    schema = network.card.schema
    view = schema.cameras[0]
    return {
        "refusal": refusal,
        "system": schema.system,
        "sensors": [_sensor(schema.sensor(name)) for name in schema.controllable],
        "controlled": schema.controlled,
        "pixels": [view.width, view.height],
    }


def _run(lab: LabSystem) -> dict[str, Any]:
    """The settings of a run; the target's bounds follow from a path, see `path_answer`."""
    measured = get_args(Measured) if lab.refusal is None else ("true",)
    nominal = LoopSettings()
    unit = max(abs(grid.command(grid.peak)) for grid in lab.grids) / 4
    gain = Slider("gain", "Gain K_P", "", 0.05 * unit, 200.0 * unit, 0.01 * unit, nominal.gain * unit)
    return {
        "target": asdict(Slider("target", "Target", "", 0.02, 1.0, 0.01, nominal.target)),
        "gain": {**asdict(gain), "log": True},
        "laws": _options(get_args(Law), _LAW_WORDS),
        "measured": _options(measured, _MEASURED_WORDS),
        "disturbances": _options(get_args(Disturbance), _DISTURBANCE_WORDS),
    }


def _bounded(kind: type, key: str, label: str, unit: str, scale: float, step: float) -> Slider:
    bound = pydantic.TypeAdapter(kind).json_schema()["properties"][key]
    return Slider(key, label, unit, bound["minimum"], bound["maximum"], step, getattr(kind(), key), scale)


def _options(names: tuple[str, ...], words: dict[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "label": words[name]} for name in names]
