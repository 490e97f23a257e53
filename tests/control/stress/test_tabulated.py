"""Tabulated plants, on a table whose entries are known: forces in proportion to the command."""

from dataclasses import replace

import numpy as np
import pytest

from exosight.control.batch import Joints
from exosight.control.stress import StressConfig
from exosight.control.stress.episodes import Episode, draw_episode, joint_springs
from exosight.control.stress.plants import Creep, StressPlants
from exosight.control.stress.tabulated import ANGLES, FACTORS, ForceTable
from exosight.errors import InputError

PLAY = 0.5


@pytest.fixture(scope="module")
def table(plants: StressPlants) -> ForceTable:
    """Output i is u f (1 + θ) (i + 1), f the stiffness of the joints and θ their angle."""
    u = np.linspace(-1.0, 3.0, 41)
    outputs = np.einsum(
        "f,a,u,o->fauo", FACTORS, 1 + ANGLES, u, np.arange(1.0, len(plants.limits.weights) + 1)
    )
    share = joint_springs(plants.nominal)[1]
    return ForceTable((plants.nominal,), plants.limits, share, u, outputs[None], PLAY)


@pytest.fixture(scope="module")
def episode(plants: StressPlants) -> Episode:
    return draw_episode(StressConfig(wrong_plant=False, moving_user=False), 0, 0, plants)


def first(table: ForceTable, episodes: list[Episode], path: list[float], seconds: float = 0.1) -> np.ndarray:
    """The first output over a path of commands, a column an episode."""
    plant = table.plants(episodes)
    count = len(episodes)
    return np.array([plant.step(np.full((count, 1), u), seconds=seconds).outputs[:, 0] for u in path])


def test_it_is_the_table_between_and_at_its_entries(table: ForceTable, episode: Episode) -> None:
    plant = table.plants([episode])
    own, share = joint_springs(episode.system)
    for factor, angle, u in ((FACTORS[2], ANGLES[1], 0.7), (FACTORS[1], 0.03, 1.234)):
        joints = Joints(factor * own[None], angle * share[None])
        found = plant.step(np.array([[u]]), joints).outputs[0]
        np.testing.assert_allclose(found, u * factor * (1 + angle) * np.arange(1, len(found) + 1), rtol=1e-12)


def test_creep_is_that_of_a_standard_linear_solid(table: ForceTable, episode: Episode) -> None:
    share, tau = 0.3, 0.8
    creeping = replace(episode, creep=Creep(share, tau))
    found = first(table, [creeping], [2.0] * 30)[:, 0]
    time = 0.1 * np.arange(1, 31)  # the table is linear, so its factor does not matter
    exact = 2.0 * (1 - share * np.exp(-time * (1 - share) / tau))
    np.testing.assert_allclose(found / FACTORS[1], exact * found[-1] / FACTORS[1] / exact[-1], rtol=1e-12)


def test_friction_holds_what_is_between_its_limits(table: ForceTable, episode: Episode) -> None:
    rough = replace(episode, friction=0.4)  # κμ = 0.2
    smooth, found = first(table, [episode, rough], [1.2, 2.4, 2.0, 1.5, 1.2, 2.0, 0.0, -1.0]).T
    unit = smooth[0] / 1.2
    np.testing.assert_allclose(smooth / unit, [1.2, 2.4, 2.0, 1.5, 1.2, 2.0, 0.0, -1.0], atol=1e-12)
    # Up: u/1.2; held until u/0.8 is below it, then down with u/0.8; a command of 0 always lets go.
    np.testing.assert_allclose(found / unit, [1.0, 2.0, 2.0, 1.875, 1.5, 5 / 3, 0.0, -1 / 1.2], atol=1e-12)


def test_another_system_and_pictures_are_refused(table: ForceTable, episode: Episode) -> None:
    with pytest.raises(InputError, match="systems in the table"):
        table.plants([replace(episode, system=replace(episode.system))])
    with pytest.raises(InputError, match="no pictures"):
        table.plants([episode]).pictures()
