"""Snaps: a shallow truss whose folds are known, reported where they are and nowhere else."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from exosight.mechanics import (
    Configuration,
    DeadForce,
    Equilibria,
    Link,
    Revolute,
    Robot,
    State,
    Term,
    drive,
    locate_snaps,
)
from exosight.mechanics.tree import Tree

ARM, SPAN, REST, STIFFNESS = 0.1, 0.19, 0.1, 500.0
"""Von Mises' truss: an arm of 10 cm on a hinge, and from its tip a spring of 10 cm to a point 19 cm off."""


class Spring(Term):
    """½ k (distance of the arm's tip from a fixed point − rest)²."""

    stiffness: jax.Array

    def frames(self, tree: Tree) -> list[int]:
        return [tree.frame("arm", 0)]

    def energy(self, tree: Tree, at: Configuration, loads: jax.Array) -> jax.Array:
        between = at.position[0] - jnp.array([SPAN, 0.0, 0.0])
        return 0.5 * self.stiffness * (jnp.sqrt(jnp.sum(between**2)) - REST) ** 2


@pytest.fixture(scope="module")
def truss() -> Robot:
    """It stands at angle −q upwards (positive angles turn x towards −z), and the load pushes its tip down."""
    arm = Link("arm", ARM, jnp.array([[ARM, 0.0, 0.0]]), joint=Revolute())
    return Robot((arm,), (Spring(jnp.array(STIFFNESS)), DeadForce("arm", 0, 0, jnp.array([0, 0, -1.0]))))


def slope(q: float) -> float:
    """d/dq of the spring's energy [N m]."""
    distance = np.hypot(SPAN - ARM * np.cos(q), ARM * np.sin(q))
    return STIFFNESS * (distance - REST) * SPAN * ARM * np.sin(q) / distance


def load_of(q: float) -> float:
    """The load at which q is in equilibrium: the tip is at −ARM sin q, so dΠ/dq = slope − u ARM cos q."""
    return slope(q) / (ARM * np.cos(q))


@pytest.fixture(scope="module")
def fold() -> float:
    """Largest load that the truss bears before it snaps through; its mirror image is the smallest."""

    def rate(q: float) -> float:
        return (load_of(q + 1e-6) - load_of(q - 1e-6)) / 2e-6

    return load_of(brentq(rate, -0.3, -0.05))


def energy(truss: Robot, q: float, load: float) -> float:
    """Of the spring and the load [J]."""
    distance = np.hypot(SPAN - ARM * np.cos(q), ARM * np.sin(q))
    return 0.5 * STIFFNESS * (distance - REST) ** 2 - load * ARM * np.sin(q)


def start(truss: Robot) -> np.ndarray:
    """Its pose without a load: the spring at rest, the tip up."""
    return np.array([[-np.arccos((ARM**2 + SPAN**2 - REST**2) / (2 * ARM * SPAN))]])


@pytest.fixture(scope="module")
def there_and_back(truss: Robot, fold: float) -> tuple[np.ndarray, Equilibria]:
    up = np.linspace(0, 2.1 * fold, 21)
    loads = np.concatenate([up, up[-2::-1], -up[1:]])[:, None]
    found = drive([truss], loads, state=State(start(truss), np.zeros((1, 1))))
    assert found.converged.all()
    return loads, jax.tree.map(lambda leaf: leaf[0], found)


def test_it_snaps_at_its_folds_and_nowhere_else(there_and_back: tuple, fold: float) -> None:
    loads, found = there_and_back
    steps = np.flatnonzero(found.snapped)
    assert len(steps) == 2
    assert loads[steps[0] - 1, 0] < fold < loads[steps[0], 0]
    assert loads[steps[1], 0] < -fold < loads[steps[1] - 1, 0]


