"""The published system is the robot that the paper's exosuit assembles to."""

import numpy as np
import pytest

from exosight.exosuit.assembly import Exosuit, assemble
from exosight.exosuit.assembly import observe as observe_pose
from exosight.exosuit.published import PublishedDesigns, published
from exosight.exosuit.variation import PlantVariation
from exosight.mechanics import drive, stack
from exosight.system.designs import DesignSet
from exosight.system.observation import observe
from exosight.system.system import stack_systems

LOADS = np.array([[0.0], [1.0], [2.4], [4.0]])


def test_equilibria_and_readings_are_those_of_the_robot() -> None:
    exosuit = Exosuit()
    system, robot = published(exosuit), assemble(exosuit)
    ours, theirs = drive([system.robot], LOADS), drive([robot], LOADS)
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-12)
    seen, pose = observe(stack_systems([system]), ours.q), observe_pose(stack([robot]), theirs.q)
    names = [sensor.name for sensor in system.schema.sensors]
    at = {name: np.asarray(seen.readings)[0, :, i] for i, name in enumerate(names)}
    forces = np.stack([at[f"C{i}"] for i in range(8)], axis=-1)
    np.testing.assert_allclose(forces, np.asarray(pose.forces)[0], atol=1e-12)
    np.testing.assert_allclose(at["F_net"], np.asarray(pose.net_force)[0], atol=1e-12)
    angles = np.stack([at[f"angle_{i}"] for i in (1, 2, 3)], axis=-1)
    np.testing.assert_allclose(angles, np.asarray(pose.joint_angles)[0], atol=1e-12)
    np.testing.assert_allclose(seen.places, pose.spheres, atol=1e-12)
    np.testing.assert_allclose(seen.axes["exosuit"], pose.centreline, atol=1e-12)
    np.testing.assert_allclose(seen.axes["finger"], pose.finger, atol=1e-12)


def test_designs_are_drawn_by_seed_and_number_and_share_a_schema() -> None:
    designs = PublishedDesigns(variation=PlantVariation(young=(0.5, 2.0)))
    assert isinstance(designs, DesignSet)
    drawn = designs.draw(2, seed=3)
    assert drawn == designs.draw(2, seed=3)
    assert [design.number for design in drawn] == list(range(22))
    assert designs.build(drawn[-1]).schema == designs.schema
    stack_systems([designs.build(design) for design in drawn[:4]])


@pytest.mark.parametrize("per_scenario", [1, 3])
def test_each_scenario_has_as_many(per_scenario: int) -> None:
    designs = PublishedDesigns()
    drawn = designs.draw(per_scenario, seed=0)
    counts = np.bincount([design.scenario for design in drawn])
    assert list(counts) == [per_scenario] * len(designs.scenarios)
