"""Viscoelastic rods of system files: they creep and relax as a standard linear solid does."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from creeping_bar import BAR, GAP, LENGTH, RATIO, RIGIDITY, STIFFNESS, TAU

from exosight.app.main import main
from exosight.errors import InputError
from exosight.system import describe, read_system_file
from exosight.system.build import build
from exosight.system.simulation import SystemStates, simulate_path, simulate_system
from exosight.system.system import System


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "bar.toml"
    file.write_text(BAR, encoding="utf-8")
    return file


@pytest.fixture
def bar(path: Path) -> System:
    return build(describe(read_system_file(path)))


def stretch(states: SystemStates) -> np.ndarray:
    """By how much the bar is longer [m]."""
    return states.observation.axes["bar"][:, -1, 0] - LENGTH


def test_a_rod_of_a_file_creeps_as_a_standard_linear_solid(bar: System) -> None:
    """F/EA · (1 − c/(1 + c) e^(−t/τ(1 + c))), c: the ratio; at once by its whole modulus, then to `young`."""
    times = np.array([0.0, 0.0, 0.5, 3.0, 30.0, 1000.0])
    commands = np.array([0.0, *np.full(5, 0.4)])[:, None]
    found = simulate_path(bar, commands, times=times)
    exact = 0.4 * LENGTH / RIGIDITY * (1 - RATIO / (1 + RATIO) * np.exp(-times[1:] / (TAU * (1 + RATIO))))
    # The steps between the times, see `simulation.FINENESS`.
    np.testing.assert_allclose(stretch(found)[1:], exact, rtol=5e-6)
    # In two parts.
    first = simulate_path(bar, commands[:3], times=times[:3])
    second = simulate_path(bar, commands[3:], first.state(bar, 2), times[3:])
    np.testing.assert_allclose(stretch(second), stretch(found)[3:], rtol=1e-9)
    # Loads that change infinitely slowly meet the modulus that is left.
    slow = simulate_system(bar, commands[-1:])
    np.testing.assert_allclose(stretch(slow), 0.4 * LENGTH / RIGIDITY, rtol=1e-9)


def test_the_force_of_a_held_rod_relaxes_on_the_command_line(
    path: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Behind a gap g a stiff stop of k holds the bar: k x + K (x + c h) = u + k g, with h' = x' − h/τ."""
    plot, times = tmp_path / "path.png", ["0", "0", "1", "4", "500"]
    words = ["--u", "0", "2.5", "2.5", "2.5", "2.5", "--time", *times, "--plot", str(plot)]
    main(["simulate", "--system", str(path), *words, "--json", "-"])
    records = json.loads(capsys.readouterr().out)["path"]
    assert [record["time"] for record in records] == [float(time) for time in times]
    own, pushed = RIGIDITY / LENGTH, 2.5 + STIFFNESS * GAP
    still = own * RATIO / (own + STIFFNESS)
    # It comes to the stop under part of the load, which changes nothing where no time passes.
    h0 = pushed / (own * (1 + RATIO) + STIFFNESS)
    h = h0 * np.exp(-np.array([float(time) for time in times[1:]]) / (TAU * (1 + still)))
    exact = STIFFNESS * ((pushed - own * RATIO * h) / (own + STIFFNESS) - GAP)
    found = [record["readings"]["force"] for record in records]
    assert found[0] == 0
    # What relaxes presses on the stop: 1.53 N at once, 1.91 N in the end.
    np.testing.assert_allclose(found[1:], exact, rtol=5e-6)
    assert plot.stat().st_size > 1000


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 1.0], "time: expected one for each of the 3 commands, got 2; repeat a command that is held"),
        ([0.0, 2.0, 1.0], "time: expected finite times [s] from 0 s on that never fall, got 0, 2, 1"),
        ([-1.0, 2.0, 3.0], "time: expected finite times [s] from 0 s on that never fall, got -1, 2, 3"),
        ([0.0, 1.0, np.inf], "time: expected finite times [s] from 0 s on that never fall, got 0, 1, inf"),
    ],
)
def test_times_that_are_no_path_are_refused(times: list[float], message: str, bar: System) -> None:
    with pytest.raises(InputError) as refused:
        simulate_path(bar, np.zeros((3, 1)), times=np.array(times))
    assert str(refused.value) == message


def test_times_without_effect_are_refused(system: Callable[..., System]) -> None:
    with pytest.raises(InputError, match="no rod of small relaxes, so times have no effect; leave them out"):
        simulate_path(system(), np.zeros((1, 1)), times=np.array([0.0]))