def test_between_the_folds_both_branches_are_found(there_and_back: tuple) -> None:
    """The same loads on the way up and on the way down: two poses, both stable, both exact."""
    loads, found = there_and_back
    up, down = found.q[:21, 0], found.q[40:19:-1, 0]
    between = loads[:21, 0] < 0.9 * loads[np.flatnonzero(found.snapped)[0] - 1, 0]
    assert np.all(up[between] < 0)
    assert np.all(down[between] > 0)
    assert np.all(found.min_eigenvalue > 0)
    for q, load in zip(found.q[:, 0], loads[:, 0], strict=True):
        # Residual 1e-10 of a stiffness of some N m/rad, divided by the arm.
        assert load_of(q) == pytest.approx(load, abs=1e-6)


def test_the_fold_is_located_and_left_for_the_other_branch(
    truss: Robot, there_and_back: tuple, fold: float
) -> None:
    loads, found = there_and_back
    same, (snaps,) = locate_snaps([truss], loads, state=State(start(truss), np.zeros((1, 1))))
    np.testing.assert_array_equal(same.q[0], found.q)
    assert [snap.step for snap in snaps] == np.flatnonzero(found.snapped).tolist()
    for snap, expected in zip(snaps, (fold, -fold), strict=True):
        assert snap.load[0] == pytest.approx(expected, rel=1e-6)  # to 1e-7 of the pose's forces
        assert load_of(snap.after[0]) == pytest.approx(expected, rel=1e-6)
        assert snap.before[0] * snap.after[0] < 0
        released = energy(truss, snap.before[0], expected) - energy(truss, snap.after[0], expected)
        # The last stable pose is known to 1e-4, and its energy, which is stationary, to the square of that.
        assert snap.energy == pytest.approx(released, rel=1e-6)
        assert snap.taken == 0


def test_what_snaps_lose_is_what_the_loads_supply(truss: Robot, there_and_back: tuple, fold: float) -> None:
    """Two snaps lose the energy between their branches; the rest of the path loses nothing."""
    _, found = there_and_back

    def left(u: float, q: float) -> float:
        other = brentq(lambda q: load_of(q) - u, *((0.1, 1.5) if u > 0 else (-1.5, -0.1)))
        return energy(truss, q, u) - energy(truss, other, u)

    at_fold = brentq(lambda q: load_of(q + 1e-6) - load_of(q - 1e-6), -0.3, -0.05)
    both = left(fold, at_fold) + left(-fold, -at_fold)
    assert found.dissipated[-1] == pytest.approx(both, rel=1e-6)  # as the fold's load
    np.testing.assert_allclose(np.unique(np.round(found.dissipated / both, 6)), [0, 0.5, 1], atol=2e-6)
    steps = 2.1 * fold * np.linspace(0, 1, 101)
    fine = drive(
        [truss],
        np.concatenate([steps, steps[-2::-1], -steps[1:]])[:, None],
        state=State(start(truss), np.zeros((1, 1))),
    )

    def off(found: Equilibria) -> float:
        defect = found.energy + found.dissipated - found.supplied
        return float(np.abs(defect - defect[..., :1]).max() / both)

    # Close to a fold the load is a parabola of the pose, which the driver's steps along the branch resolve.
    assert off(fine) < 5e-5
    assert off(fine) < off(found) / 6  # a fifth of the step


@pytest.mark.parametrize("step", [0.02, 0.1, 0.7])
def test_a_state_does_not_depend_on_the_steps_that_lead_to_it(truss: Robot, fold: float, step: float) -> None:
    """At common loads up and down again, to 1e-9; the pose is an angle of order one."""
    turns = np.array([0.7, 1.4, 2.1, 1.4, 0.7, 0.0, -0.7, -1.4]) * fold
    way = np.concatenate([[0.0], turns])
    fine = [np.linspace(a, b, round(0.7 / step) + 1)[1:] for a, b in pairwise(way)]
    state = State(start(truss), np.zeros((1, 1)))
    coarse = drive([truss], turns[:, None], state=state).q[0]
    found = drive([truss], np.concatenate(fine)[:, None], state=state)
    every = len(fine[0])
    np.testing.assert_allclose(found.q[0, every - 1 :: every], coarse, atol=1e-9)
