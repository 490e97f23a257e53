"""The balance of energy on closed paths: work of the loads = stored + lost, with friction, creep and both.

Work is taken from loads and places alone, by the trapezoidal rule: exact on straight pieces, between loads
that include those at which the path bends; on smooth ones its error falls with the step's square. What the
driver counts by itself is compared with that, and with closed forms.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight import lie
from exosight.mechanics import (
    Circular,
    DeadForce,
    Equilibria,
    Gauss,
    Legendre,
    Link,
    Prismatic,
    Robot,
    Rod,
    drive,
)
from exosight.mechanics.friction import friction
from exosight.mechanics.relaxation import relaxation
from exosight.mechanics.rigid_contact import RigidContact
from exosight.mechanics.surfaces import Plane, Solids
from exosight.mechanics.tree import Tree

MU, STIFFNESS, PRESS = 0.3, 2e4, 1.0
RADIUS, LENGTH, YOUNG = 0.002, 0.1, 1e5
TIME = 0.5
"""Of relaxation [s]."""


def on_a_plane(slider: Rod | Link, creeps: bool) -> Robot:
    """A capsule behind `slider` on a plane: drawn along it (channel 0), pressed on it (1); the time (2)."""
    site = np.zeros((1, 3))
    up = Prismatic((0.0, 0.0, 1.0), stiffness=1.0)
    mount = lie.translation(jnp.array([0.0, 0.0, 0.005]))
    capsule = Link("block", 0.03, site, parent=slider.name, joint=up, mount=mount)
    bodies = (slider, capsule)
    solids = Solids((("block", 0),), np.array([0.03]), np.array([[0.005, 0.005]]))
    contact = RigidContact(solids, Plane(None, np.zeros(3), np.array([0.0, 0.0, 1.0])), np.array(STIFFNESS))
    pulls = (
        DeadForce("block", 0, 0, jnp.array([1.0, 0, 0])),
        DeadForce("block", 0, 1, jnp.array([0, 0, -1.0])),
    )
    tree = Tree(bodies)
    relaxing = (relaxation(slider.name, [0.4], [TIME], 2, tree),) if creeps else ()
    return Robot(bodies, (*pulls, contact, friction(contact, MU, tree), *relaxing))


@pytest.fixture(scope="module")
def sprung() -> Robot:
    """The capsule on a spring."""
    slider = Link("slider", 0.0, np.zeros((1, 3)), joint=Prismatic((1.0, 0.0, 0.0), stiffness=10.0))
    return on_a_plane(slider, creeps=False)


@pytest.fixture(scope="module")
def creeping() -> Robot:
    """The capsule at the end of a viscoelastic bar that only stretches."""
    points = Gauss(1, 1)
    bar = Rod(
        "bar", LENGTH, Circular(np.full(points.size, RADIUS)), young=YOUNG,
        strains={"stretch_x": Legendre(0)}, quadrature=points,
    )  # fmt: skip
    return on_a_plane(bar, creeps=True)


def counted(found: Equilibria) -> np.ndarray:
    """Π + dissipated − supplied at each load since the first [J]: nothing, where the balance holds."""
    off = (found.energy + found.dissipated - found.supplied)[0]
    return off - off[0]


def lost(robot: Robot, found: Equilibria) -> np.ndarray:
    """What all terms have lost at each load [J]."""
    memories = tuple(jnp.asarray(memory[0]) for memory in found.history)
    return np.asarray(jax.vmap(lambda own: robot.with_memories(own).dissipated())(memories))


def balance(robot: Robot, loads: np.ndarray, scale: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Work of the loads, and stored and lost energy, since the first load: (loads,) each [J].

    scale   metres that the two forces move along a unit of the two coordinates
    """
    found = drive([robot], loads)
    assert found.converged.all()
    ways = np.asarray(found.q[0, :, :2]) * scale * [1.0, -1.0]
    forces = loads[:, :2]
    work = (0.5 * (forces[1:] + forces[:-1]) * np.diff(ways, axis=0)).sum(axis=1)
    stored = np.asarray(found.energy[0]) + (forces * ways).sum(axis=1)
    taken = lost(robot, found)
    assert (np.diff(taken) >= 0).all()
    return np.concatenate([[0.0], np.cumsum(work)]), stored - stored[0] + taken - taken[0]


