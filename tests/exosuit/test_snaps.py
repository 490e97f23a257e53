"""Thin exosuits slip from sphere to sphere: what is not reported as a snap is a smooth path."""

from collections.abc import Sequence

import numpy as np
import pytest

from exosight.exosuit.assembly import MAX_FORCE, Exosuit, assemble, observe
from exosight.exosuit.scenarios import sample_shapes
from exosight.mechanics import Equilibria, Robot, drive, stack

LOADS = np.linspace(0, MAX_FORCE, 51)[:, None]


@pytest.fixture(scope="module")
def paths() -> tuple[Sequence[Robot], Equilibria, np.ndarray]:
    """Four exosuits of the eleven scenarios, three of which snap, driven 0 → 4 N; and their F_net [N]."""
    robots = [assemble(Exosuit(s.shape)) for s in sample_shapes(1, seed=0)]
    robots = [robots[i] for i in (0, 1, 3, 5)]
    found = drive(robots, LOADS)
    assert found.converged.all()
    return robots, found, np.asarray(observe(stack(robots), np.asarray(found.q)).net_force)


def test_thick_exosuits_do_not_snap_and_thin_ones_do(paths: tuple) -> None:
    _, found, _ = paths
    assert not found.snapped[1].any()
    assert np.all(found.snapped[[0, 2, 3]].sum(axis=1) >= 5)
    assert not found.snapped[:, 0].any()  # there is no step before the first load


def test_a_step_without_a_snap_gets_smaller_when_it_is_divided(paths: tuple) -> None:
    """Of the ten largest changes of F_net that are not reported, each is the sum of many small ones."""
    robots, found, force = paths
    change = np.abs(np.diff(force, axis=1))
    change[found.snapped[:, 1:]] = 0
    for place in np.argsort(change.ravel())[-10:]:
        i, step = np.unravel_index(place, change.shape)
        between = np.linspace(LOADS[step, 0], LOADS[step + 1, 0], 17)[:, None]
        fine = drive([robots[i]], between, q=np.asarray(found.q)[i : i + 1, step])
        assert fine.converged.all()
        parts = np.abs(np.diff(np.asarray(observe(stack([robots[i]]), np.asarray(fine.q)).net_force)[0]))
        # A jump would leave one part with nearly all; a smooth path, steepest near a fold, leaves a quarter.
        assert parts.max() < 0.5 * change[i, step] + 1e-6, (i, step)


def test_a_snap_stays_as_large_as_it_is_when_the_step_is_divided(paths: tuple) -> None:
    """And the pose, not the force alone, jumps: the largest sub-step keeps most of the change of q."""
    robots, found, _ = paths
    q = np.asarray(found.q)
    moved = np.linalg.norm(np.diff(q, axis=1), axis=2)
    moved[~found.snapped[:, 1:]] = 0
    for place in np.argsort(moved.ravel())[-5:]:
        i, step = np.unravel_index(place, moved.shape)
        between = np.linspace(LOADS[step, 0], LOADS[step + 1, 0], 17)[:, None]
        fine = drive([robots[i]], between, q=q[i : i + 1, step])
        parts = np.linalg.norm(np.diff(np.asarray(fine.q)[0], axis=0), axis=1)
        assert fine.snapped.any()
        assert parts.max() > 0.5 * moved[i, step]
