"""System files for tests: the example, and the same with a second channel."""

from pathlib import Path

THUMB = Path(__file__).parents[2] / "examples" / "systems" / "thumb.toml"
"""One channel, u [N]."""

_ASSIST = """
[actuators.assist]
type = "joint_torque"
body = "proximal"
range = ["-20 mN m", "40 mN m"]
"""


def coarse_thumb() -> str:
    """The file of the thumb with half of the points along its sleeve, which solves in half of the time."""
    young = 'young = "300 kPa"'
    return THUMB.read_text(encoding="utf-8").replace(young, f"{young}\npoints_per_element = 4")


def write_assisted_thumb(file: Path) -> None:
    """The thumb with a motor at its joint beside the sleeve: a second channel, assist [N m]."""
    text = coarse_thumb().replace('name = "thumb"', 'name = "assisted"')
    # Before the list of what varies, which ends the file.
    file.write_text(text.replace("[sensors.P1]", f"{_ASSIST}\n[sensors.P1]"), encoding="utf-8")
