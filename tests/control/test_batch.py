"""Many plants at once: each is the simulated plant of its own exosuit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from exosight.control import CONTROL_SHAPE
from exosight.control.batch import BatchPlant, Joints
from exosight.control.simulated import SimulatedPlant
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published
from exosight.vision import Camera, resized

CAMERA = resized(Camera(), 48, 32)
EXOSUITS = [
    Exosuit(CONTROL_SHAPE, young=young, gap=gap) for young, gap in ((300e3, 0.0), (260e3, 0.0005))
] * 5
SYSTEMS = [published(exosuit, CAMERA) for exosuit in EXOSUITS]
PATHS = np.array([[0.4, 0.43, 3.1, 2.6], [0.0, 1.0, 2.5, -0.3]] * 5)  # N; the first snaps, and comes back
# Strains up to 1; the solver stops at 1e-10 relative, divided by the smallest eigenvalue, above 0.1 here.
NEAR = 1e-7


@pytest.fixture(scope="module")
def plants() -> BatchPlant:
    return BatchPlant(SYSTEMS)


def test_each_plant_is_the_simulated_plant_of_its_exosuit(plants):
    alone = [SimulatedPlant(system) for system in SYSTEMS[:2]]
    for one in alone:
        one.reset()
    plants.reset()
    for u in PATHS.T:
        state = plants.step(u[:, None])
        pictures = plants.pictures()
        assert state.converged.all()
        np.testing.assert_array_equal(state.commands[:, 0], u)
        for i, one in enumerate(alone):
            seen = one.apply(u[i : i + 1])
            np.testing.assert_allclose(state.q[i::2], np.tile(seen.q, (5, 1)), atol=NEAR)
            np.testing.assert_allclose(state.readings[i::2], np.tile(seen.readings, (5, 1)), atol=NEAR)
            # A gray value may round the other way.
            assert np.abs(pictures[i].astype(int) - seen.image).max() <= 1


def test_pictures_of_some_are_those_of_all(plants):
    plants.reset()
    plants.step(PATHS[:, 2:3])
    np.testing.assert_array_equal(plants.pictures(CAMERA, np.array([3, 1])), plants.pictures(CAMERA)[[3, 1]])


def test_some_can_be_reset_while_the_others_stay(plants):
    plants.reset()
    before = plants.step(PATHS[:, 2:3])
    which = np.arange(len(plants)) % 3 == 0
    after = plants.reset(which)
    np.testing.assert_array_equal(after.commands[:, 0], np.where(which, 0.0, before.commands[:, 0]))
    np.testing.assert_array_equal(after.q[~which], before.q[~which])
    np.testing.assert_allclose(after.reading("F_net")[which], 0.0, atol=NEAR)
    again = plants.step(before.commands)
    np.testing.assert_allclose(again.readings, before.readings, atol=NEAR)


def test_a_slack_finger_flexes_by_itself_to_where_its_springs_rest(plants):
    """Unloaded, no joint feels a moment: q = rest."""
    plants.reset()
    own = plants.resting
    rest = np.tile([0.2, 0.15, 0.1], (len(plants), 1))
    state = plants.step(np.zeros((len(plants), 1)), Joints(own.stiffness, rest))
    angles = np.stack([state.reading(f"angle_{i}") for i in (1, 2, 3)], axis=1)
    np.testing.assert_allclose(angles, rest, atol=NEAR)
    assert state.converged.all()


def test_stiffer_joints_are_those_of_a_stiffer_finger(plants):
    plants.reset()
    own = plants.resting
    state = plants.step(np.full((len(plants), 1), 1.2), Joints(1.3 * own.stiffness, own.rest))
    finger = EXOSUITS[0].finger
    stiff = replace(finger, joint_stiffness=tuple(1.3 * k for k in finger.joint_stiffness))
    alone = SimulatedPlant(published(replace(EXOSUITS[0], finger=stiff), CAMERA))
    np.testing.assert_allclose(state.readings[0], alone.apply(np.array([1.2])).readings, atol=NEAR)
    # A reset gives everyone his own finger back.
    plants.reset()
    assert plants.step(np.full((len(plants), 1), 1.2)).reading("F_net")[0] < state.reading("F_net")[0]


@pytest.mark.parametrize("u", [math.nan, math.inf, 6.001])
def test_u_beyond_the_limits_is_refused_and_changes_nothing(plants, u):
    plants.reset()
    before = plants.step(PATHS[:, :1])
    wrong = PATHS[:, 1:2].copy()
    wrong[4] = u
    with pytest.raises(InputError, match="expected -6 to 6 N"):
        plants.step(wrong)
    np.testing.assert_allclose(plants.step(PATHS[:, :1]).q, before.q, atol=NEAR)


def test_bad_arguments_are_refused(plants):
    with pytest.raises(InputError, match="at least one system"):
        BatchPlant([])
    with pytest.raises(InputError, match="a row a plant"):
        plants.step(np.zeros((len(plants) - 1, 1)))
    plants.reset()
    own = plants.resting
    for wrong in (
        Joints(own.stiffness[:2], own.rest[:2]),
        Joints(-own.stiffness, own.rest),
        Joints(own.stiffness, own.rest + math.nan),
    ):
        with pytest.raises(InputError, match="joints"):
            plants.step(np.zeros((len(plants), 1)), wrong)
