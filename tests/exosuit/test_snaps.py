"""Thin exosuits slip from sphere to sphere: where they snap and where they land is theirs, not the step's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.exosuit.assembly import MAX_FORCE, Exosuit, assemble
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Equilibria, Robot, Snap, locate_snaps
from exosight.mechanics.continuation_state import ContinuationState
from exosight.mechanics.metric import Metric, metric_of
from exosight.mechanics.path_step import begun, layout_of, stepper

STEPS = 0.1, 0.5


def there_and_back(step: float) -> np.ndarray:
    """0 → 4 → 0 N."""
    up = np.linspace(0, MAX_FORCE, round(MAX_FORCE / step) + 1)
    return np.concatenate([up, up[-2::-1]])[:, None]


@pytest.fixture(scope="module")
def robots() -> list[Robot]:
    """Four exosuits of the eleven scenarios, three of which snap."""
    robots = [assemble(Exosuit(s.shape)) for s in sample_shapes(1, seed=0)]
    return [robots[i] for i in (0, 1, 3, 5)]


@pytest.fixture(scope="module")
def paths(robots: list[Robot]) -> dict[float, tuple[Equilibria, list[list[Snap]]]]:
    return {step: locate_snaps(robots, there_and_back(step)) for step in STEPS}


def test_thick_exosuits_do_not_snap_and_thin_ones_do(paths: dict) -> None:
    found, snaps = paths[0.1]
    assert found.converged.all()
    assert not found.snapped[1].any()
    assert all(len(snaps[i]) >= 5 for i in (0, 2, 3))
    assert not found.snapped[:, 0].any()  # there is no step before the first load


def test_states_at_common_loads_are_the_same(robots: list[Robot], paths: dict) -> None:
    """To 1e-9 of the pose in the elastic norm, ten times what a pose is solved to; none is tied."""
    fine, coarse = (paths[step][0] for step in STEPS)
    assert not fine.tied.any()
    assert not coarse.tied.any()
    for i, robot in enumerate(robots):
        factor = np.linalg.cholesky(np.asarray(metric_of(robot)))
        same, expected = fine.q[i, ::5] @ factor, coarse.q[i] @ factor
        largest = np.linalg.norm(expected, axis=1).max()
        assert np.linalg.norm(same - expected, axis=1).max() < 1e-9 * largest


def test_snaps_are_where_they_are_and_go_downhill(paths: dict) -> None:
    fine, coarse = (paths[step][1] for step in STEPS)
    for one, other in zip(fine, coarse, strict=True):
        assert all(snap.energy > 0 for snap in one)
        # A jump that differs little from a smooth change (measured: 0.4 ‰ of the largest energy) may be
        # passed within a coarse step; the poses at common loads are the same all the same, as tested above.
        largest = max((snap.energy for snap in one), default=0.0)
        loads = [[s.load[0] for s in snaps if s.energy > 1e-3 * largest] for snaps in (one, other)]
        # Ends are located to 1e-7 of the pose's forces, which may be 0.1 mN of a load that does little there.
        np.testing.assert_allclose(*loads, atol=1e-4)


def test_a_robot_without_loads_left_reports_no_snaps() -> None:
    """It is stepped beside others, here on the way to a load that is not meant; full records of it would
    stop them for ever."""
    robot = assemble(Exosuit(sample_shapes(1, seed=0)[8].shape))
    step = stepper(
        robot,
        Metric.of(robot),
        None,
        jnp.zeros(0),
        jnp.array([[4.0]]),
        jnp.array(1),
        jnp.array(1e-10),
        jnp.array(5000),
    )
    idle = begun(robot.dofs, 1, (), 1)._replace(load=np.array(1))
    after = jax.jit(lambda state: jax.lax.fori_loop(0, 600, lambda _, at: step(at), state))(idle)
    state: ContinuationState = layout_of(robot.dofs, 1, ()).state.unpack(after.row)
    assert float(state.t) > 0.2  # it moves, and snaps on the way: seven times without the rule
    assert int(after.snaps) == 0
    assert int(after.load) == 1


def test_a_way_to_the_load_that_failed_is_not_tried_again_from_the_same_pose() -> None:
    """At 2.87 N a corner of this exosuit's branch, as seen from the pose before it, lies beyond the load, and
    from there Newton's method fails at the load: one was tried after the other for 5,000 evaluations."""
    robot = assemble(Exosuit(sample_shapes(125, seed=0)[1355].shape))
    found, _ = locate_snaps([robot], np.linspace(0, 2.96, 38)[:, None])
    assert found.converged.all()
    assert found.iterations.max() < 500
