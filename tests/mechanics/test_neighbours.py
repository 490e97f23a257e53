"""Problems that PyElastica and SoRoMoX, which others wrote, solve too: the settings of benchmarks/, coarser.

Skipped where the extra `compare` is not installed; `make test` installs it.
"""

from types import ModuleType

import numpy as np
import pytest

WHY = "needs the extra 'compare': pip install -e '.[compare]'"


@pytest.fixture(scope="module")
def rest(pytestconfig: pytest.Config) -> ModuleType:
    """benchmarks.rest, with PyElastica's loops left to Python: compiling takes 50 s, running them here 10."""
    config = pytest.importorskip("numba").config
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(config, "DISABLE_JIT", True)
        pytest.importorskip("elastica", reason=WHY)
        patch.syspath_prepend(pytestconfig.rootpath)
        import benchmarks.rest

        return benchmarks.rest


@pytest.fixture(scope="module")
def motion(pytestconfig: pytest.Config) -> ModuleType:
    """benchmarks.motion."""
    pytest.importorskip("soromox", reason=WHY)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(pytestconfig.rootpath)
        import benchmarks.motion

        return benchmarks.motion


def test_pyelastica_bends_the_same_cantilever(rest: ModuleType) -> None:
    """Deflected by half of its length: both programs against the differential equation, and each other."""
    from benchmarks.planar import LENGTH, TIP_FORCE, at_rest

    exact, thins = at_rest(TIP_FORCE).tip, at_rest(TIP_FORCE, thins=True).tip
    ours, theirs = rest.Exosight(5, False)().tip, rest.PyElastica(10, False)().tip
    assert np.linalg.norm(thins - exact) == pytest.approx(
        1.7e-4 * LENGTH, rel=0.05
    )  # as docs/validation.md says
    # Five quadratic elements: 2.7e-7. Ten of theirs, of second order: 1.6e-3.
    assert np.linalg.norm(ours - exact) < 5e-7 * LENGTH
    assert np.linalg.norm(theirs - thins) < 2e-3 * LENGTH
    # The thinning of its section is 1.7e-4 more.
    assert np.linalg.norm(theirs - ours) < 2.2e-3 * LENGTH


def test_pyelastica_is_held_by_the_same_sphere(rest: ModuleType) -> None:
    """The force on a sphere below the rod, which carries 1.7 times the force at the tip."""
    from benchmarks.planar import PRESS, at_rest

    exact = at_rest(-PRESS, sphere=True).push
    ours, theirs = rest.Exosight(6, True)().push, rest.PyElastica(11, True)().push
    assert exact == pytest.approx(1.74 * PRESS, rel=1e-3)
    slides = at_rest(-PRESS, sphere=True, slides=True, thins=True).push
    assert 1 - slides / exact == pytest.approx(0.006, abs=5e-4)  # as docs/validation.md says
    # Shear and stretch jump at the sphere, which continuous strains round off: 8e-5, of first order.
    assert ours == pytest.approx(exact, rel=1.2e-4)
    # Its force acts a part of an element from the touch: 1 % with eleven elements, and 0.6 % for the slip.
    assert theirs == pytest.approx(exact, rel=0.015)


def test_soromox_moves_the_same_rod(motion: ModuleType) -> None:
    """Half a second of fall and swing with all six strains: the same coordinates, on the same points."""
    theirs = motion.their_rollout(motion.SPACE, 5e-4)()
    ours = motion.Exosight(motion.SPACE, step=1e-3)()
    assert np.abs(theirs).max() > 1.5  # radians
    # Fourth order at 1 ms: 1e-6 of the largest; theirs errs by 1e-9.
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=3e-6 * np.abs(theirs).max())
