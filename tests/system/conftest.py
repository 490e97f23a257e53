"""System files of the documentation, and one small enough to be changed entry by entry."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from exosight.system import describe, read_system_file
from exosight.system.build import build
from exosight.system.file import Values
from exosight.system.system import System

EXAMPLES = Path(__file__).parents[2] / "examples" / "systems"

SMALL = """
format = 1
name = "small"

[rods.soft]
length = "80 mm"
radius = "5 mm"
young = "300 kPa"
elements = 3
points_per_element = 4
position = ["0 mm", "0 mm", "15 mm"]

[links.base]
length = "40 mm"
radius = ["10 mm", "8 mm"]
joint = { type = "revolute", stiffness = "0.05 N m/rad" }

[links.tip]
parent = "base"
length = "30 mm"
radius = ["8 mm", "6 mm"]
joint = { type = "revolute", stiffness = "0.03 N m/rad" }

[surfaces.skin]
type = "tube"
bodies = ["base", "tip"]

[surfaces.soft_points]
type = "spheres"
bodies = ["soft"]

[surfaces.pads]
type = "spheres"
bodies = ["base", "tip"]
at = [0.5, 1.0]

[contacts.press]
first = "soft_points"
second = "pads"
stiffness = "1000 N/m"

[actuators.u]
type = "pressure_line"
body = "soft"
range = ["-2 N", "4 N"]

[sensors.near]
type = "contact_force"
surface = "pads"
spheres = [0, 1]
estimated = true

[sensors.far]
type = "contact_force"
surface = "pads"
body = "tip"
estimated = true

[sensors.sum]
type = "net_force"
parts = ["near", "far"]

[sensors.flexion]
type = "joint_angle"
body = "tip"

[cameras.side]
centre = ["40 mm", "0 mm"]
pixel = "1 mm"
"""


@pytest.fixture
def tubes() -> list[tuple[str, str]]:
    """What makes the small file one whose tubes press on each other."""
    return [
        ('[surfaces.soft_points]\ntype = "spheres"', '[surfaces.soft_points]\ntype = "tube"'),
        (
            'first = "soft_points"\nsecond = "pads"\nstiffness = "1000 N/m"',
            'first = "skin"\nsecond = "soft_points"',
        ),
        ('surface = "pads"\nspheres = [0, 1]', 'surface = "skin"\nat = "20 mm"'),
        ('surface = "pads"\nbody = "tip"', 'surface = "skin"\nat = "55 mm"'),
    ]


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write the small file with some of its text replaced, each piece exactly once; returns its path."""

    def call(*changes: tuple[str, str], text: str = SMALL) -> Path:
        for old, new in changes:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        path = tmp_path / "small.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return call


@pytest.fixture
def values(write: Callable[..., Path]) -> Callable[..., Values]:
    """The entries of the small file with some of its text replaced."""
    return lambda *changes: read_system_file(write(*changes))


@pytest.fixture
def system(values: Callable[..., Values]) -> Callable[..., System]:
    """The system of the small file with some of its text replaced."""

    def call(*changes: Any) -> System:
        return build(describe(values(*changes)))

    return call


@pytest.fixture
def examples(tmp_path: Path) -> Path:
    """A copy of the folder of the documentation's files."""
    return Path(shutil.copytree(EXAMPLES, tmp_path / "systems"))
