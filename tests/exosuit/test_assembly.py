"""The worn exosuit as a robot, and its loading paths against those of a separate planar program."""

import json
from itertools import pairwise
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from exosight.errors import InputError
from exosight.exosuit.assembly import MAX_FORCE, QUADRATURE, ROD, Exosuit, assemble
from exosight.exosuit.finger import Finger
from exosight.exosuit.published import published
from exosight.exosuit.shapes import TABLE_I, CosineSum, ExosuitShape, Linear
from exosight.mechanics import Equilibria, PressureLine, Robot, SphereContact, drive, walk
from exosight.system.observation import Observation, observe
from exosight.system.system import stack_systems

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "planar_paths.json").read_text())
STEP = 0.05
"""The reference was followed in steps of this, and so are the paths here [N]."""
FORCES, F_NET, ANGLES = slice(0, 8), 8, slice(9, 12)
"""Places of the sensors."""


def exosuit(of: dict) -> Exosuit:
    shape = of["shape"]
    surface = ExosuitShape(Linear(shape["r0"], shape["r1"]), shape["length"])
    return Exosuit(surface, young=of["young"], contact_stiffness=of["contact_stiffness"])


@pytest.fixture(scope="module")
def robots() -> list[Robot]:
    return [assemble(exosuit(of)) for of in REFERENCE]


@pytest.fixture(scope="module")
def equilibria(robots: list[Robot]) -> Equilibria:
    """All six from 0 to 4 N in one batch."""
    u = STEP * np.arange(round(MAX_FORCE / STEP) + 1)
    return drive(robots, u[:, None])


@pytest.fixture(scope="module")
def poses(equilibria: Equilibria) -> Observation:
    systems = stack_systems([published(exosuit(of)) for of in REFERENCE])
    return jax.tree.map(np.asarray, observe(systems, equilibria.q))


# The robot


def test_sizes_are_the_published_ones(robots: list[Robot]) -> None:
    robot = robots[0]
    assert robot.dofs == 25
    assert robot[ROD].dofs == 22
    assert robot.frames == 42 + 8
    line, contact = robot.terms
    assert isinstance(line, PressureLine)
    assert isinstance(contact, SphereContact)
    assert len(contact.first.frames) == len(contact.first.radius) == 42
    assert len(contact.second.frames) == len(contact.second.radius) == 8


def test_at_rest_exosuit_and_finger_touch_at_the_base() -> None:
    """At x = 0, and nowhere else; a gap lifts the exosuit by just that."""
    positions = jax.jit(lambda robot: walk(robot, jnp.zeros(25)).position)
    for gap in (0.0, 0.002):
        robot = assemble(Exosuit(gap=gap))
        position = positions(robot)
        np.testing.assert_allclose(position[:42, 2], 0.0108 + 0.0058 + gap, rtol=1e-14)
        overlap = np.asarray(robot.terms[1].pairs(robot, position)[0])
        assert overlap[0, 0] == pytest.approx(-gap, abs=1e-16)
        assert np.delete(overlap.ravel(), 0).max() < -gap


def test_spheres_and_line_follow_the_surface(robots: list[Robot]) -> None:
    for robot, of in zip(robots, REFERENCE, strict=True):
        x, shape = robot[ROD].quadrature.points, of["shape"]
        surface = shape["r0"] + (shape["r1"] - shape["r0"]) * x
        line, contact = robot.terms
        np.testing.assert_allclose(contact.first.radius, surface, rtol=1e-14)
        # On the side away from the finger, one radius from the axis.
        np.testing.assert_allclose(line.offset, surface[:, None] * [0, 0, 1], rtol=1e-14)
        slope = (shape["r1"] - shape["r0"]) / shape["length"]
        np.testing.assert_allclose(line.slope, np.tile([0, 0, slope], (42, 1)), rtol=1e-12)


def test_every_exosuit_is_the_same_structure(robots: list[Robot]) -> None:
    """So that one compilation serves all shapes, stiffnesses and gaps."""
    wavy = ExosuitShape(CosineSum((-5.0, -1.0, -2.0, -1.0, 0.0, 0.0, -3.0)), 0.11)
    others = [assemble(Exosuit(wavy, young=1e5, gap=0.01)), assemble(Exosuit())]
    structures = {jax.tree.structure(robot) for robot in (*robots, *others)}
    assert len(structures) == 1


