"""What docs/extending.md adds runs and is right: a term, a strain basis, a joint, a section."""

import re
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from exosight.mechanics import Circular, Robot, potential, walk

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """All names of the page, its pieces of code run from top to bottom."""
    names: dict[str, Any] = {}
    for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL):
        exec(compile(code, str(PAGE), "exec"), names)
    return names


def test_derivatives_of_the_spring_match_differences(page: dict[str, Any]) -> None:
    robot = page["robot"]
    evaluate = eqx.filter_jit(lambda q: potential(robot)(q, jnp.zeros(1))[0])
    q, step = np.array([0.5, -0.3, 0.2, 0.1]), 1e-5
    here = evaluate(q)
    # Central differences err by h² times a third derivative of order k L² = 5e-3 J, and by round-off / h.
    exactly = {"rtol": 0, "atol": 1e-11}
    for i, unit in enumerate(np.eye(4)):
        ahead, behind = evaluate(q + step * unit), evaluate(q - step * unit)
        np.testing.assert_allclose((ahead.energy - behind.energy) / (2 * step), here.gradient[i], **exactly)
        np.testing.assert_allclose(
            (ahead.gradient - behind.gradient) / (2 * step), here.hessian[:, i], **exactly
        )


def test_spring_and_rod_share_the_deflection(page: dict[str, Any]) -> None:
    """Two springs in series store ½ a² / (1/k + 1/k_rod), with k_rod = 3EI/L³ at the rod's tip."""
    rod, offset, spring = 3 * 300e3 * np.pi * 0.005**4 / 4 / 0.1**3, 0.002, 0.5
    assert page["found"].converged.all()
    # Deflections of 2 % of the length: Euler–Bernoulli is off by the square of that, and the tip moves back.
    assert page["found"].energy[0, 0] == pytest.approx(offset**2 / (1 / rod + 1 / spring) / 2, rel=1e-3)


def test_constant_strains_make_arcs(page: dict[str, Any]) -> None:
    """Elements of one curvature are circles end to end: their angles add up, their chords are known."""
    rod = page["arcs"]
    angles = np.array([0.8, -1.6, 2.4, 0.4])  # of the whole rod's length: a quarter of each is turned
    q = np.concatenate([angles, np.zeros(4)])
    position = np.asarray(eqx.filter_jit(walk)(Robot((rod,)), q).position)
    ends = position[np.searchsorted(rod.quadrature.points, np.linspace(0, 1, 5) - 1e-12)]
    chords, turned = np.diff(ends, axis=0), np.cumsum(angles / 4) - angles / 8
    length = 0.1 / 4 * np.sin(angles / 8) / (angles / 8)
    expected = length[:, None] * np.stack([np.cos(turned), 0 * turned, -np.sin(turned)], axis=1)
    np.testing.assert_allclose(chords, expected, atol=1e-15)


def test_the_pin_slides_and_then_turns(page: dict[str, Any]) -> None:
    """Of a weight w both ways at l: k x = w, and k θ = w l (cos θ − sin θ), here within both ranges."""
    robot, weight, length = page["slotted"], 0.02 * 9.81, 0.03
    angle = brentq(lambda q: 0.02 * q - weight * length * (np.cos(q) - np.sin(q)), 0, 1, xtol=1e-15)
    q = np.array([weight / 200, angle])
    here, motion = eqx.filter_jit(potential(robot))(q, jnp.zeros(0))
    np.testing.assert_allclose(here.gradient, 0.0, atol=1e-15)
    expected = [q[0] + length * np.cos(angle), 0, -length * np.sin(angle)]
    np.testing.assert_allclose(motion.position[0], expected, atol=1e-15)
    bent = 0.02 + weight * length * (np.cos(angle) + np.sin(angle))
    np.testing.assert_allclose(here.hessian, np.diag([200.0, bent]), atol=1e-12)


def test_the_hose_is_a_bar_less_what_is_hollow(page: dict[str, Any]) -> None:
    """Area and moments of a ring are differences of two discs', and so are mass and stiffness of the rods."""
    hose, tube = page["hose"], page["tube"]
    outside, inside = (
        eqx.tree_at(lambda rod: rod.section, hose, Circular(radius)) for radius in (tube.outer, tube.inner)
    )
    np.testing.assert_allclose(hose.mass(), outside.mass() - inside.mass(), rtol=1e-13)
    expected = np.asarray(outside.stiffness() - inside.stiffness())
    np.testing.assert_allclose(hose.stiffness(), expected, atol=1e-14 * expected.max() * 10)
