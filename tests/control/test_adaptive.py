"""The adaptive controller on plants in closed form, with frames that are late, lost, spoilt or made up."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from any_frames import TARGET, measurements, picture, reading, targets
from hypothesis import given, settings
from hypothesis import strategies as st
from toy import SLOPE, controller, force_path

from exosight.control import Adaptive, ForcePath, Measurement, State
from exosight.errors import InputError

CONFIG = controller(limit=0.4)
ROUND_OFF = 1e-12  # of sums of numbers up to 5 N
unhurried = settings(deadline=None)


def bent(u: float) -> float:
    return 0.02 * max(u, 0.0) ** 2


def steep(u: float) -> float:
    return max(u - 3.5, 0.0) / 3


def path_of(law: Callable[[float], float]) -> ForcePath:
    """C3 presses by a law of u, from 0 to 5 N."""
    u = np.linspace(0.0, 5.0, 51)
    outputs = np.zeros((len(u), 7))
    outputs[:, 2] = [law(each) for each in u]
    return force_path(u, outputs)


class Bench:
    """F = s · 0.1 (u − d), on C3, as the toy's path is 0.1 u; frames are `late` steps old."""

    def __init__(self, s: float = 1.0, d: float = 0.0, late: int = 0) -> None:
        self.adaptive, self.s, self.d, self.late = Adaptive(CONFIG), s, d, late
        self.u, self.forces = [0.0], [0.0]

    def frame(self) -> Measurement:
        at = max(len(self.u) - 1 - self.late, 0)
        return Measurement(picture(at), reading(self.forces[at]), 0.1 * self.late, np.array([self.u[at]]))

    def step(self, measurement: object = None, target: float = TARGET) -> float:
        u = self.adaptive.step(target, self.frame() if measurement is None else measurement)
        self.u.append(u)
        self.forces.append(max(self.s * SLOPE * (u - self.d), 0.0))
        return u

    def repeat(self, times: int, measurement: object = None, target: float = TARGET) -> None:
        for _ in range(times):
            self.step(measurement, target)

    @property
    def state(self) -> State:
        return self.adaptive.state


@pytest.mark.parametrize("late", [0, 1, 3])
@pytest.mark.parametrize(("s", "d"), [(1.0, 0.0), (1.2, 0.1), (0.8, -0.2), (0.9, 0.4)])
def test_it_settles_on_a_plant_that_it_was_not_tuned_for(s: float, d: float, late: int):
    bench = Bench(s, d, late)
    bench.repeat(20)
    # The path to the target is three steps; then a frame has to come, and another for what is left.
    assert np.abs(np.array(bench.forces[6 + 2 * late :]) - TARGET).max() < 0.05 * TARGET
    assert bench.state is State.NORMAL


def test_no_state_is_left_because_of_one_frame():
    for spoilt in (
        Measurement(),
        Measurement(picture(0), reading(0.05)),
        Measurement(picture(1), reading(0.3, ood_score=9)),
    ):
        bench = Bench()
        bench.repeat(8)
        before = bench.u[-1]
        bench.step(spoilt)
        assert bench.state is State.NORMAL
        assert bench.adaptive.log == []
        # Its own prediction, not that frame, says where to go.
        assert bench.u[-1] == pytest.approx(before, abs=0.05)


def test_one_frame_that_reads_too_much_lowers_u_until_the_next():
    for force in (0.45, 0.9):  # as long as it is alone, neither it nor the observer is known to be wrong
        bench = Bench()
        bench.repeat(8)
        before = bench.u[-1]
        bench.step(Measurement(picture(0), reading(force)))
        assert before - CONFIG.step - ROUND_OFF <= bench.u[-1] < before - 0.2
        assert bench.adaptive.log == []
        bench.repeat(2)
        assert bench.u[-1] == pytest.approx(before, abs=0.05)


