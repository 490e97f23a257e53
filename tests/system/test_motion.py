"""Motions of system files: a damped link that swings, and one that bounces off a damped plane."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from exosight.app.main import main
from exosight.errors import InputError
from exosight.mechanics import MotionOptions
from exosight.system import describe, read_system_file
from exosight.system.build import build
from exosight.system.motion import simulate_motion
from exosight.system.system import System

MASS, LENGTH = 0.02, 0.05
EXACT = MotionOptions(tolerance=1e-10)
INERTIA = MASS * (LENGTH / 2) ** 2
FLAPPER = """
format = 1
name = "flapper"

[links.flap]
length = "50 mm"
radius = ["5 mm", "5 mm"]
mass = "20 g"
joint = {{ type = "revolute", stiffness = "{stiffness} N m/rad", damping = "{damping} mN m s/rad" }}

[surfaces.skin]
type = "tube"
bodies = ["flap"]

[surfaces.floor]                  # 5 mm below the link
type = "plane"
position = ["0 mm", "0 mm", "-10 mm"]

[contacts.press]
first = "skin"
second = "floor"
stiffness = "20 kN/m"
damping = "5 s/m"

[actuators.torque]
type = "joint_torque"
body = "flap"
range = ["-5 mN m", "5 mN m"]

[sensors.angle]
type = "joint_angle"
body = "flap"
estimated = true

[sensors.force]
type = "contact_force"
surface = "floor"

[cameras.side]
centre = ["25 mm", "0 mm"]
pixel = "1 mm"
"""


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    def file(stiffness: float, damping: float, **changed: str) -> Path:
        text = FLAPPER.format(stiffness=stiffness, damping=damping)
        for old, new in changed.values():
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "flapper.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return file


def system_of(path: Path) -> System:
    return build(describe(read_system_file(path)))


def test_a_link_swings_as_a_damped_oscillator(write: Callable[..., Path]) -> None:
    """A torque that is put on at once: I θ'' + c θ' + k θ = τ, upwards, away from the floor."""
    k, c, torque = 0.05, 2e-4, -0.004
    system = system_of(write(k, c * 1e3))
    found = simulate_motion(system, np.array([[torque], [torque]]), np.array([0.0, 0.4]), 0.01)
    np.testing.assert_allclose(found.times, np.arange(41) / 100, atol=1e-15)
    decay, natural = c / (2 * INERTIA), k / INERTIA
    turning = np.sqrt(natural - decay**2)
    t = found.times
    envelope = np.exp(-decay * t) * (np.cos(turning * t) + decay / turning * np.sin(turning * t))
    # The tolerance of a step, 1e-9 m, is 4e-8 rad at the mass; there are some hundred steps.
    np.testing.assert_allclose(found.observation.readings[:, 0], torque / k * (1 - envelope), atol=4e-6)
    energies = found.trajectories
    total = energies.kinetic + energies.potential + energies.dissipated - energies.supplied
    np.testing.assert_allclose(total, 0, atol=1e-4 * float(energies.kinetic.max()))
    assert energies.dissipated[-1] > energies.kinetic.max()


def test_a_link_bounces_off_a_damped_floor(write: Callable[..., Path]) -> None:
    """Hunt and Crossley's restitution: d v (1 + e) = log((1 + d v)/(1 − d e v)), v: speed of approach."""
    system = system_of(write(1e-6, 0.0))
    # A push for 20 ms; the floor is 0.1 rad away.
    commands = np.array([[0.001], [0.001], [0.0], [0.0]])
    found = simulate_motion(system, commands, np.array([0.0, 0.02, 0.02, 0.12]), 0.004, EXACT)
    assert list(found.times).count(0.02) == 2  # before and after the push ends
    speed = found.trajectories.velocity[:, 0]
    force = found.observation.readings[:, 1]
    at = np.sin(found.observation.readings[:, 0]) * LENGTH
    np.testing.assert_allclose(speed[found.times == 0.02], 0.001 * 0.02 / INERTIA, rtol=1e-4)
    coming = np.flatnonzero((found.times > 0.02) & (speed > 0) & (at < 0.0045))[-1]
    going = np.flatnonzero((speed < 0) & (force == 0))[0]
    # Of the link's end where it touches; the soft spring changes the angular speed by 1e-5 of it.
    d, v = 5.0, speed[coming] * LENGTH * np.cos(0.1)
    exact = brentq(lambda e: d * v * (1 + e) - np.log((1 + d * v) / (1 - d * e * v)), 0.1, 0.999)
    assert isinstance(exact, float)
    # The link is not a point: its end moves on an arc, over 0.05 mm of overlap.
    assert -speed[going] / speed[coming] == pytest.approx(exact, rel=2e-3)
    assert exact < 0.85


def test_a_motion_on_the_command_line(
    write: Callable[..., Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = ["--u", "-0.004", "0", "--time", "0.05", "0.1", "--motion", "0.02"]
    path = str(write(0.05, 0.2))
    main(["simulate", "--system", path, *words, "--json", "-"])
    records = json.loads(capsys.readouterr().out)["path"]
    assert [record["time"] for record in records] == [0.0, 0.02, 0.04, 0.05, 0.06, 0.08, 0.1]
    torques = [record["commands"]["torque"] for record in records]
    np.testing.assert_allclose(torques, [0.0, -0.0016, -0.0032, -0.004, -0.0032, -0.0016, 0.0], atol=1e-15)
    assert all(record["converged"] and record["energies"]["kinetic"] >= 0 for record in records)
    plot = tmp_path / "motion.svg"
    main(["simulate", "--system", path, *words, "--plot", str(plot)])
    assert "Motion of flapper" in capsys.readouterr().out
    assert "angle" in plot.read_text(encoding="utf-8")


def test_motions_that_are_none_are_refused(
    write: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    system = system_of(write(0.05, 0.2))
    still, times = np.zeros((2, 1)), np.array([0.0, 1.0])
    for period in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="motion: expected a finite period above 0 s between reports"):
            simulate_motion(system, still, times, period)
    with pytest.raises(InputError, match="at most 100000 reports, got 1 s in steps of 1e-06 s; choose a lo"):
        simulate_motion(system, still, times, 1e-6)
    with pytest.raises(InputError, match="time: expected a motion that ends after 0 s"):
        simulate_motion(system, still, np.zeros(2), 0.1)
    with pytest.raises(InputError, match="time: expected one for each of the 2 commands, got 1"):
        simulate_motion(system, still, times[:1], 0.1)
    with pytest.raises(InputError, match="motion: no finite acceleration at the start: some coordinate mov"):
        simulate_motion(system_of(write(0.05, 0.2, mass=("20 g", "0 g"))), still, times, 0.1)
    with pytest.raises(SystemExit):
        main(["simulate", "--system", str(write(0.05, 0.2)), "--u", "0", "--motion", "0.1"])
    assert "--motion: expected --time with it" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"contacts.press.damping: expected a damping of a contact in s/m"):
        system_of(write(0.05, 0.2, unit=("5 s/m", "5 N s/m")))
