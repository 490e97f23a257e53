"""Snaps: a shallow truss whose folds are known, reported where they are and nowhere else."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from exosight.errors import InputError
from exosight.mechanics import (
    Configuration,
    DeadForce,
    Equilibria,
    Link,
    Revolute,
    Robot,
    Term,
    follow,
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


def start(truss: Robot) -> np.ndarray:
    """Its pose without a load: the spring at rest, the tip up."""
    return np.array([[-np.arccos((ARM**2 + SPAN**2 - REST**2) / (2 * ARM * SPAN))]])


@pytest.fixture(scope="module")
def there_and_back(truss: Robot, fold: float) -> tuple[np.ndarray, Equilibria]:
    up = np.linspace(0, 2.1 * fold, 21)
    loads = np.concatenate([up, up[-2::-1], -up[1:]])[:, None]
    found = follow([truss], loads, q=start(truss))
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


def test_bisection_finds_the_fold(truss: Robot, there_and_back: tuple, fold: float) -> None:
    loads, found = there_and_back
    step = 2.1 * fold / 20
    snaps = locate_snaps(truss, loads, found, tolerance=1e-3)
    for snap, expected in zip(snaps, (fold, -fold), strict=True):
        low, high = sorted((snap.below[0], snap.above[0]))
        assert low - 1e-3 * step <= expected <= high + 1e-3 * step
        assert high - low <= 1e-3 * step
        assert snap.energy > 0  # a snap goes downhill
        # Just before it the slope of the path grows without bound, and the pose jumps to the other side.
        assert snap.before[0] * snap.after[0] < 0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"tolerance": 0.0}, "tolerance: expected a share"),
        ({"found": None}, "one robot at 61 loads, got shape"),
    ],
)
def test_wrong_use_is_refused(truss: Robot, there_and_back: tuple, change: dict, sentence: str) -> None:
    loads, found = there_and_back
    arguments: dict[str, Any] = {"found": found, **change}
    if arguments["found"] is None:
        arguments["found"] = eqx.tree_at(lambda f: f.snapped, found, found.snapped[None])
    with pytest.raises(InputError, match=sentence):
        locate_snaps(truss, loads, **arguments)
