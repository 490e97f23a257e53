"""The law that knows its plant, on a plant that snaps in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy import SLOPE, controller, force_path

from exosight.control import ControllerConfig, ForcePath, Scheduled
from exosight.errors import InputError

unhurried = settings(deadline=None)  # a busy machine is no failure
anything = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(allow_nan=False, allow_infinity=False)
ROUND_OFF = 1e-12  # of sums of numbers up to 5 N

JUMP = 0.1  # [N], on C2
UP, DOWN = 3.05, 2.55  # where it jumps [N], between points of the paths


def snapping(high: bool, u: float) -> tuple[bool, np.ndarray]:
    """Whether the pose is beyond the jump at u, coming from there, and its forces on C1…C7."""
    high = u > UP or (high and u > DOWN)
    forces = np.zeros(7)
    forces[2] = SLOPE * max(u, 0.0)
    forces[1] = JUMP * high
    return high, forces


def walk(u: np.ndarray) -> ForcePath:
    """The path over u, from the pose that its first point has on the way up."""
    high, states, forces = bool(u[0] > UP), [], []
    for load in u.tolist():
        high, pressed = snapping(high, load)
        states.append(high)
        forces.append(pressed)
    return force_path(u, np.array(forces), np.append(False, np.diff(states)))


def config(limit: float = 0.6, rate: float = 10.0) -> ControllerConfig:
    return controller(
        walk(np.round(np.linspace(0.0, 5.0, 51), 3)),
        walk(np.round(np.linspace(5.0, -1.0, 61), 3)),
        limit,
        rate,
    )


def drive(law: Scheduled, targets: list[float], delay: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """F_net and u of each step; measurements reach the law so many steps late."""
    law.reset()
    high, u, seen = False, 0.0, [(0.0, np.zeros(7))]
    for target in targets:
        at, contacts = seen[max(0, len(seen) - 1 - delay)]
        u = law.next(target, float(contacts.sum()), contacts, at)
        high, forces = snapping(high, u)
        seen.append((u, forces))
    return np.array([forces.sum() for _, forces in seen[1:]]), np.array([u for u, _ in seen[1:]])


def test_the_inverse_of_a_path_gives_back_its_loads():
    for path in (config().loading, config().unloading):
        pressing = (path.u > 0) & ~np.append(path.snapped[1:], False)
        np.testing.assert_allclose(
            np.interp(path.controlled[pressing], *path.inverse()), path.u[pressing], atol=1e-8
        )


def test_a_force_within_a_jump_is_given_the_load_just_beyond_it():
    up, down = config().loading, config().unloading
    assert np.interp(SLOPE * UP + 0.5 * JUMP, *up.inverse()) == pytest.approx(3.1, abs=1e-6)
    assert np.interp(SLOPE * DOWN + 0.5 * JUMP, *down.inverse()) == pytest.approx(2.5, abs=1e-6)


def test_slopes_are_those_of_the_plant_and_none_across_a_jump():
    slopes = config().loading.slopes.sum(axis=1)
    jump = int(np.flatnonzero(config().loading.snapped)[0]) - 1
    assert slopes[jump] == 0
    np.testing.assert_allclose(np.delete(slopes, jump), SLOPE, atol=1e-9)  # (F₂ − F₁) / 0.1 N


@unhurried
@given(st.floats(0.02, 0.29))
def test_where_nothing_jumps_it_is_on_target_as_soon_as_the_rate_allows(target):
    force, u = drive(Scheduled(config()), [target] * 8)
    steps = math.ceil(target / SLOPE - 1e-9)  # of 1 N each
    # In the band of 5 %, what is left halves from step to step.
    late = np.abs(force[steps - 1 :] - target)
    assert np.all(late <= 0.05 * target * 0.5 ** np.arange(len(late)) + 1e-9)
    assert u.max() <= target / SLOPE + 1e-6


def test_a_target_beyond_the_jump_is_reached_by_passing_it_and_coming_back():
    force, u = drive(Scheduled(config()), [0.38] * 12)
    lowest_beyond = SLOPE * UP + JUMP  # the plant has no way to 0.38 N that shows less
    assert lowest_beyond <= force.max() <= lowest_beyond + SLOPE * 0.1
    np.testing.assert_allclose(force[5:], 0.38, rtol=0.01)  # the last few by halves
    assert u[-1] < UP


def test_a_target_that_is_never_at_rest_is_answered_with_less_and_no_swinging():
    between = 0.33  # above 0.305 N before the jump up, below 0.355 N before the jump down
    force, _ = drive(Scheduled(config()), [between] * 30)
    assert np.ptp(force[5:]) < 1e-6
    assert 0.28 < force[-1] < SLOPE * UP


def test_a_jump_that_comes_later_than_on_the_path_is_passed_all_the_same():
    law = Scheduled(config())
    u = law.next(0.4, 0.2, at=2.0)
    for _ in range(10):
        u = law.next(0.4, 0.299)  # what the path has just before its jump
    assert u > 3.5


def test_a_jump_over_the_target_is_remembered_and_not_passed_again():
    law = Scheduled(config())

    def late_jump(high, u):  # the plant jumps down where the path still rests: at 2.95 N instead of 2.55 N
        high = u > UP or (high and u > 2.95)
        return high, SLOPE * u + JUMP * high

    high, force, falls, history = False, 0.0, 0, []
    for _ in range(80):
        u = law.next(0.38, force)
        before = high
        high, force = late_jump(high, u)
        falls += before and not high
        history.append(force)
    assert falls <= 2
    assert np.ptp(history[-20:]) < 0.01  # it rests, at what this plant can hold
    assert high


@unhurried
@given(
    st.lists(
        st.tuples(finite, anything, st.none() | st.lists(anything, min_size=7, max_size=7), anything),
        max_size=30,
    )
)
def test_nothing_measured_takes_u_beyond_amplitude_or_rate(steps):
    law, before = Scheduled(config()), 0.0
    for target, measured, contacts, at in steps:
        with np.errstate(over="ignore", invalid="ignore"):
            u = law.next(
                target,
                measured,
                None if contacts is None else np.array(contacts),
                None if math.isnan(at) else at,
            )
        assert law.config.u_min <= u <= law.config.u_max  # false for NaN too
        assert abs(u - before) <= law.config.step + ROUND_OFF
        before = u


@pytest.mark.parametrize("lost", [math.nan, math.inf, -math.inf])
def test_a_lost_measurement_leaves_u_as_it_is(lost):
    law = Scheduled(config())
    before = law.next(0.2, 0.0)
    assert law.next(0.2, lost) == before > 0
    assert law.next(0.2, 0.1, np.full(7, lost)) == before


def test_nothing_winds_up_at_the_largest_actuation():
    law = Scheduled(config())
    for _ in range(100):
        law.next(50.0, 0.1)
    assert law.u == law.config.u_max
    assert law.next(0.2, 0.6) == pytest.approx(law.config.u_max - law.config.step)


def test_a_contact_above_its_limit_unloads_although_force_is_missing():
    law = Scheduled(config(limit=0.15))
    force, _ = drive(law, [0.25] * 20)
    assert force[-5:].max() <= 0.15 * 1.35  # a swing of a step beyond the limit and back
    assert law.next(0.25, 0.2, np.array([0, 0, 0.2, 0, 0, 0, 0])) < law.u + ROUND_OFF


@pytest.mark.parametrize("sticks_above", [3.0, 0.5, 0.0, -0.3])
def test_release_gets_out_of_a_pose_that_holds_until_u_is_far_down(sticks_above):
    law, stuck = Scheduled(config()), True
    for _ in range(4):
        law.next(0.4, 0.1)
    for step in range(30):
        stuck = stuck and law.u > sticks_above
        law.next(0.0, 0.23 if stuck else 0.0)
        if step == 10:
            assert not stuck
    assert law.u == 0.0


@unhurried
@given(st.lists(st.floats(0.0, 0.4), min_size=7, max_size=7))
def test_a_distribution_is_met_in_the_sense_of_least_squares(wanted):
    """Only C3 answers u, F₃ = 0.1 u, so the best is F₃ = wanted₃, whatever the others want."""
    law, target = Scheduled(controller()), np.array(wanted)
    if target.sum() < 0.01:
        return
    for _ in range(60):
        contacts = np.zeros(7)
        contacts[2] = SLOPE * max(law.u, 0.0)
        law.next(target, float(contacts.sum()), contacts)
    if law.u > 0.05:  # below it nothing presses, and the sum decides
        # γ may have fallen to ½ for an error of the sum that cannot vanish; 60 halvings are enough.
        assert SLOPE * law.u == pytest.approx(target[2], abs=1e-3)


@pytest.mark.parametrize("delay", [1, 2, 3])
def test_late_measurements_make_it_later_not_unstable(delay):
    force, _ = drive(Scheduled(config()), [0.2] * 30, delay)
    assert force.max() <= 0.2 + 1e-6
    np.testing.assert_allclose(force[-5:], 0.2, rtol=1e-3)


def test_bad_paths_and_targets_are_refused():
    with pytest.raises(InputError, match="two points or more"):
        walk(np.array([1.0]))
    with pytest.raises(InputError, match="strictly rise"):
        walk(np.array([0.0, 1.0, 0.5]))
    with pytest.raises(InputError, match="from u = 0 up"):
        replace(config(), loading=walk(np.array([0.0, 1.0])))
    with pytest.raises(InputError, match="finite and above 0"):
        config(rate=math.nan)
    law = Scheduled(config())
    with pytest.raises(InputError, match="target: expected finite"):
        law.next(math.nan, 0.1)
    with pytest.raises(InputError, match="needs measured outputs"):
        law.next(np.ones(7), 0.1)
