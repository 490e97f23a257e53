"""Systems made of files move, push and weigh as mechanics says."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled import walk
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from exosight.errors import InputError
from exosight.mechanics import PressureLine, Rod, drive
from exosight.mechanics.rod import STRAINS
from exosight.system.build_sensors import ZONES_APART
from exosight.system.description import Strain
from exosight.system.observation import Observation, contact_forces, observe_state
from exosight.system.sensors import PlaceZone, SurfaceForces
from exosight.system.simulation import simulate_system
from exosight.system.surfaces import SphereSurface
from exosight.system.system import System

Make = Callable[..., System]

RANGE = 'range = ["-2 N", "4 N"]'
MOUNT = 'position = ["0 mm", "0 mm", "15 mm"]'


@eqx.filter_jit
def pressed(system: System, q: jax.Array) -> tuple[Observation, dict[str, SurfaceForces]]:
    """What is seen, and the forces on every surface."""
    return observe_state(system, q), contact_forces(system, system.robot, walk(system.robot, q))


def test_strains_of_a_file_are_those_of_rods() -> None:
    assert Strain.__args__ == STRAINS


def test_links_move_by_closed_form_kinematics(system: Make) -> None:
    small = system()
    robot = small.robot
    q = np.zeros(robot.dofs)
    a, b = 0.4, -0.7
    q[robot.dof_slice("base")], q[robot.dof_slice("tip")] = a, b
    pads = next(each for each in small.surfaces if each.name == "pads")
    assert isinstance(pads, SphereSurface)
    found = np.asarray(walk(robot, jnp.asarray(q)).position)[list(pads.spheres.index(robot))]
    # A positive angle about y turns x towards −z.
    along, then = np.array([np.cos(a), 0, -np.sin(a)]), np.array([np.cos(a + b), 0, -np.sin(a + b)])
    expected = [0.02 * along, 0.04 * along, 0.04 * along + 0.015 * then, 0.04 * along + 0.03 * then]
    np.testing.assert_allclose(found, expected, atol=1e-15)
    np.testing.assert_allclose(pads.spheres.radius, [0.009, 0.008, 0.007, 0.006], rtol=1e-12)


def test_rotation_vector_turns_the_base(system: Make) -> None:
    vector = np.deg2rad([30.0, -20.0, 50.0])
    turned = system((MOUNT, f'{MOUNT}\nrotation = ["30 deg", "-20 deg", "50 deg"]'))
    pose = np.asarray(walk(turned.robot, jnp.zeros(turned.robot.dofs))["soft"].pose)
    rotation = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(pose[0, :3, :3], rotation, atol=1e-14)
    np.testing.assert_allclose(pose[-1, :3, 3], [0, 0, 0.015] + 0.08 * rotation[:, 0], atol=1e-14)


def test_a_cable_pulls_where_a_pressure_line_pushes(system: Make) -> None:
    line = simulate_system(system(), np.array([[-1.0]])).equilibria.q
    cable = system(('"pressure_line"', '"cable"'), ('"-2 N"', '"0 N"'))
    np.testing.assert_allclose(simulate_system(cable, np.array([[1.0]])).equilibria.q, line, atol=1e-12)


def test_a_pressure_with_its_gain_is_the_force_that_it_makes(system: Make) -> None:
    force = simulate_system(system(), np.array([[2.0]]))
    pressure = system((RANGE, 'range = ["0 kPa", "80 kPa"]\ngain = "0.05 N/kPa"'))
    assert pressure.schema.channels[0].unit == "kPa"
    found = simulate_system(pressure, np.array([[40.0]]))
    np.testing.assert_allclose(found.equilibria.q, force.equilibria.q, atol=1e-12)
    np.testing.assert_allclose(found.observation.readings, force.observation.readings, atol=1e-12)


@pytest.mark.parametrize(("joint", "coordinate"), [("revolute", 0), ("universal", 1), ("spherical", 2)])
def test_a_torque_turns_its_joint_by_its_spring(joint: str, coordinate: int, system: Make) -> None:
    torque = system(
        ('"pressure_line"\nbody = "soft"', f'"joint_torque"\nbody = "tip"\ncoordinate = {coordinate}'),
        (RANGE, 'range = ["-9 mN m", "9 mN m"]'),
        ('"revolute", stiffness = "0.03', f'"{joint}", stiffness = "0.03'),
        ('"joint_angle"\nbody = "tip"', f'"joint_angle"\nbody = "tip"\ncoordinate = {coordinate}'),
    )
    assert torque.schema.channels[0].unit == "N m"
    found = simulate_system(torque, np.array([[0.006]]))
    # Nothing touches: the angle is torque over stiffness.
    np.testing.assert_allclose(found.observation.readings[0], [0, 0, 0, 0.006 / 0.03], atol=1e-12)


def test_a_heavy_rod_sags_as_euler_and_bernoulli_say(system: Make) -> None:
    young, density, radius, length = 3e9, 1000.0, 0.005, 0.08
    heavy = system(
        ("elements = 3\npoints_per_element = 4", ""),
        ('young = "300 kPa"', 'young = "3 GPa"\ndensity = "1000 kg/m^3"'),
        ('name = "small"', 'name = "small"\ngravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]'),
    )
    q = drive([heavy.robot], np.zeros((1, 1))).q[0, 0]
    tip = np.asarray(walk(heavy.robot, jnp.asarray(q))["soft"].pose)[-1, 2, 3] - 0.015
    area, second = np.pi * radius**2, np.pi * radius**4 / 4
    sag = density * area * 9.81 * length**4 / (8 * young * second)
    # The curvature is quadratic, which the basis holds, and slopes are 5e-5, so that small angles hold;
    # fourth-order steps between the 42 points leave 1e-7.
    np.testing.assert_allclose(-tip, sag, rtol=1e-6)


@pytest.mark.parametrize("load", [1.0, 2.0, 4.0])
def test_what_the_rod_feels_is_what_the_links_feel(system: Make, load: float) -> None:
    small = system()
    found = simulate_system(small, np.array([[load]]))
    seen, _ = pressed(small, jnp.asarray(found.equilibria.q[0]))
    motion = walk(small.robot, jnp.asarray(found.equilibria.q[0]))
    on_first, on_second = small.contact_terms[0].forces(small.robot, motion.position)
    np.testing.assert_allclose(on_first.sum(axis=0), -on_second.sum(axis=0), atol=1e-13)
    # Zones near and far share no sphere and hold all four, so their vectors sum to the reaction.
    np.testing.assert_allclose(np.asarray(seen.forces).sum(axis=0), on_second.sum(axis=0), atol=1e-13)
    near, far, total = np.asarray(seen.readings)[:3]
    np.testing.assert_allclose([near, far], np.linalg.norm(seen.forces, axis=-1), atol=1e-13)
    assert total == near + far
    assert load < 2 or total > 0.05


def test_zones_along_a_tube_share_the_whole_force(system: Make, tubes: list) -> None:
    """Their vectors sum to what the rod pushes back with, wherever between them it acts."""
    fold = '[contacts.fold]\nfirst = "soft_points"\nsecond = "soft_points"\n\n'
    small = system(*tubes, ("[actuators.u]", f"{fold}[actuators.u]"))
    assert [type(term).__name__ for term in small.contact_terms] == ["SolidContact", "TubeContact"]
    line = np.pi / 4 * 300e3 / 0.75
    np.testing.assert_allclose([c.stiffness for c in small.contacts], [line, line / 2], rtol=1e-12)
    found = simulate_system(small, np.array([[1.0], [4.0]]))
    assert found.equilibria.converged.all()
    for q, forces in zip(found.equilibria.q, found.observation.forces, strict=True):
        _, on = pressed(small, jnp.asarray(q))
        total = np.asarray(on["soft_points"].force).sum(axis=0)
        assert np.linalg.norm(total) > 0.01
        np.testing.assert_allclose(forces.sum(axis=0), -total, atol=1e-13)
    # Forces between the middles, at 20 and 55 mm, are shared by both.
    assert (np.linalg.norm(found.observation.forces[1], axis=-1) > 1e-3).all()


@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=6, unique=True), st.floats(-0.5, 1.5))
def test_shares_of_zones_sum_to_one(middles: list[int], place: float) -> None:
    zones = [PlaceZone(i, np.sort(middles) * ZONES_APART) for i in range(len(middles))]
    shares = [float(zone.weights(jnp.array([place]))[0]) for zone in zones]
    assert sum(shares) == pytest.approx(1, abs=1e-12)
    assert min(shares) >= 0
    assert np.count_nonzero(shares) <= 2


def test_a_camera_with_a_distance_is_a_pinhole(system: Make) -> None:
    entry = 'pixel = "1 mm"'
    camera = system((entry, f'{entry}\ndistance = "30 cm"\ntilt = "10 deg"\ndistortion = -0.05')).camera
    assert (camera.distance, camera.tilt) == pytest.approx((0.3, np.pi / 18))
    assert (camera.pan, camera.distortion) == (0, -0.05)
    with pytest.raises(
        InputError, match=r"cameras.side: .*expected a pinhole camera with a distance, got none"
    ):
        system((entry, f'{entry}\npan = "10 deg"'))


def test_a_file_is_seen_in_depth_order_unless_it_says_otherwise(system: Make) -> None:
    assert [view.visibility for view in system().schema.cameras] == ["depth"]
    assert system(("format = 1", 'format = 1\nvisibility = "stacked"')).visibility == "stacked"
    with pytest.raises(InputError, match="visibility: expected 'depth' or 'stacked', got 'deep'"):
        system(("format = 1", 'format = 1\nvisibility = "deep"'))


def test_turns_wind_a_line_once_around(system: Make) -> None:
    wound = system((RANGE, f'{RANGE}\nturns = 1\nangle = "0 deg"'))
    line = wound.actuators[0].term
    assert isinstance(line, PressureLine)
    offset = np.asarray(line.offset)
    np.testing.assert_allclose(np.linalg.norm(offset, axis=-1), 0.005, rtol=1e-12)
    rod = wound.robot["soft"]
    assert isinstance(rod, Rod)
    angle = np.unwrap(np.arctan2(offset[:, 2], offset[:, 1]))
    np.testing.assert_allclose(angle, 2 * np.pi * rod.quadrature.points, atol=1e-12)


FLOOR_AND_DRUM = """
[links.drum]
length = "30 mm"
radius = ["6 mm", "6 mm"]
position = ["70 mm", "-15 mm", "-12 mm"]
rotation = ["0 deg", "0 deg", "90 deg"]

