"""Contact between spheres: closed forms for two of them, symmetry, and how far a step may reach."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exosight.mechanics import Link, Motion, Revolute, Robot, SphereContact
from exosight.mechanics.contact import Spheres

ARM, HEIGHT, STIFFNESS = 0.05, 0.018, 1000.0
RADII = (0.012, 0.008)
"""An arm of 5 cm on a hinge about y carries the first sphere over the second, 18 mm below it at q = 0."""


def press(
    stiffness: float = STIFFNESS, post: tuple[float, ...] = (ARM, 0.0, -HEIGHT), swap: bool = False
) -> Robot:
    arm = Link("arm", ARM, jnp.array([[ARM, 0.0, 0.0]]), joint=Revolute((0.0, 1.0, 0.0)))
    ground = Link("post", 0.0, jnp.array([post]))
    spheres = [Spheres(((name, 0),), jnp.array([r])) for name, r in zip(("arm", "post"), RADII, strict=True)]
    return Robot((arm, ground), (SphereContact(*(spheres[::-1] if swap else spheres), jnp.array(stiffness)),))


def contact(robot: Robot) -> SphereContact:
    return robot.terms[0]


def gap_and_derivatives(q: float) -> tuple[float, float, float]:
    """Distance r of the centres over the hinge angle q, r′ and r″, from the law of cosines."""
    arm, reach = ARM, np.hypot(ARM, HEIGHT)
    angle = q - np.arctan2(HEIGHT, ARM)  # between the arm and the line from the hinge to the post
    r = np.sqrt(arm**2 + reach**2 - 2 * arm * reach * np.cos(angle))
    first = arm * reach * np.sin(angle) / r
    return r, first, (arm * reach * np.cos(angle) - first**2) / r


@settings(deadline=None, max_examples=25)
@given(st.floats(-0.3, 0.3))
def test_two_spheres_in_closed_form(evaluate: Callable, q: float) -> None:
    """Π = ½ k d², its gradient −k d r′ and its Hessian k (r′² − d r″), with d = R₁ + R₂ − r."""
    here = evaluate(press(), np.array([q]), np.zeros(0))[0]
    r, first, second = gap_and_derivatives(q)
    depth = max(sum(RADII) - r, 0.0)
    touching = depth > 0
    # The overlap is a difference of distances of 0.02 m, good to 1e-17 m; r″ divides by it once more.
    assert float(here.energy) == pytest.approx(0.5 * STIFFNESS * depth**2, rel=1e-10, abs=1e-14)
    assert float(here.gradient[0]) == pytest.approx(-STIFFNESS * depth * first, rel=1e-10, abs=1e-13)
    expected = STIFFNESS * (first**2 - depth * second) * touching
    assert float(here.hessian[0, 0]) == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_force_is_stiffness_times_overlap_along_the_normal(motion: Callable) -> None:
    """At rest the arm's sphere sits 18 mm above the post's: overlap 2 mm, 2 N downwards on the post."""
    robot = press()
    position = motion(robot, np.zeros(1)).position
    overlap, normal, distance = contact(robot).pairs(robot, position)
    assert float(overlap[0, 0]) == pytest.approx(0.002, abs=1e-16)
    assert float(distance[0, 0]) == pytest.approx(HEIGHT, rel=1e-14)
    np.testing.assert_allclose(normal[0, 0], [0.0, 0.0, 1.0], atol=1e-14)
    np.testing.assert_allclose(contact(robot).forces(robot, position)[1], [[0.0, 0.0, -2.0]], atol=1e-12)


@pytest.mark.parametrize("lift", [0.003, 0.1])
def test_open_spheres_exert_nothing(evaluate: Callable, lift: float) -> None:
    robot = press(post=(ARM, 0.0, -HEIGHT - lift))
    here, motion = evaluate(robot, np.zeros(1), np.zeros(0))
    assert float(here.energy) == 0
    assert float(here.gradient[0]) == 0
    assert float(here.hessian[0, 0]) == 0
    np.testing.assert_array_equal(contact(robot).forces(robot, motion.position)[1], 0.0)


def test_it_does_not_matter_which_set_comes_first(evaluate: Callable) -> None:
    one, other = (evaluate(press(swap=swap), np.array([0.05]), np.zeros(0))[0] for swap in (False, True))
    assert float(one.energy) > 0
    for mine, theirs in zip(*map(jax.tree.leaves, (one, other)), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-13)


def test_coincident_centres_push_nowhere(evaluate: Callable) -> None:
    """There is no normal, so no force; energy and derivatives stay finite."""
    robot = press(post=(ARM, 0.0, 0.0))
    here, motion = evaluate(robot, np.zeros(1), np.zeros(0))
    assert float(here.energy) == pytest.approx(0.5 * STIFFNESS * sum(RADII) ** 2, rel=1e-12)
    assert float(here.gradient[0]) == 0
    assert np.isfinite(here.hessian).all()
    np.testing.assert_array_equal(contact(robot).forces(robot, motion.position)[1], 0.0)


def linear_overlap(robot: Robot, at: Motion, step: float) -> float:
    """The overlap after `step` if the spheres went on in their present directions."""
    overlap, normal, _ = contact(robot).pairs(robot, at.position)
    moved = np.asarray(at.point_jacobian()[:, :, 0]) * step
    return float(overlap[0, 0] - normal[0, 0] @ (moved[0] - moved[1]))


def reach(robot: Robot, at: Motion, step: float) -> float:
    return float(contact(robot).max_step_fraction(robot, at, jnp.array([step])))


@pytest.mark.parametrize("step", [0.5, 0.05, 5.0])
def test_a_step_ends_where_the_gap_closes(motion: Callable, step: float) -> None:
    """… and 0.3 % of the distance into it, so that the next expansion feels the contact."""
    robot, q = press(), -0.2
    at = motion(robot, np.array([q]))
    fraction = reach(robot, at, step)
    distance = gap_and_derivatives(q)[0]
    assert linear_overlap(robot, at, 0.0) < 0
    assert linear_overlap(robot, at, fraction * step) == pytest.approx(0.003 * distance, rel=1e-9)
    # Longer steps are cut to the same place.
    assert fraction * step == pytest.approx(reach(robot, at, 1.0), rel=1e-12)


@pytest.mark.parametrize(("q", "step"), [(-0.2, -0.5), (0.05, 0.5), (0.05, -0.5)])
def test_steps_away_or_already_in_contact_are_free(motion: Callable, q: float, step: float) -> None:
    robot = press()
    assert reach(robot, motion(robot, np.array([q])), step) == np.inf
