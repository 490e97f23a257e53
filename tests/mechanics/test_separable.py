"""Sums over frames are found from their operations, and their Hessians by frame are those by coordinate."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.mechanics import Configuration, Robot, Term
from exosight.mechanics.separable import is_separable

ROWS = np.broadcast_to(np.arange(3)[:, None], (3, 2))
"""Each row of a (3, 2) array is a part."""


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (lambda x, k: k * jnp.sum(x**4), True),
        (lambda x, k: jnp.sum(jnp.sin(x[:, 0]) * x[:, 1]) / k, True),
        (lambda x, k: jnp.sum(jnp.where(x[::-1, 0] > 0, x[:, 1] ** 2, 0.0)), True),  # no slope by a condition
        (lambda x, k: k * (x[0, 0] + x[1, 0] - x[2, 1]), True),
        (lambda x, k: jnp.sum((x[0] - x[1]) ** 2), False),
        (lambda x, k: jnp.exp(k + x[0, 0] + x[2, 0]), False),
        (lambda x, k: x[0, 0] / x[1, 0], False),
        (lambda x, k: k / (x[0, 0] + x[1, 0]), False),
        (lambda x, k: jnp.sum(x) ** 3, False),
        (lambda x, k: jnp.dot(x[:, 0], x[::-1, 0]), False),
        (lambda x, k: jnp.sin(x[0, 0] * x[1, 1]) + x[2, 0], False),
        (
            lambda x, k: jax.lax.while_loop(lambda s: s < k, lambda s: s * 2, x[0, 0]),
            False,
        ),  # it does not tell
    ],
)
def test_what_mixes_rows_is_told_from_sums_over_them(function: Callable, expected: bool) -> None:
    assert is_separable(function, [np.zeros((3, 2)), np.zeros(())], [ROWS, np.array(-1)]) == expected


class Effect(Term):
    """A sum over frames of what depends on position and axes of each, and on strains; or of two frames."""

    stiffness: jax.Array
    between: bool = eqx.field(static=True)

    def energy(self, tree: Any, at: Configuration, loads: jax.Array) -> jax.Array:
        p = at.position
        if self.between:
            return self.stiffness * jnp.sum((p[1:] - p[:-1]) ** 4) * (1 + loads[0])
        strain = sum(jnp.sum(each**4) for each in at.strain.values())
        own = jnp.sum(at.pose[:, 0, 1] * p[:, 2] ** 3) * (1 + loads[0])
        return self.stiffness * (own + 1e-6 * strain + 1e-3 * jnp.sum(at.q**4))


@pytest.mark.parametrize("between", [False, True])
def test_derivatives_match_differences(
    between: bool, tree: Robot, tree_pose: tuple, evaluate: Callable
) -> None:
    """Of rods, links and hinges; by differences of energy and gradient along a direction."""
    term = Effect(jnp.array(50.0), between=between)
    robot, (q, loads), h = Robot(tree.bodies, (term,)), tree_pose, 1e-5
    assert term._separable(robot, robot.frames, 2) != between
    direction = np.random.default_rng(5).normal(size=robot.dofs)
    here, ahead, behind = (evaluate(robot, q + step * direction, loads)[0] for step in (0, h, -h))
    # Central differences: h² of a third derivative, relative, and round-off / h.
    assert (ahead.energy - behind.energy) / (2 * h) == pytest.approx(
        float(here.gradient @ direction), rel=1e-7
    )
    change = (ahead.gradient - behind.gradient) / (2 * h)
    np.testing.assert_allclose(here.hessian @ direction, change, rtol=0, atol=1e-6 * np.abs(change).max())
