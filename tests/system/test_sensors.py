"""Contact forces on zones and along tubes: their parts, force per length, centre of pressure."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.system.observation import force_profiles, observe
from exosight.system.schema import SensorSpec, schema_from_dict, schema_to_dict
from exosight.system.sensors import (
    CentreOfPressure,
    ContactForce,
    ForcePerLength,
    PlaceZone,
    SensorInput,
    SurfaceForces,
    force_per_length,
    zone_lengths,
)
from exosight.system.system import System, stack_systems

Make = Callable[..., System]

LENGTH = 0.07

ROWS = """[sensors.near_normal]
type = "contact_force"
surface = "skin"
at = "20 mm"
component = "normal"

[sensors.near_tangential]
type = "contact_force"
surface = "skin"
at = "20 mm"
component = "tangential"

[sensors.row]
type = "force_per_length"
surface = "skin"
places = 7

[sensors.centre]
type = "centre_of_pressure"
surface = "skin"

[sensors.near_centre]
type = "centre_of_pressure"
surface = "skin"
at = "20 mm"

[sensors.sum]"""


@pytest.fixture
def along(system: Make, tubes: list) -> Make:
    """The small file with tubes in contact and every sensor along them, and further changes."""
    return lambda *changes: system(*tubes, ("[sensors.sum]", ROWS), *changes)


def pressed(force: np.ndarray, normal: np.ndarray, place: np.ndarray, robot: object = None) -> SensorInput:
    """What sensors read if these forces act on the surface `skin`."""
    on = SurfaceForces(jnp.asarray(force), jnp.asarray(normal), jnp.asarray(place))
    return SensorInput(robot, jnp.zeros(0), {"skin": on}, {})  # pyright: ignore[reportArgumentType]


def zone_force(zone: PlaceZone, component: str) -> ContactForce:
    spec = SensorSpec("zone", "contact force", "N", component=component)  # pyright: ignore[reportArgumentType]
    return ContactForce(spec, "skin", zone)


numbers = st.floats(-10, 10)
vectors = st.tuples(numbers, numbers, numbers)
# Sizes are fixed, as each is compiled.
loads = st.lists(st.tuples(vectors, st.floats(0, LENGTH)), min_size=5, max_size=5)
places = st.lists(st.floats(0, LENGTH), min_size=4, max_size=4, unique_by=lambda x: round(x, 5)).map(sorted)


@given(loads, places)
def test_force_per_length_integrates_to_the_whole_force(acting: list, at: list[float]) -> None:
    force, place = np.array([f for f, _ in acting]), np.array([s for _, s in acting])
    lengths = np.asarray(zone_lengths(np.array(at), np.array(LENGTH)))
    profile = np.asarray(force_per_length(force, place, np.array(at), np.array(LENGTH)))
    assert lengths.sum() == pytest.approx(LENGTH, rel=1e-12)
    # Places may lie within 1e-5 m of each other, which costs digits.
    np.testing.assert_allclose(lengths @ profile, force.sum(axis=0), atol=1e-10)
    # The profile is linear between the places and constant beyond: trapezia integrate it.
    knots = np.concatenate([[0.0], at, [LENGTH]])
    values = np.concatenate([profile[:1], profile, profile[-1:]])
    np.testing.assert_allclose(np.trapezoid(values, knots, axis=0), force.sum(axis=0), atol=1e-10)


def test_a_uniform_traction_has_its_force_per_length_everywhere() -> None:
    """Closed form; 70 forces a zone of ten: midpoints integrate a hat, linear in pieces, without an error."""
    traction = np.array([1.0, -2.0, 3.0])
    place = (np.arange(700) + 0.5) / 700 * LENGTH
    force = np.tile(traction * LENGTH / 700, (700, 1))
    middles = (np.arange(10) + 0.5) / 10 * LENGTH
    profile = force_per_length(force, place, middles, np.array(LENGTH))
    np.testing.assert_allclose(profile, np.tile(traction, (10, 1)), rtol=1e-12)
    whole = CentreOfPressure(SensorSpec("c", "centre of pressure", "m"), "skin", PlaceZone(0, middles[:1]))
    assert float(whole.read(pressed(force, force, place))) == pytest.approx(LENGTH / 2, rel=1e-12)
    # A pressure that rises linearly from 0 acts at two thirds; midpoints are off by 1/(6 · 700²) of it.
    rising = force * place[:, None]
    centre = float(whole.read(pressed(rising, rising, place)))
    assert centre == pytest.approx(2 / 3 * LENGTH, rel=1e-6)


def test_a_force_between_two_zones_is_shared_by_the_lever() -> None:
    middles = np.array([0.02, 0.05])
    force, normal = np.array([[3.0, 0.0, -4.0]]), np.array([[0.0, 0.0, -4.0]])
    at = pressed(force, normal, np.array([0.03]))
    for number, share in ((0, 2 / 3), (1, 1 / 3)):
        zone = PlaceZone(number, middles)
        read = [float(zone_force(zone, part).read(at)) for part in ("magnitude", "normal", "tangential")]
        np.testing.assert_allclose(read, share * np.array([5.0, 4.0, 3.0]), rtol=1e-12)
        row = ForcePerLength(
            SensorSpec("p", "force per length", "N/m", component="tangential"), "skin", zone, np.array(0.035)
        )
        assert float(row.read(at)) == pytest.approx(share * 3.0 / 0.035, rel=1e-12)
        centre = CentreOfPressure(SensorSpec("c", "centre of pressure", "m"), "skin", zone)
        assert float(centre.read(at)) == pytest.approx(0.03, rel=1e-12)
        # Without contact, where a norm has no derivative.
        read_off = jax.value_and_grad(lambda x, at=centre: at.read(pressed(x, x, np.array([0.03]))))
        value, slope = read_off(jnp.zeros((1, 3)))
        assert float(value) == middles[number]
        assert not slope.any()


def test_sensors_of_a_file_read_a_rod_that_lies_on_a_link(along: Make) -> None:
    """A straight rod along straight cylinders, 0.2 mm deep: a uniform traction k d, and the round end's."""
    links = (
        ('radius = ["10 mm", "8 mm"]', 'radius = ["8 mm", "8 mm"]'),
        ('["8 mm", "6 mm"]', '["8 mm", "8 mm"]'),
    )
    lying = along(
        *links,
        ('"15 mm"]', '"12.8 mm"]'),
        ("points_per_element = 4", "points_per_element = 16"),
        ("places = 7", "places = 6"),
    )
    batch = observe(stack_systems([lying]), np.zeros((1, 1, lying.robot.dofs)))
    seen = jax.tree.map(lambda leaf: np.asarray(leaf)[0, 0], batch)
    read = dict(zip((each.name for each in lying.schema.sensors), seen.readings, strict=True))
    traction = np.pi / 4 * 300e3 / 0.75 * 0.2e-3
    # Zones of 12 mm before the fillet between the links; Gauss points are up to 2.5 mm apart.
    np.testing.assert_allclose([read["row_0"], read["row_1"]], traction, rtol=0.01)
    assert read["near_normal"] == read["near"] > 0
    assert read["near_tangential"] == 0
    assert read["near_centre"] < LENGTH / 2 < read["centre"]
    profiles = force_profiles(lying, np.zeros((1, lying.robot.dofs)), places=6)
    row = np.linalg.norm(profiles["force_per_length_skin"][0], axis=-1)
    np.testing.assert_allclose(row, [read[f"row_{i}"] for i in range(6)], rtol=1e-12)
    np.testing.assert_array_equal(profiles["normal_per_length_skin"], profiles["force_per_length_skin"])
    np.testing.assert_allclose(profiles["place_skin"][0], (np.arange(6) + 0.5) / 6 * LENGTH, rtol=1e-12)
    # The rod feels the opposite; it is 80 mm long.
    back = profiles["force_per_length_soft_points"][0].sum(axis=0) * 0.08 / 6
    np.testing.assert_allclose(
        back, -profiles["force_per_length_skin"][0].sum(axis=0) * LENGTH / 6, atol=1e-12
    )
    # One entry a zone, however many sensors read it.
    assert [zone.spec.name for zone in lying.zones] == ["near", "far"]
    np.testing.assert_array_equal(seen.normals, seen.forces)


def test_components_stand_in_the_schema(along: Make) -> None:
    schema = along().schema
    assert [schema.sensor(name).component for name in ("near", "near_normal", "near_tangential")] == [
        *("magnitude", "normal", "tangential")
    ]
    assert schema_from_dict(schema_to_dict(schema)) == schema
    assert [(s.quantity, s.unit) for s in schema.sensors if s.name in ("row_6", "centre")] == [
        ("force per length", "N/m"),
        ("centre of pressure", "m"),
    ]
    # Schemas of files written before there were components are those of magnitudes.
    old = schema_to_dict(schema)
    del old["sensors"][0]["component"]
    assert schema_from_dict(old) == schema