def test_defaults_are_the_published_exosuit() -> None:
    assert Exosuit() == Exosuit(TABLE_I, Finger(), young=300e3, contact_stiffness=1000.0, gap=0.0)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"young": -300e3}, "young: expected"),
        ({"young": float("nan")}, "young: expected"),
        ({"contact_stiffness": 0.0}, "contact_stiffness: expected"),
        ({"gap": -0.001}, "gap: expected"),
    ],
)
def test_impossible_exosuits_are_refused(changes: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Exosuit(**changes)


# Its loading paths


def test_every_pose_is_a_stable_minimum(equilibria: Equilibria) -> None:
    assert equilibria.converged.all()
    assert equilibria.residual.max() < 1e-10  # the solver's tolerance
    assert equilibria.min_eigenvalue.min() > 0


def before_first_snap(net_force: list[float]) -> int:
    """How many of the listed loads come before the first snap.

    A snap shows as a step of F_net more than twice as high as the step before it, unless that one is below
    0.01 N: there contact is just being made.
    """
    steps = np.diff(net_force)
    for i, (before, after) in enumerate(pairwise(steps)):
        if before > 0.01 and after > 2 * before:
            return i + 2
    return len(net_force)


def compare(poses: Observation, equilibria: Equilibria, robot: int, listed: dict) -> None:
    """Everything the reference lists at one load.

    A solve stops at 1e-10 relative in the energy norm; soft modes cost a factor of ten to a hundred. That is
    1e-9 rad, 1e-10 m, and at 1000 N/m 1e-7 of a force.
    """
    k = round(listed["u"] / STEP)
    at = (robot, k)
    assert poses.readings[at][F_NET] == pytest.approx(listed["net_force"], rel=1e-7)
    np.testing.assert_allclose(poses.readings[at][FORCES], listed["forces"], atol=1e-8)
    np.testing.assert_allclose(poses.readings[at][ANGLES], listed["joint_angles"], atol=1e-9)
    np.testing.assert_allclose(poses.axes["exosuit"][at][-1, ::2], listed["tip"][:2], atol=1e-10)
    assert equilibria.energy[at] == pytest.approx(listed["energy"], abs=1e-12)


@pytest.mark.parametrize("number", range(len(REFERENCE)))
def test_smooth_part_of_the_path_agrees(poses: Observation, equilibria: Equilibria, number: int) -> None:
    """Forces on C0…C7, F_net, joint angles, tip and energy, up to the first snap."""
    path = REFERENCE[number]["path"]
    smooth = before_first_snap([listed["net_force"] for listed in path])
    assert smooth >= 4
    for listed in path[:smooth]:
        compare(poses, equilibria, number, listed)


def test_smooth_parts_are_most_of_the_paths() -> None:
    """What the test above covers: one path of 21 loads has no snap at all."""
    smooth = [before_first_snap([listed["net_force"] for listed in of["path"]]) for of in REFERENCE]
    assert max(smooth) == 21
    assert sum(smooth) > 60


def test_beyond_a_snap_poses_agree_or_are_other_stable_ones(
    poses: Observation, equilibria: Equilibria
) -> None:
    """Where a path snaps it may land in another minimum; nearly always it is the reference's."""
    other = []
    for number, of in enumerate(REFERENCE):
        for listed in of["path"]:
            at = (number, round(listed["u"] / STEP))
            if poses.readings[at][F_NET] == pytest.approx(listed["net_force"], rel=1e-5):
                compare(poses, equilibria, number, listed)
            else:
                other.append(at)
                assert equilibria.converged[at]
                assert equilibria.min_eigenvalue[at] > 0
    assert len(other) <= 6, other  # of 126


def test_published_force_of_the_tapered_exosuit(poses: Observation) -> None:
    """R0 = 1 cm, R1 = 0.5 cm, L = 9.5 cm: 0.058, 0.22, 0.49 N at 1, 2.4, 4 N; in print 0.2 N at 2.4 N."""
    assert REFERENCE[0]["shape"] == {"family": "linear", "r0": 0.01, "r1": 0.005, "length": 0.095}
    for u, force in ((1.0, 0.058), (2.4, 0.22), (4.0, 0.49)):
        assert poses.readings[0, round(u / STEP), F_NET] == pytest.approx(force, rel=0.02)


# What is read off a pose


def test_forces_are_stiffness_times_overlap(poses: Observation) -> None:
    """Each label is the magnitude of the summed forces k d n on its sphere, from the positions alone."""
    finger = Finger()
    along = np.array([finger.centre_of_mass(i) / finger.lengths[i] for i in range(4)])
    nodes = poses.axes["finger"]
    base, end = nodes[:, :, :4], nodes[:, :, 1:]
    spheres = np.stack([base, base + along[:, None] * (end - base)], axis=3).reshape(*base.shape[:2], 8, 3)
    for number, of in enumerate(REFERENCE):
        shape, x = of["shape"], QUADRATURE.points
        reach = (shape["r0"] + (shape["r1"] - shape["r0"]) * x)[:, None] + np.array(finger.sphere_radii())
        apart = spheres[number, :, None] - poses.axes["exosuit"][number, :, :, None]  # (loads, 42, 8, 3)
        distance = np.linalg.norm(apart, axis=-1)
        depth = np.maximum(reach - distance, 0.0)
        total = of["contact_stiffness"] * np.einsum("lrs,lrsk->lsk", depth / distance, apart)
        # 1000 N/m times the round-off in positions.
        np.testing.assert_allclose(poses.forces[number], total, atol=1e-12)
    magnitudes = np.linalg.norm(poses.forces, axis=-1)
    np.testing.assert_allclose(poses.readings[..., FORCES], magnitudes, rtol=1e-14)
    np.testing.assert_allclose(poses.readings[..., F_NET], magnitudes[..., 1:].sum(axis=-1), rtol=1e-14)


def test_shape_is_where_the_frames_are(equilibria: Equilibria, poses: Observation) -> None:
    """The finger's nodes are links apart and turned by the joint angles; all is in the x–z plane."""
    segments, angles = np.diff(poses.axes["finger"], axis=2), poses.readings[..., ANGLES]
    lengths = np.linalg.norm(segments, axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(Finger().lengths, lengths.shape), rtol=1e-12)
    inclination = np.arctan2(-segments[..., 2], segments[..., 0])
    expected = np.cumsum(angles, axis=-1)[..., [0, 1, 2, 2]]
    np.testing.assert_allclose(inclination, expected, atol=1e-12)
    np.testing.assert_array_equal(angles, equilibria.q[..., -3:])
    np.testing.assert_allclose(poses.axes["exosuit"][..., 1], 0.0, atol=1e-16)
