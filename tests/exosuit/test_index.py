"""The system `index`: surfaces in contact as they are, beside `published`."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.balance import lost

from exosight.dataset.simulation import crosses_itself
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index, index_friction
from exosight.exosuit.published import published
from exosight.exosuit.scenarios import sample_shapes
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.mechanics import Robot, drive, walk
from exosight.system.observation import contact_forces, observe
from exosight.system.schema import difference
from exosight.system.sensors import SurfaceForces
from exosight.system.simulation import SystemStates, simulate_path
from exosight.system.system import System, stack_systems

SHAPE = ExosuitShape(Linear(r0=0.01, r1=0.005), length=0.095)
UP = np.linspace(0, 4, 21)


@eqx.filter_jit
def forces(system: System, robot: Robot, q: jax.Array) -> dict[str, SurfaceForces]:
    """On every surface."""
    return contact_forces(system, robot, walk(robot, q))


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
    on = forces(system, system.robot, q)
    pressed = np.asarray(on["finger"].force)
    np.testing.assert_allclose(path.observation.forces[20].sum(axis=0), pressed.sum(axis=0), atol=1e-13)
    assert np.linalg.norm(pressed.sum(axis=0)) > 0.3
    # The exosuit pushes on the finger and, with opposite forces on itself, on nothing else.
    np.testing.assert_allclose(np.asarray(on["exosuit"].force).sum(axis=0), -pressed.sum(axis=0), atol=1e-13)


def test_a_way_that_returns_gives_its_energy_back(path: SystemStates) -> None:
    """The controller's exosuit does not snap on the smooth finger, so all is stored."""
    assert not path.equilibria.snapped.any()
    energy, loads = path.equilibria.energy, np.arange(1, len(UP))
    # The solver's tolerance of a pose is 1e-10, and energy is flat there.
    np.testing.assert_allclose(energy[2 * len(UP) - 2 - loads], energy[loads], rtol=1e-9)


def test_the_exosuit_does_not_cross_itself(path: SystemStates) -> None:
    assert path.equilibria.converged.all()
    assert not crosses_itself(np.asarray(path.observation.axes["exosuit"])).any()


@pytest.fixture(scope="module")
def rough() -> System:
    """With friction."""
    return index_friction(SHAPE)


def test_friction_holds_what_it_can_and_loses_energy(rough: System) -> None:
    """Up to 2.4 N and back to 1.2 N: no more than μ of what presses, and more force on the way back."""
    way = np.concatenate([UP[:13], UP[11:5:-1]])
    states = simulate_path(rough, way[:, None])
    found, seen = states.equilibria, states.observation
    names = [sensor.name for sensor in rough.schema.sensors]
    net = seen.readings[:, names.index("F_net")]
    assert net[14] > net[10] + 0.005  # both at 2 N
    assert way[14] == pytest.approx(way[10])
    mu, (press, _) = 0.3, rough.contacts
    assert press.friction == pytest.approx(mu)
    (memory,) = found.history
    rubbed = lost(found.history)
    assert (np.diff(rubbed) >= -1e-15).all()
    assert rubbed[-1] > 1e-4
    robot = rough.robot.with_memories((memory[12],))
    on = forces(rough, robot, jnp.asarray(found.q[12]))["finger"]
    held = np.linalg.norm(on.part("tangential"), axis=1).sum()
    assert 0.5 * mu < held / np.linalg.norm(on.normal, axis=1).sum() <= mu * (1 + 1e-9)
    np.testing.assert_allclose(seen.forces[12].sum(axis=0), np.asarray(on.force).sum(axis=0), atol=1e-13)
    with pytest.raises(InputError, match="history: expected 1 arrays"):
        observe(stack_systems([rough]), found.q[None, :1])


@pytest.mark.parametrize("number", [86, 109])
def test_points_that_slip_one_after_the_other_are_no_end_of_a_branch(number: int) -> None:
    """These exosuits bend without a snap: what the load supplies is stored or rubbed away, to 1.6e-5."""
    shape = sample_shapes(10, seed=0)[number].shape
    found = drive([index_friction(Exosuit(shape, friction=0.3)).robot], np.linspace(0, 4, 51)[:, None])
    assert found.converged.all()
    assert not found.snapped.any()
    energy, supplied = (of[0] - of[0, 0] for of in (found.energy, found.supplied))
    kept_or_lost = energy + lost(found.history)[0]
    np.testing.assert_allclose(kept_or_lost, supplied, rtol=0, atol=2e-5 * abs(float(supplied[-1])))


def test_without_a_coefficient_friction_does_nothing(path: SystemStates) -> None:
    smooth = simulate_path(index_friction(Exosuit(SHAPE, friction=0.0)), UP[:13, None])
    # Branches end where they do to 1e-4 of the forces with friction, and loads below are reached by Newton.
    np.testing.assert_allclose(smooth.equilibria.q, path.equilibria.q[:13], atol=1e-8)


def test_a_closest_place_is_found_where_the_distance_has_no_curvature() -> None:
    """They press on themselves where the distance from the tip hardly changes along it. Newton's method goes
    anywhere from there: the energy had steps, and a descent no end. 36 loads of these four were all that did
    not converge of 1,375 exosuits."""
    shapes = sample_shapes(125, seed=41)
    robots = [index(shapes[number].shape).robot for number in (902, 941, 1262, 1365)]
    found = drive(robots, np.linspace(0, 4, 51)[:, None])
    assert found.converged.all()
    assert found.iterations.max() < 1000
