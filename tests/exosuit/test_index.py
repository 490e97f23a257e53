"""The system `index`: surfaces in contact as they are, beside `published`."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from exosight.dataset.simulation import crosses_itself
from exosight.exosuit.index import index
from exosight.exosuit.published import published
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.mechanics import walk
from exosight.system.observation import contact_forces
from exosight.system.schema import difference
from exosight.system.simulation import SystemStates, simulate_path
from exosight.system.system import System

SHAPE = ExosuitShape(Linear(r0=0.01, r1=0.005), length=0.095)
UP = np.linspace(0, 4, 21)


@pytest.fixture(scope="module")
def system() -> System:
    """The controller's exosuit."""
    return index(SHAPE)


@pytest.fixture(scope="module")
def path(system: System) -> SystemStates:
    """Actuated 0 → 4 → 0 N."""
    return simulate_path(system, np.concatenate([UP, UP[-2::-1]])[:, None])


def test_its_schema_is_that_of_the_published_system_but_for_visibility(system: System) -> None:
    ours, theirs = system.schema, published(SHAPE).schema
    assert difference(theirs, ours) == "camera camera: expected visibility stacked, got depth"
    (seen,) = theirs.cameras
    assert difference(replace(theirs, cameras=(replace(seen, visibility="depth"),)), ours) is None


def test_net_force_is_that_of_another_program(path: SystemStates, system: System) -> None:
    """A separate implementation, points with the nearest of four rounded cones, 1000 N/m each: 0.188 N."""
    net = path.observation.readings[12, [s.name for s in system.schema.sensors].index("F_net")]
    assert path.commands[12] == pytest.approx(2.4)
    # It pressed a third harder a depth and knew no fillet; depths are some 0.1 mm of a lever of 50 mm.
    assert net == pytest.approx(0.188, abs=0.001)


def test_zones_sum_to_what_the_exosuit_presses_with(path: SystemStates, system: System) -> None:
    q = jnp.asarray(path.equilibria.q[20])
    on = contact_forces(system, system.robot, walk(system.robot, q))
    pressed = np.asarray(on["finger"].force)
    np.testing.assert_allclose(path.observation.forces[20].sum(axis=0), pressed.sum(axis=0), atol=1e-13)
    assert np.linalg.norm(pressed.sum(axis=0)) > 0.3
    # The exosuit pushes on the finger and, with opposite forces on itself, on nothing else.
    np.testing.assert_allclose(np.asarray(on["exosuit"].force).sum(axis=0), -pressed.sum(axis=0), atol=1e-13)


def test_a_way_that_returns_gives_its_energy_back(path: SystemStates) -> None:
    """Up to the first snap on the way up, and from the last one on the way down, all is stored."""
    snaps, energy = np.flatnonzero(path.equilibria.snapped), path.equilibria.energy
    loads = np.arange(1, min(snaps[0], len(UP)))
    loads = loads[2 * len(UP) - 2 - loads >= snaps[-1]]
    assert len(loads) >= 5
    # The solver's tolerance of a pose is 1e-10, and energy is flat there.
    np.testing.assert_allclose(energy[2 * len(UP) - 2 - loads], energy[loads], rtol=1e-9)


def test_the_exosuit_does_not_cross_itself(path: SystemStates) -> None:
    assert path.equilibria.converged.all()
    assert not crosses_itself(np.asarray(path.observation.axes["exosuit"])).any()