def test_a_first_frame_that_reads_too_little_leads_to_little_more_force_alone():
    """It is older than it says, as one that is sent a second time when the first one was lost."""
    bench = Bench()
    bench.repeat(2, Measurement())
    now, missing = bench.u[-1], 0.8
    bench.step(Measurement(picture(7), reading(SLOPE * (now - missing)), commands=np.array([now])))
    bench.step(Measurement())
    right = TARGET / SLOPE
    assert bench.u[-1] < right + 0.2 * missing  # all of that if it were believed
    bench.repeat(4)
    assert bench.u[-1] == pytest.approx(right, abs=0.05)


@unhurried
@given(st.lists(st.tuples(st.floats(-0.2, 0.1), st.floats(0.0, 0.3)), min_size=6, max_size=12))
def test_no_single_frame_leads_to_more_force_alone(frames: list[tuple[float, float]]):
    """Whatever it changes, shift or scale: u gets at most half a standard deviation of plants more of it."""
    adaptive, u = Adaptive(controller(path_of(bent), limit=0.4)), 0.0
    usual = adaptive.adaptive.observer.shift * CONFIG.driven.peak / 2
    for k, (error, width) in enumerate(frames):
        before = adaptive.observer.ahead(1 if k else 0)[0]
        read = reading(max(bent(u) + error, 0.0), width=width)
        after = adaptive.step(TARGET, Measurement(picture(k), read, commands=np.array([u])))
        moved = 0.1 * abs(adaptive.observer.state[2])  # in the step since the frame
        assert after <= max(u, adaptive.observer.command_of(before, TARGET) + usual + moved) + 1e-9
        u = after


def test_where_the_force_is_known_least_it_waits_for_a_frame_of_the_present_command():
    config = controller(path_of(steep), limit=1.0)
    adaptive, u = Adaptive(config), [0.0]
    for _ in range(6):
        u.append(adaptive.step(0.3, Measurement()))
    assert u[-1] == u[-2] < 3.5  # where the path begins to rise
    old = Measurement(picture(0), reading(0.0), 0.2, np.array([u[2]]))
    assert adaptive.step(0.3, old) == u[-1]
    now = Measurement(picture(1), reading(0.0), 0.0, np.array([u[-1]]))
    assert adaptive.step(0.3, now) > u[-1]


@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize("d", [-0.3, 0.0, 0.6])
def test_waiting_for_frames_it_settles_where_the_path_is_steep(d: float, late: int):
    adaptive, u = Adaptive(controller(path_of(steep), limit=1.0)), [0.0]
    for k in range(40):
        at = u[max(k - late, 0)]
        seen = Measurement(picture(max(k - late, 0)), reading(steep(at - d)), 0.1 * late, np.array([at]))
        u.append(adaptive.step(0.3, seen))
    assert steep(u[-1] - d) == pytest.approx(0.3, abs=0.015)


def test_a_frame_that_comes_again_as_a_new_one_is_not_taken_in():
    """Its reading belongs to another moment and u; when it comes a third time, nothing has changed."""
    bench = Bench()
    bench.repeat(8)
    last = len(bench.u) - 2
    again = Measurement(picture(last), reading(bench.forces[last] + 0.005), 0.0, np.array([bench.u[-1]]))
    before = bench.adaptive.observer.state
    bench.step(again)
    np.testing.assert_array_equal(bench.adaptive.observer.state, before)
    assert bench.adaptive.unseen == pytest.approx(0.2)
    bench.step(again)
    assert (bench.adaptive.observer.state != before).any()
    assert bench.adaptive.unseen == pytest.approx(0.1)


def test_without_frames_authority_goes_step_by_step():
    bench = Bench()
    bench.repeat(8)
    states = []
    for _ in range(30):
        bench.step(Measurement())
        states.append(bench.state)
    # The last frame showed the step before: at the k-th step without one it is k + 1 periods old.
    assert [states.index(s) + 2 for s in (State.SLOW, State.HOLD, State.RELEASE)] == [7, 13, 23]
    assert bench.u[-1] == 0.0
    bench.repeat(5)
    assert bench.state is State.SLOW
    bench.repeat(10)
    assert bench.state is State.NORMAL


