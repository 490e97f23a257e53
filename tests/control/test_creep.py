"""Plants whose rods relax, one alone and many, against the solution of a standard linear solid."""

import numpy as np
import pytest
from creeping_bar import BAR, LENGTH, RIGIDITY, SHARE, TAU

from exosight.control.batch import BatchPlant
from exosight.control.simulated import SimulatedPlant
from exosight.errors import InputError
from exosight.system import describe, read_system_file
from exosight.system.build import build
from exosight.system.system import System

PERIOD = 0.1
COMPLIANCE = LENGTH / RIGIDITY
"""Of the rod after long times [m/N]."""


@pytest.fixture(scope="module")
def bar(tmp_path_factory: pytest.TempPathFactory) -> System:
    file = tmp_path_factory.mktemp("bar") / "bar.toml"
    file.write_text(BAR, encoding="utf-8")
    return build(describe(read_system_file(file)))


def crept(load: float, steps: int) -> np.ndarray:
    """By how much the rod is longer at the end of each step [m], whose load rose evenly in the first one and
    rests: the mean over a period of J(t) = J∞ (1 − g e^(−t (1 − g)/τ))."""
    end = PERIOD * np.arange(1, steps + 1)
    rate = (1 - SHARE) / TAU
    past = np.maximum(end - PERIOD, 0.0)
    mean = (np.exp(-rate * past) - np.exp(-rate * end)) / rate / PERIOD
    return load * COMPLIANCE * (1 - SHARE * mean)


def test_one_alone_and_many_creep_as_the_equation_has_it(bar: System) -> None:
    loads, steps = np.array([0.4, 0.2, 0.3]), 20
    alone, many = SimulatedPlant(bar, PERIOD), BatchPlant([bar] * 3)
    for again in range(2):
        alone.reset()
        seen = np.array([alone.apply(loads[:1]).q[0] for _ in range(steps)])
        states = [many.step(loads[:, None], seconds=PERIOD) for _ in range(steps)]
        found = np.array([state.axes["bar"][:, -1, 0] for state in states]) - LENGTH
        exact = np.stack([crept(load, steps) for load in loads], axis=1)
        # A step of x = 0.05 relaxation times: the strains are of second order, x²/12 of what creeps.
        np.testing.assert_allclose(found, exact, rtol=2e-4)
        np.testing.assert_allclose([state.q[0, 0] for state in states], seen, rtol=1e-9)
        # A reset forgets, and its time begins anew.
        many.reset()
        assert again or np.abs(many.state.q).max() < 1e-9


def test_a_step_of_no_time_relaxes_nothing(bar: System) -> None:
    plant = BatchPlant([bar])
    load = np.array([[0.4]])
    at_once = plant.step(load, seconds=0.0).axes["bar"][0, -1, 0] - LENGTH
    assert at_once == pytest.approx(0.4 * COMPLIANCE * (1 - SHARE), rel=1e-9)  # the solver's tolerance
    assert plant.step(load, seconds=0.0).axes["bar"][0, -1, 0] - LENGTH == pytest.approx(at_once, rel=1e-9)
    assert plant.step(load, seconds=1.0).axes["bar"][0, -1, 0] - LENGTH > 1.05 * at_once
    with pytest.raises(InputError, match="at least 0 s"):
        plant.step(load, seconds=-0.1)
