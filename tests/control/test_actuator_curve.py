"""Calibrations of actuators: tables that are taken, and what is none."""

from pathlib import Path

import numpy as np
import pytest
from toy import CHANNEL

from exosight.control.actuator_curve import ActuatorCurve, read_actuator_curve, within_curve
from exosight.control.tuning import tune
from exosight.errors import InputError
from exosight.exosuit.published import published
from exosight.system.schema import Channel


def _table(folder: Path, text: str) -> Path:
    (folder / "valve.csv").write_text(text)
    return folder / "valve.csv"


def test_a_table_gives_the_command_of_a_load(tmp_path: Path) -> None:
    curve = read_actuator_curve(
        _table(tmp_path, "pressure [kPa],u [mN]\n10,0\n50,2000\n20,400\n80,4000\n"), CHANNEL
    )
    assert (curve.name, curve.unit) == ("pressure", "kPa")
    np.testing.assert_array_equal(curve.load, [0, 0.4, 2, 4])  # rows in any order, in newtons
    for load, command in ((0.0, 10), (0.2, 15), (0.4, 20), (3.0, 65), (4.0, 80)):
        assert curve.at(load) == pytest.approx(command, rel=1e-12)
    for beyond in (-0.1, 4.1):
        with pytest.raises(InputError, match="expected a load of 0 to 4"):
            curve.at(beyond)


def test_a_command_may_fall_with_the_load(tmp_path: Path) -> None:
    """A vacuum: less pressure, more load."""
    curve = read_actuator_curve(_table(tmp_path, "u [N];vacuum [kPa]\n0;100,5\n1;60\n2;40\n"), CHANNEL)
    assert curve.at(1.5) == pytest.approx(50)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("pressure [kPa],load [N]\n0,0\n1,1\n", "expected two columns"),
        ("pressure [kPa],u [N],note\n0,0,a\n1,1,b\n", "expected two columns"),
        ("pressure,u [N]\n0,0\n1,1\n", "column pressure has no unit"),
        ("pressure [kPa],u [kPa]\n0,0\n1,1\n", "expected a load in N, got kPa"),
        ("pressure [kPa],u [N]\n0,0\n", "expected two points or more"),
        ("pressure [kPa],u [N]\n0,0\n,1\n", "got an empty one"),
        ("pressure [kPa],u [N]\n0,0\n1,x\n", "got 'x' in row 2"),
        ("pressure [kPa],u [N]\n0,0\n10,1\n20,0.9\n30,2\n", "expected a load that rises, or falls"),
        ("pressure [kPa],u [N]\n0,0\n10,1\n20,1\n", "expected a load that rises, or falls"),
        ("pressure [kPa],u [N]\n10,1\n20,2\n", "expected the load 0 within the curve"),
    ],
)
def test_what_is_no_calibration_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        read_actuator_curve(_table(tmp_path, text), CHANNEL)


def test_a_controller_stays_within_the_curve() -> None:
    curve = ActuatorCurve("pressure", "kPa", np.array([0.0, 1.5]), np.array([0.0, 30.0]))
    system = published()
    config = tune(within_curve(system, "u", curve))
    assert config.unloading.u.min() >= 0
    assert config.loading.u.max() <= 1.5
    own = system.schema.channel("u")
    assert config.driven == Channel("u", own.unit, 0.0, 1.5, own.rate, 1.5)
    falling = ActuatorCurve("pull", "V", np.array([-1.0, 0.0]), np.array([0.0, 30.0]))
    with pytest.raises(InputError, match="loads above 0 N in the curve"):
        within_curve(system, "u", falling)
