"""What programs know of a design: that it stays what the robots have, and makes them shorter."""

import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from example_systems import coarse_thumb

from exosight import lie
from exosight.exosuit.published import published
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.mechanics import Robot
from exosight.mechanics.known_numbers import UNKNOWN, known_numbers, with_known
from exosight.mechanics.path_step import program_of
from exosight.system.build import build
from exosight.system.file import describe


def planar(r0: float, r1: float) -> Robot:
    return published(ExosuitShape(Linear(r0, r1), 0.095)).robot


def leaves_of(*robots: Robot) -> list[np.ndarray]:
    return [np.stack(parts) for parts in zip(*map(jax.tree.leaves, robots), strict=True)]


def tilted(robot: Robot) -> Robot:
    """Its finger stands out of the plane."""
    turn = np.asarray(lie.exp(jnp.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])))
    return eqx.tree_at(lambda own: own.bodies[1].mount, robot, np.asarray(robot.bodies[1].mount) @ turn)


@pytest.fixture(scope="module")
def robots() -> tuple[Robot, Robot]:
    return planar(0.01, 0.005), planar(0.006, 0.006)


def test_what_is_known_is_what_the_robots_have(robots: tuple[Robot, Robot]) -> None:
    structure = jax.tree.structure(robots[0])
    known = known_numbers(structure, leaves_of(*robots))
    for robot in robots:
        own = jax.tree.leaves(robot)
        for before, after in zip(own, with_known(structure, known, own), strict=True):
            np.testing.assert_array_equal(after, before)


def test_a_cylinder_is_no_case_of_its_own(robots: tuple[Robot, Robot]) -> None:
    """The slope of its line is zero, the line's offset is not: that component stays unknown."""
    structure = jax.tree.structure(robots[0])
    alone = [known_numbers(structure, leaves_of(robot)) for robot in robots]
    assert alone[0] == alone[1]


def test_one_robot_out_of_the_plane_makes_its_numbers_unknown(robots: tuple[Robot, Robot]) -> None:
    structure = jax.tree.structure(robots[0])
    flat, mixed = (
        known_numbers(structure, leaves_of(robots[0], other)) for other in (robots[1], tilted(robots[1]))
    )
    assert mixed.count(UNKNOWN) == flat.count(UNKNOWN) + 4  # cosine and sine of the turn about x, twice
    own = jax.tree.leaves(tilted(robots[1]))
    for before, after in zip(own, with_known(structure, mixed, own), strict=True):
        np.testing.assert_array_equal(after, before)


def test_a_program_leaves_out_what_is_known(robots: tuple[Robot, Robot]) -> None:
    """Results are compared in test_evaluator, of robots whose zeros are known."""
    structure, leaves = jax.tree.structure(robots[0]), leaves_of(*robots)
    shapes = tuple(leaf.shape[1:] for leaf in leaves)
    found = [program_of(structure, shapes, 1, known) for known in (b"", known_numbers(structure, leaves))]
    if None in found:
        pytest.skip("no interpreter on this machine")
    every, fewer = (len(program.stages[1].code) for program in found if program is not None)
    assert fewer < 0.6 * every


def test_what_a_term_has_of_another_one_is_computed_once() -> None:
    """Friction holds its contact; with another stiffness in one robot it is no copy."""
    values = tomllib.loads(coarse_thumb())
    values["contacts"] = {"press": {**values["contacts"]["press"], "friction": 0.3}}
    robot = build(describe(values)).robot
    other = eqx.tree_at(lambda own: own.terms[-1].contact.stiffness, robot, np.array(1.0))
    structure, shapes = jax.tree.structure(robot), tuple(map(np.shape, jax.tree.leaves(robot)))
    alike, apart = (known_numbers(structure, leaves_of(robot, second)) for second in (robot, other))
    own = jax.tree.leaves(other)
    for before, after in zip(own, with_known(structure, apart, own), strict=True):
        np.testing.assert_array_equal(after, before)
    found = [program_of(structure, shapes, 1, known) for known in (apart, alike)]
    if None in found:
        pytest.skip("no interpreter on this machine")
    every, fewer = (len(program.stages[1].code) for program in found if program is not None)
    assert fewer < 0.95 * every


def test_robots_without_any_such_numbers() -> None:
    structure = jax.tree.structure(Robot((), ()))
    assert with_known(structure, known_numbers(structure, []), []) == []