def test_friction_takes_the_work_of_a_closed_path(sprung: Robot) -> None:
    """The block drawn to and fro, with loads where it begins to slip: exact, to the solver's tolerance."""
    normal = PRESS / (1 + 1 / (2 * STIFFNESS))  # a weak spring holds it up
    grip = 2 * (2 / 3) * STIFFNESS  # of both ends
    first = MU * normal * (10.0 + grip) / grip
    turn = 2 * first
    pulls = [0.0, first, 0.5, 0.5 - turn, -0.5, -0.5 + turn, 0.5, 0.5 - turn, -0.5, -0.5 + turn, 0.5]
    loads = np.array([[pull, PRESS, 0.0] for pull in pulls])
    work, spent = balance(sprung, loads, (1.0, 1.0))
    cycle = work[10] - work[6]
    assert spent[10] - spent[6] == pytest.approx(cycle, rel=1e-8)
    assert cycle > 0.01


def test_the_driver_finds_where_the_block_begins_to_slip(sprung: Robot) -> None:
    """Between loads that do not include it: loss in closed form, and the balance, to the solver's tolerance.

    The first load after each turn is one at which the block sticks, or the step would hold two bends.
    """
    normal = PRESS / (1 + 1 / (2 * STIFFNESS))
    grip = 2 * (2 / 3) * STIFFNESS
    pulls = [0.0, 0.5, 0.49, -0.5, -0.49, 0.5, 0.49, -0.5]
    found = drive([sprung], np.array([[pull, PRESS, 0.0] for pull in pulls]))
    slip = 2 * (0.5 - MU * normal) / 10.0 - 2 * MU * normal / grip  # what the block moves, less what shears
    assert slip > 0
    np.testing.assert_allclose(np.diff(found.dissipated[0, 1::2]), MU * normal * slip, rtol=1e-8)
    np.testing.assert_allclose(counted(found), 0.0, atol=1e-8 * found.dissipated[0, -1])


def test_friction_and_creep_take_the_work_of_a_closed_path(creeping: Robot) -> None:
    """Both together, pull and pressure changing; the rule's error falls as the square of the step to 1e-6."""
    defects = []
    for steps in (1000, 4000):
        time = np.linspace(0.0, 2.0, steps + 1)
        loads = np.stack([0.5 * np.sin(np.pi * time), PRESS + 0.3 * np.cos(np.pi * time), time], axis=1)
        work, spent = balance(creeping, loads, (LENGTH, 1.0))
        defects.append(abs(spent[-1] / work[-1] - 1))
    assert defects[1] < 1e-6
    assert defects[1] < defects[0] / 4


def test_without_friction_a_path_gives_back_its_energy(sprung: Robot) -> None:
    """Around a loop of two loads, off the plane and back in other steps: to 1e-9 of the most stored."""
    smooth = Robot(sprung.bodies, sprung.terms[:3])
    there = np.array([[0.1, 1.0, 0], [0.4, 2.0, 0], [0.5, -0.5, 0], [0.2, -0.2, 0]])
    back = np.array([[-0.3, 0.7, 0], [0.4, 2.0, 0], [0.3, 0.5, 0], [0.1, 1.0, 0]])
    found = drive([smooth], np.concatenate([there, back]))
    energy = found.energy[0]
    most = np.abs(energy).max()
    assert energy[[5, 7]] == pytest.approx(energy[[1, 0]], abs=1e-9 * most)


@settings(deadline=None, max_examples=15)
@given(
    st.lists(
        st.tuples(st.floats(-0.8, 0.8), st.floats(0.0, 2.0), st.floats(0.0, 1.0)), min_size=6, max_size=6
    )
)
def test_nothing_is_ever_gained_from_friction_and_dampers(
    creeping: Robot, steps: list[tuple[float, float, float]]
) -> None:
    """Any pulls and pressures, at any times."""
    loads = np.array(steps)
    loads[:, 2] = np.cumsum(loads[:, 2])
    found = drive([creeping], loads)
    taken = lost(creeping, found)
    assert (np.diff(taken, prepend=0.0) >= -1e-18).all()  # round-off of microjoules
