"""What docs/validation.md says of convergence, on less than it measures.

That the Magnus step is of fourth order is tested beside the walk, the bases' orders beside the bases,
Newton's quadratic end beside the equilibria.
"""

import numpy as np
import pytest

from exosight.exosuit.assembly import MAX_FORCE, Exosuit, assemble
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Gauss, Legendre, drive


def test_quadrature_at_rest_converges_at_fourth_order(
    monkeypatch: pytest.MonkeyPatch, pytestconfig: pytest.Config
) -> None:
    """Points are steps: with more elements or more points in each, the error falls with the fourth power."""
    monkeypatch.syspath_prepend(pytestconfig.rootpath)
    from benchmarks.convergence import tips

    def tip(elements: int, points: int) -> np.ndarray:
        return tips(Legendre(3), Gauss(elements, points, element_ends=True), [1.0, 2.0, 5.0])[-1]

    exact = tip(16, 12)  # 208 steps: a thousandth of the errors below
    few, more, denser = (np.linalg.norm(tip(*rule) - exact) for rule in ((4, 5), (8, 5), (4, 11)))
    # 24 steps, then 48: 4 in the limit. Uneven steps within an element still show a little.
    assert np.log2(few / more) == pytest.approx(4, abs=0.2)
    assert np.log2(few / denser) == pytest.approx(4, abs=0.2)


def test_at_most_five_iterations_an_equilibrium_along_the_paper_path() -> None:
    """The median over one shape of each scenario, 0 → 4 → 0 N in steps of 0.05 N; all converge."""
    robots = [assemble(Exosuit(sampled.shape)) for sampled in sample_shapes(1, seed=0)]
    up = np.linspace(0, MAX_FORCE, 81)
    found = drive(robots, np.concatenate([up, up[-2::-1]])[:, None])
    assert found.converged.all()
    assert np.median(found.iterations) <= 5