[surfaces.roll]
type = "tube"
bodies = ["drum"]

[surfaces.floor]
type = "plane"
position = ["0 mm", "0 mm", "-26 mm"]

[contacts.stand]
first = "floor"
second = "skin"
stiffness = "20 kN/m"

[contacts.knock]
first = "roll"
second = "skin"
stiffness = "20 kN/m"

[contacts.wrap]
first = "roll"
second = "soft_points"

[sensors.floor]
type = "contact_force"
surface = "floor"

[sensors.sum]"""


def test_planes_and_drums_of_a_file(system: Make, tubes: list) -> None:
    """A finger whose end sinks into a floor; a drum is a link that is fixed in the world."""
    hand = system(*tubes, ("[sensors.sum]", FLOOR_AND_DRUM))
    kinds = [type(term).__name__ for term in hand.contact_terms]
    assert kinds == ["SolidContact", "RigidContact", "RigidContact", "SolidContact"]
    q = np.zeros(hand.robot.dofs)
    q[hand.robot.dof_slice("base")] = q[hand.robot.dof_slice("tip")] = angle = 0.219
    depth = 0.04 * np.sin(angle) + 0.03 * np.sin(2 * angle) + 0.006 - 0.026
    at, on = pressed(hand, jnp.asarray(q))
    floor = [sensor.spec.name for sensor in hand.sensors].index("floor")
    assert float(at.readings[floor]) == pytest.approx(20e3 * depth)
    forces = {name: np.asarray(each.force).sum(axis=0) for name, each in on.items()}
    np.testing.assert_allclose(forces["floor"], [0, 0, -20e3 * depth], atol=1e-9)
    assert np.linalg.norm(forces["roll"]) > 1
    np.testing.assert_allclose(sum(forces.values()), 0, atol=1e-9)