def test_frames_that_do_not_fit_are_no_frames():
    """Readings that jump to and fro, each an outlier: authority goes as if none came."""
    bench = Bench()
    bench.repeat(8)
    for k in range(30):
        bench.step(Measurement(picture(k), reading(0.48 if k % 2 else 0.3), commands=np.array([bench.u[-1]])))
    assert State.RELEASE in [entry.after for entry in bench.adaptive.log]
    assert not any(entry.after is State.NORMAL for entry in bench.adaptive.log)


def test_a_long_pause_is_taken_in_at_once():
    bench = Bench()
    bench.repeat(8)
    assert bench.adaptive.step(TARGET, Measurement(), missed=10**9) < bench.u[-1]
    assert bench.state is State.RELEASE


def test_it_loads_slowly_on_predictions_and_unloads_at_once():
    bench = Bench()
    bench.repeat(8, target=0.1)
    bench.repeat(6, Measurement(), target=0.1)
    before = bench.u[-1]
    assert bench.state is State.SLOW
    assert bench.step(Measurement(), target=0.3) == pytest.approx(before + 0.5, abs=1e-9)  # of 1 N a step
    assert bench.step(Measurement(), target=0.05) == pytest.approx(bench.u[-2] - 1.0, abs=0.05)


def test_a_target_of_nothing_needs_no_frame():
    bench = Bench()
    bench.repeat(8)
    bench.repeat(4, Measurement(), target=0.0)
    assert bench.u[-1] == 0.0


def test_what_presses_at_rest_is_pulled_off():
    bench = Bench(d=-0.5)  # 0.05 N at u = 0
    bench.repeat(8)
    bench.repeat(8, target=0.0)
    assert min(bench.forces[-8:]) < 0.005
    assert min(bench.u) >= CONFIG.u_min


def test_two_frames_far_beyond_a_limit_release():
    bench = Bench()
    bench.repeat(8)
    bench.step(Measurement(picture(0), reading(0.55)))
    assert bench.state is State.NORMAL
    bench.step(Measurement(picture(1), reading(0.55)))
    assert bench.state is State.RELEASE
    assert "beyond its limit" in bench.adaptive.log[-1].cause


@unhurried
@given(st.lists(st.tuples(targets, measurements()), max_size=40))
def test_nothing_seen_makes_it_leave_its_limits(steps):
    adaptive, before = Adaptive(CONFIG), 0.0
    for target, measurement in steps:
        u = adaptive.step(target, measurement)
        assert CONFIG.u_min <= u <= CONFIG.u_max  # false for NaN too
        assert abs(u - before) <= CONFIG.step + ROUND_OFF
        if adaptive.state is State.HOLD and target >= 0.005:
            assert u <= before
        if adaptive.state is State.RELEASE:
            assert abs(u) <= abs(before)
        before = u


@unhurried
@given(st.lists(st.tuples(targets, measurements()), max_size=30))
def test_blinded_for_good_it_ends_at_no_actuation_in_a_stated_time(steps):
    adaptive = Adaptive(CONFIG)
    for target, measurement in steps:
        adaptive.step(target, measurement)
    unseen = adaptive.adaptive.authority.release_seconds + CONFIG.u_max / CONFIG.rate
    for _ in range(math.ceil(unseen / CONFIG.period) + 1):
        last = adaptive.step(TARGET, Measurement())
    assert last == 0.0


def test_reset_forgets_and_a_target_that_is_no_number_is_refused():
    bench = Bench()
    bench.repeat(30, Measurement())
    bench.adaptive.reset()
    assert (bench.adaptive.state, bench.adaptive.log) == (State.NORMAL, [])
    np.testing.assert_array_equal(bench.adaptive.observer.state, [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="target: expected a finite"):
        bench.step(target=math.nan)
