"""The published system is the robot that the paper's exosuit assembles to."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.exosuit.assembly import ROD, Exosuit, assemble
from exosight.exosuit.published import PublishedDesigns, published
from exosight.exosuit.variation import PlantVariation
from exosight.mechanics import Robot, SphereContact, drive, walk
from exosight.mechanics.kinematics import Motion
from exosight.system.designs import DesignSet
from exosight.system.observation import Observation, observe_state
from exosight.system.system import stack_systems

LOADS = np.array([[0.0], [1.0], [2.4], [4.0]])


def test_equilibria_and_readings_are_those_of_the_robot() -> None:
    exosuit = Exosuit()
    system, robot = published(exosuit), assemble(exosuit)
    ours, theirs = drive([system.robot], LOADS), drive([robot], LOADS)
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-12)
    (contact,) = (term for term in robot.terms if isinstance(term, SphereContact))

    @eqx.filter_jit
    def read(robot: Robot, q: jax.Array) -> tuple[Observation, Motion, jax.Array]:
        motion = walk(robot, q)
        return observe_state(system, q), motion, contact.forces(robot, motion.position)[1]

    for q in jnp.asarray(ours.q[0]):
        observed, motion, pushes = read(robot, q)
        forces = np.linalg.norm(pushes, axis=-1)
        expected = [*forces, forces[1:].sum(), *q[-3:]]  # C0 … C7, F_net, angle_1 … angle_3
        np.testing.assert_allclose(observed.readings, expected, atol=1e-12)
        np.testing.assert_allclose(observed.forces, pushes, atol=1e-12)
        places = motion.position[np.array(contact.second.index(robot))]
        np.testing.assert_allclose(observed.places, places, atol=1e-12)
        axis = motion.position[robot.frame_slice(ROD)]
        np.testing.assert_allclose(observed.axes["exosuit"], axis, atol=1e-12)
        np.testing.assert_allclose(observed.axes["finger"][-1], motion["finger_3"].end[:3, 3], atol=1e-12)


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
