"""A small rig as its file says, and a true one that differs from it."""

from pathlib import Path

import numpy as np
import pytest
from pictured_rig import COMMANDS, TRUTH, Pictured

from exosight.rig.identification.parameters import Prior, complete, parameters_of
from exosight.rig.identification.response import Model
from exosight.system.build import build
from exosight.system.file import Values, describe, read_system_file, replaced
from exosight.system.simulation import simulate_path
from exosight.vision.scene import picture


@pytest.fixture(scope="session")
def lever() -> Values:
    return complete(read_system_file(Path(__file__).parent / "lever.toml"))


@pytest.fixture(scope="session")
def model(lever: Values) -> Model:
    return Model(lever, parameters_of(lever, Prior(), known_gains=False))


@pytest.fixture(scope="session")
def pictured(lever: Values) -> Pictured:
    system = build(describe(replaced(lever, TRUTH)))
    states = simulate_path(system, COMMANDS)
    axes = {name: np.asarray(axis) for name, axis in states.observation.axes.items()}
    return Pictured(system, picture(system, axes), np.asarray(states.observation.readings[:, 0]))
