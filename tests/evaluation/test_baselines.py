"""Forces made by known rules, so that each baseline's error is known."""

from collections.abc import Callable

import numpy as np
import pytest

from exosight.dataset import Frames, Manifest, Split, make_split, new_manifest
from exosight.evaluation.baselines import evaluate_baselines
from exosight.exosuit.scenarios import SampledShape, sample_shapes
from exosight.exosuit.shapes import FAMILIES
from exosight.system.camera import Camera

SHAPES = sample_shapes(4, seed=0)
U = np.concatenate([np.arange(0, 4, 0.1), np.arange(4, 0, -0.1)])
LOADING = np.where(np.arange(len(U)) < len(U) // 2, 1, -1)

Rule = Callable[[np.ndarray, np.ndarray, SampledShape], np.ndarray]


def made(rule: Rule) -> tuple[Frames, Manifest]:
    """Every shape loaded and unloaded; `rule` tells the force on each contact from u, direction and shape."""
    count = len(SHAPES) * len(U)
    force = np.concatenate([rule(U, LOADING, shape) for shape in SHAPES])
    families = [list(FAMILIES).index(shape.shape.surface.family) for shape in SHAPES]
    frames = Frames(
        images=np.zeros((count, 4, 4), np.uint8),
        forces=np.outer(force, np.arange(1, 8)).astype(np.float32),
        u=np.tile(U, len(SHAPES)).astype(np.float32),
        pose=np.zeros((count, 25)),
        shape_id=np.repeat([s.shape_id for s in SHAPES], len(U)).astype(np.int32),
        family=np.repeat(families, len(U)).astype(np.int8),
        scenario=np.repeat([s.scenario for s in SHAPES], len(U)).astype(np.int8),
        loading=np.tile(LOADING, len(SHAPES)).astype(np.int8),
    )
    manifest = new_manifest(
        config={}, seed=0, camera=Camera(width=4, height=4), load_limit=4.0, dofs=25,
        shapes=SHAPES, chunks=[], dropped={},
    )  # fmt: skip
    return frames, manifest


def judged(rule: Rule, protocol: str = "shape") -> tuple[dict, Frames, Split]:
    frames, manifest = made(rule)
    split = make_split(frames, protocol, 0)
    return evaluate_baselines(frames, split, manifest), frames, split


def test_the_mean_misses_by_the_standard_deviation() -> None:
    found, frames, split = judged(lambda u, way, shape: u)
    mean = frames.forces[split.train].mean(axis=0)
    expected = np.sqrt(np.mean((frames.forces[split.test] - mean) ** 2, axis=0))
    # Sums in single precision.
    assert [c.rmse for c in found["mean of training"].contacts] == pytest.approx(expected.tolist(), rel=1e-5)
    assert np.isnan(found["mean of training"].r.mean)


def test_load_and_direction_tell_forces_that_depend_on_nothing_else() -> None:
    found, _, _ = judged(lambda u, way, shape: u**2 + 3.0 * (way < 0))
    for name in ("u only", "u and geometry"):
        # The bins lie on the loads, which single precision keeps to 1e-7 of forces up to 133 N.
        assert max(c.rmse for c in found[name].contacts) < 1e-3
    assert found["mean of training"].rmse.mean > 1


def test_geometry_tells_what_the_load_does_not() -> None:
    found, _, _ = judged(lambda u, way, shape: u * (shape.shape.length - 0.06))
    assert found["u and geometry"].rmse.mean < 0.7 * found["u only"].rmse.mean
    assert found["u only"].rmse.mean < found["mean of training"].rmse.mean


def test_a_shape_that_was_learned_from_is_its_own_neighbour() -> None:
    found, _, _ = judged(lambda u, way, shape: u * (1 + shape.shape_id), "frame")
    # Forces are straight in u: only the few frames beyond the ends of a path are off, by a step or two.
    assert found["u and geometry"].r.mean > 0.999
    assert found["u only"].r.mean < 0.9


def test_the_test_part_is_not_learned_from() -> None:
    frames, manifest = made(lambda u, way, shape: u)
    split = make_split(frames, "shape", 0)
    before = evaluate_baselines(frames, split, manifest)
    frames.forces[split.test] *= 2
    after = evaluate_baselines(frames, split, manifest)
    for name in before:
        for old, new in zip(before[name].contacts, after[name].contacts, strict=True):
            assert new.largest_estimated == old.largest_estimated
            assert new.largest_true == pytest.approx(2 * old.largest_true)
