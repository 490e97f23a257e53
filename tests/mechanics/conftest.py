"""Compiled evaluation and two small robots that the mechanics tests share.

What costs time here is compiling. Robots of one structure (names, bases, points, terms) share compiled code,
so tests vary numbers wherever they can.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from exosight import lie
from exosight.mechanics import (
    Circular,
    DeadForce,
    Gauss,
    Gravity,
    Legendre,
    Link,
    NodalQuadratic,
    PressureLine,
    Revolute,
    Robot,
    Rod,
    SphereContact,
    potential,
    walk,
)
from exosight.mechanics.contact import Spheres
from exosight.mechanics.rod import STRAINS

# These run for milliseconds, so optimising them costs more than it saves.
_QUICKLY = {"xla_backend_optimization_level": "0"}


@pytest.fixture(scope="session")
def evaluate() -> Callable:
    """(robot, q, loads) -> Evaluation and Motion, compiled once a structure."""
    return eqx.filter_jit(lambda robot, q, loads: potential(robot)(q, loads), compiler_options=_QUICKLY)


@pytest.fixture(scope="session")
def motion() -> Callable:
    """(robot, q) -> Motion, compiled once a structure."""
    return eqx.filter_jit(walk, compiler_options=_QUICKLY)


@pytest.fixture(scope="session")
def reference() -> Callable[[str], Any]:
    """The numbers of tests/reference, by name."""
    folder = Path(__file__).parents[1] / "reference"
    return lambda name: json.loads((folder / f"{name}.json").read_text())


@pytest.fixture(scope="session")
def tree() -> Robot:
    """Everything at once and out of the plane: rods, links, hinges, weight, a line, contact, dead forces.

    The first rod has all six strains in mixed bases and stands on a hinge beside a chain of two links that it
    presses on; the second rod grows from its tip.
    """
    points = Gauss(2, 3)
    surface = jnp.linspace(0.006, 0.004, points.size)
    bases = {name: NodalQuadratic(2) for name in STRAINS} | {"bend_z": Legendre(2)}
    rod = Rod(
        "rod",
        0.1,
        Circular(surface),
        young=3e5,
        poisson=0.4,
        density=1070.0,
        strains=bases,
        quadrature=points,
        mount=lie.translation(jnp.array([0.0, 0.0, 0.0158])),
        joint=Revolute((0.0, 0.0, 1.0), stiffness=0.1),
    )
    branch = Rod(
        "branch",
        0.05,
        Circular(jnp.full(points.size, 0.004)),
        young=3e5,
        density=500.0,
        strains={"bend_y": Legendre(2), "shear_z": Legendre(1)},
        quadrature=points,
        parent="rod",
    )
    limits = (-0.1, 0.2)
    upper = Link(
        "upper",
        0.045,
        jnp.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]]),
        joint=Revolute((0.0, 1.0, 0.0), stiffness=0.04, limits=limits, limit_stiffness=5.0),
        mass=jnp.array([0.01, 0.02]),
    )
    lower = Link(
        "lower",
        0.025,
        jnp.array([[0.0, 0.0, 0.0], [0.012, 0.0, 0.0]]),
        parent="upper",
        joint=Revolute((0.0, 0.6, 0.8), stiffness=0.03, limits=limits, limit_stiffness=5.0),
    )
    line = PressureLine(
        "rod",
        0,
        offset=surface[:, None] * jnp.array([0.0, 0.6, 0.8]),
        slope=jnp.tile(jnp.array([0, -0.012, -0.016]), (8, 1)),
    )
    contact = SphereContact(
        Spheres(tuple(("rod", i) for i in range(points.size)), surface),
        Spheres(
            (("upper", 0), ("upper", 1), ("lower", 0), ("lower", 1)), jnp.array([0.0112, 0.01, 0.01, 0.01])
        ),
        jnp.array(1000.0),
    )
    force = jnp.array([0.1, 0.2, -0.3])
    dead = (DeadForce("rod", -1, 1, force), DeadForce("branch", 2, 1, force))
    weight = Gravity(jnp.array([0.0, 1.0, -9.81]))
    return Robot((rod, upper, lower, branch), (line, *dead, weight, contact))


@pytest.fixture(scope="session")
def tree_pose(tree: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (radians; strains up to one) and loads [N] at which every energy of the tree is at work."""
    return np.random.default_rng(1).normal(size=tree.dofs) * 0.3, np.array([2.0, 1.5])


@pytest.fixture(scope="session")
def chain() -> Robot:
    """Three links on hinges about three different axes, with weights, springs and limits."""
    axes = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.6, 0.8))
    lengths, stiffness = (0.045, 0.0253, 0.0236), (0.04, 0.03, 0.02)
    links = []
    for i, (axis, length, spring) in enumerate(zip(axes, lengths, stiffness, strict=True)):
        links.append(
            Link(
                f"link_{i}",
                length,
                jnp.array([[0.0, 0.0, 0.0], [0.4 * length, 0.001, -0.002]]),
                parent=f"link_{i - 1}" if i else None,
                mount=lie.exp(jnp.array([0.1, -0.2, 0.3, 0.01, 0.0, 0.02]) * (i + 1)),
                joint=Revolute(axis, stiffness=spring, limits=(-0.1, 1.5), limit_stiffness=5.0),
                mass=jnp.array([0.0, 0.01 * (i + 1)]),
            )
        )
    return Robot(tuple(links), (Gravity(jnp.array([0.5, 0.0, -9.81])),))
