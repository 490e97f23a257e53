"""Forces made by known rules, so that each baseline's error is known."""

from collections.abc import Callable

import numpy as np
import pytest
from schemas import mixed_schema

from exosight.dataset import Frames, Manifest, Split, make_split, new_manifest
from exosight.evaluation.baselines import evaluate_baselines
from exosight.exosuit.published import PublishedDesigns
from exosight.system.camera import Camera
from exosight.system.design import Design
from exosight.system.schema import Schema

PUBLISHED = PublishedDesigns(camera=Camera(width=4, height=4))
DESIGNS = PUBLISHED.draw(4, seed=0)
U = np.concatenate([np.arange(0, 4, 0.1), np.arange(4, 0, -0.1)])
WAY = np.where(np.arange(len(U)) <= len(U) // 2, 1, -1)

Rule = Callable[[np.ndarray, np.ndarray, Design], np.ndarray]


def frames_of(
    schema: Schema, designs: tuple[Design, ...], commands: np.ndarray, labels: np.ndarray
) -> Frames:
    """One path of commands for every design, and what the estimated sensors read on it."""
    count, steps = len(labels), len(commands)
    sensors = np.zeros((count, len(schema.sensors)), np.float32)
    sensors[:, schema.output_indices()] = labels
    return Frames(
        schema=schema,
        images=np.zeros((count, 4, 4), np.uint8),
        sensors=sensors,
        commands=np.tile(commands, (len(designs), 1)).astype(np.float32),
        pose=np.zeros((count, 25)),
        design=np.repeat([d.number for d in designs], steps).astype(np.int32),
        family=np.repeat([d.family for d in designs], steps).astype(np.int8),
        scenario=np.repeat([d.scenario for d in designs], steps).astype(np.int8),
        step=np.tile(np.arange(steps), len(designs)).astype(np.int32),
    )


def manifest_of(schema: Schema, designs: tuple[Design, ...]) -> Manifest:
    return new_manifest(
        config={}, seed=0, system=schema.system, schema=schema, description=None,
        camera=Camera(width=4, height=4), dofs=25, families=PUBLISHED.families,
        scenarios=PUBLISHED.scenarios, designs=designs, chunks=[], dropped={},
    )  # fmt: skip


def made(rule: Rule) -> tuple[Frames, Manifest]:
    """Every design loaded and unloaded; `rule` gives the force on each contact by u, direction and design."""
    force = np.concatenate([rule(U, WAY, design) for design in DESIGNS])
    labels = np.outer(force, np.arange(1, 8))
    schema = PUBLISHED.schema
    return frames_of(schema, DESIGNS, U[:, None], labels), manifest_of(schema, DESIGNS)


def judged(rule: Rule, protocol: str = "design") -> tuple[dict, Frames, Split]:
    frames, manifest = made(rule)
    split = make_split(frames, protocol, 0)
    return evaluate_baselines(frames, split, manifest), frames, split


def test_the_mean_misses_by_the_standard_deviation() -> None:
    found, frames, split = judged(lambda u, way, design: u)
    mean = frames.labels[split.train].mean(axis=0)
    expected = np.sqrt(np.mean((frames.labels[split.test] - mean) ** 2, axis=0))
    # Sums in single precision.
    assert [c.rmse for c in found["mean of training"].outputs] == pytest.approx(expected.tolist(), rel=1e-5)
    assert np.isnan(found["mean of training"].r.mean)


def test_load_and_direction_tell_forces_that_depend_on_nothing_else() -> None:
    found, _, _ = judged(lambda u, way, design: u**2 + 3.0 * (way < 0))
    for name in ("u only", "u and geometry"):
        # The bins lie on the loads, which single precision keeps to 1e-7 of forces up to 133 N.
        assert max(c.rmse for c in found[name].outputs) < 1e-3
    assert found["mean of training"].rmse.mean > 1


def test_geometry_tells_what_the_load_does_not() -> None:
    found, _, _ = judged(lambda u, way, design: u * (PUBLISHED.exosuit(design).shape.length - 0.06))
    assert found["u and geometry"].rmse.mean < 0.7 * found["u only"].rmse.mean
    assert found["u only"].rmse.mean < found["mean of training"].rmse.mean


def test_a_design_that_was_learned_from_is_its_own_neighbour() -> None:
    found, _, _ = judged(lambda u, way, design: u * (1 + design.number), "frame")
    # Forces are straight in u: only the few frames beyond the ends of a path are off, by a step or two.
    assert found["u and geometry"].r.mean > 0.999
    assert found["u only"].r.mean < 0.9


def test_the_test_part_is_not_learned_from() -> None:
    frames, manifest = made(lambda u, way, design: u)
    split = make_split(frames, "design", 0)
    before = evaluate_baselines(frames, split, manifest)
    frames.sensors[split.test] *= 2
    after = evaluate_baselines(frames, split, manifest)
    for name in before:
        for old, new in zip(before[name].outputs, after[name].outputs, strict=True):
            assert new.largest_estimated == old.largest_estimated
            assert new.largest_true == pytest.approx(2 * old.largest_true)


def test_the_nearest_commands_of_several_channels_are_known() -> None:
    """What depends on two commands is found between the frames of others; what is random in them is not."""
    schema = mixed_schema(4, 4)
    designs = tuple(Design(number, 0, 0, {}) for number in range(10))
    rng = np.random.default_rng(0)
    steps = 60
    frames = frames_of(schema, designs, np.zeros((steps, 2)), np.zeros((steps * 10, 4)))
    frames.commands[:] = rng.uniform(0, [80, 4], frames.commands.shape)
    pressure, cable = (frames.commands / [80, 4]).T
    values = np.stack([pressure, pressure - cable, cable, rng.random(len(cable))], axis=1)
    frames.sensors[:, schema.output_indices()] = values
    found = evaluate_baselines(frames, make_split(frames, "design", 0), manifest_of(schema, designs))
    assert list(found) == ["mean of training", "commands only"]
    # 360 frames lie about 1/20 of a range apart, in which these rise by as much.
    assert max(found["commands only"].outputs[i].rmse for i in range(3)) < 0.1
    assert abs(found["commands only"].outputs[3].r) < 0.3
