"""The energy term of docs/extending.md: it runs, its derivatives are right, and a rod feels the spring."""

import re
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.mechanics import potential

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    names: dict[str, Any] = {}
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
