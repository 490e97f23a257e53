"""A finger of rigid capsules that is pressed by another one, by exosight and by MuJoCo: benchmarks.rigid.

Skipped where the extra `compare` is not installed; `make test` installs it.
"""

from types import ModuleType

import numpy as np
import pytest


@pytest.fixture(scope="module")
def rigid(pytestconfig: pytest.Config) -> ModuleType:
    """benchmarks.rigid."""
    pytest.importorskip("mujoco", reason="needs the extra 'compare': pip install -e '.[compare]'")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(pytestconfig.rootpath)
        import benchmarks.rigid

        return benchmarks.rigid


def test_mujoco_bends_the_same_finger_with_the_same_force(rigid: ModuleType) -> None:
    """Angles of 0.32 and 0.08 rad under 0.3 N: both programs against rigid bodies, and each other."""
    exact, ours = rigid.pressed(), rigid.Finger(1e4)()
    theirs = rigid.MuJoCo(rigid._finger_xml(), *rigid.SETTINGS["solref 2 ms"], rigid._bent)()
    # Exosight's contact gives by 0.3 N / 1e4 N/m = 30 µm, at 55 mm from the first hinge: 5e-4 rad at most.
    np.testing.assert_allclose(ours, exact, rtol=0, atol=5e-4)
    # MuJoCo's contact is stiffer: 3e-5 rad, as docs/validation.md has it.
    np.testing.assert_allclose(theirs, exact, rtol=0, atol=5e-5)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=5e-4)
