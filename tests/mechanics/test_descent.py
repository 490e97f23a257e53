"""Where a snap lands: a point in a plane potential of many wells, whose overdamped flow is known.

In coordinates s and d, turned by 30° against those of the robot, the potential is f(s) + g(d): for s a bowl
with a ripple, a well every 0.63 m; for d two wells. The metric is 1 N/m, so the flow keeps the two apart: s
goes from the fold of its well to the next well and rests there; d stays.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from exosight.mechanics import (
    Configuration,
    DeadForce,
    Link,
    Prismatic,
    Robot,
    SolverOptions,
    State,
    Term,
    drive,
    locate_snaps,
)
from exosight.mechanics.kinematics import Motion
from exosight.mechanics.term import Bound, Expansion, TermWithMemory, zero
from exosight.mechanics.tree import Tree

COSINE, SINE = np.cos(np.pi / 6), np.sin(np.pi / 6)
RIPPLE, LENGTH, WELL = 0.05, 0.1, 0.3


class Wells(Term):
    """½ s² + A (1 − cos(s/λ)) + (d² − b²)²/4b²."""

    ripple: jax.Array

    def frames(self, tree: Tree) -> list[int]:
        return [tree.frame("point", 0)]

    def energy(self, tree: Tree, at: Configuration, loads: jax.Array) -> jax.Array:
        x, z = at.position[0, 0], at.position[0, 2]
        s, d = COSINE * x + SINE * z, COSINE * z - SINE * x
        slope = 0.5 * s**2 + self.ripple * (1 - jnp.cos(s / LENGTH))
        return slope + (d**2 - WELL**2) ** 2 / (4 * WELL**2)


def force(s: float) -> float:
    """f'(s): the load at which s is in equilibrium."""
    return s + RIPPLE / LENGTH * np.sin(s / LENGTH)


FOLD = LENGTH * np.arccos(-(LENGTH**2) / RIPPLE)
"""s at the end of the first well, where f'' = 1 + A/λ² cos(s/λ) is zero."""


@pytest.fixture(scope="module")
def point() -> Robot:
    """A point that slides along x and z; the load pulls it along s."""
    along_x = Link("slide", 0.0, jnp.zeros((1, 3)), joint=Prismatic((1.0, 0.0, 0.0)))
    along_z = Link("point", 0.0, jnp.zeros((1, 3)), parent="slide", joint=Prismatic((0.0, 0.0, 1.0)))
    pull = DeadForce("point", 0, 0, jnp.array([COSINE, 0.0, SINE]))
    return Robot((along_x, along_z), (Wells(jnp.array(RIPPLE)), pull))


def turned(q: np.ndarray) -> np.ndarray:
    """s and d."""
    return np.array([COSINE * q[0] + SINE * q[1], COSINE * q[1] - SINE * q[0]])


@pytest.mark.parametrize("well", [WELL, -WELL])
@pytest.mark.parametrize("steps", [2, 40])
def test_a_snap_lands_where_the_flow_ends(point: Robot, well: float, steps: int) -> None:
    """In the next well, though two further ones are stable at the load of the fold; d keeps its own."""
    top = force(FOLD)
    start = State(np.array([[-SINE * well, COSINE * well]]), np.zeros((1, 1)))
    loads = np.linspace(0, 1.2 * top, steps)[:, None]
    found, (snaps,) = locate_snaps([point], loads, state=start)
    assert found.converged.all()
    assert not found.tied.any()
    assert len(snaps) == 1
    period = 2 * np.pi * LENGTH
    landing = brentq(lambda s: force(s) - top, period - FOLD, period + FOLD)
    further = brentq(lambda s: force(s) - top, 2 * period - FOLD, 2 * period + FOLD)
    assert landing < further - 0.3
    # The fold is located to 1e-7 of the forces: s before it to the root of that, s after it to that.
    assert snaps[0].load[0] == pytest.approx(top, rel=1e-6)
    np.testing.assert_allclose(turned(snaps[0].before), [FOLD, well], atol=2e-3)
    np.testing.assert_allclose(turned(snaps[0].after), [landing, well], atol=1e-5)
    end = brentq(lambda s: force(s) - 1.2 * top, period - FOLD, period + FOLD)
    np.testing.assert_allclose(turned(found.q[0, -1]), [end, well], atol=1e-8)


class Pieces(TermWithMemory):
    """A force min(x, A x + b) of a point x, as friction has: of pieces, without an energy.

    Newton's method from (−1 nm, 0, 0) goes to (0, −1.2 nm, 0), (0, 0, −1.4 nm) and round again; the
    equilibrium is at 0. Beside an energy of 1 J the work of such steps is lost in round-off.
    Source: I. Ben Gharbia, J. C. Gilbert, Mathematical Programming 134 (2012), 349–364.
    """

    def remember(self, tree: Tree, motion: Motion, loads: jax.Array) -> jax.Array:
        return jnp.asarray(self.memory)

    def bind(self, tree: Tree) -> Bound:
        matrix = jnp.array([[1.0, 0.0, 1.5], [1.5, 1.0, 0.0], [0.0, 1.5, 1.0]])

        def expand(q: jax.Array, motion: Motion, loads: jax.Array) -> Expansion:
            other = matrix @ q + TINY * jnp.array([1.0, 1.2, 1.4])
            rows = jnp.where((other < q)[:, None], matrix, jnp.eye(3))
            return zero(tree, loads)._replace(
                energy=jnp.array(1.0), gradient=jnp.minimum(q, other), coupling=rows
            )

        return expand


TINY = 1e-9
"""[m]; from there on Newton's method alone finds the end of a descent."""


@pytest.mark.parametrize("unrolled", [True, False])
def test_newtons_method_does_not_go_round_for_ever(unrolled: bool) -> None:
    slides = [
        Link(name, 0.0, jnp.zeros((1, 3)), parent=parent, joint=Prismatic(axis))
        for name, parent, axis in (
            ("x", None, (1.0, 0.0, 0.0)),
            ("y", "x", (0.0, 1.0, 0.0)),
            ("z", "y", (0.0, 0.0, 1.0)),
        )
    ]
    robot = Robot(tuple(slides), (Pieces(np.zeros(1)),))
    start = State(np.array([[-TINY, 0.0, 0.0]]), np.zeros((1, 1)), (np.zeros((1, 1)),))
    found = drive([robot], np.zeros((1, 1)), state=start, options=SolverOptions(unrolled=unrolled))
    assert found.converged.all()
    np.testing.assert_allclose(found.q[0, 0], 0.0, atol=1e-12)
    assert found.iterations[0, 0] < 100
