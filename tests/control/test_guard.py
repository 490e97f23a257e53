"""The guard: which frames it trusts, what it lets pass, and what nothing can make it do."""

import itertools
import math

import numpy as np
import pytest
from any_frames import TARGET, malformed, measurements, picture, reading, targets
from hypothesis import given, settings
from hypothesis import strategies as st
from toy import SLOPE, controller

from exosight.control import GuardConfig, Guarded, Measurement, Scheduled, State
from exosight.control.estimator import Reading, read_one
from exosight.errors import InputError

ROUND_OFF = 1e-12  # of sums of numbers up to 5 N
FORCE_LIMIT = 0.4  # [N]

unhurried = settings(deadline=None, max_examples=60)  # a busy machine is no failure


CONFIG = controller(limit=FORCE_LIMIT)


class Bench:
    """A guarded controller on the plant F₃ = 0.1 u, shown good frames or what a test makes of them."""

    def __init__(self, **guard):
        self.guarded = Guarded(Scheduled(CONFIG), GuardConfig(**guard))
        self.u, self.frames = 0.0, itertools.count()

    def good(self, **changes) -> Measurement:
        measurement = {"image": picture(next(self.frames)), "reading": reading(SLOPE * max(self.u, 0.0))}
        return Measurement(**{**measurement, **changes})

    def step(self, measurement: Measurement | None = None, target: float = TARGET) -> float:
        self.u = self.guarded.step(target, self.good() if measurement is None else measurement)
        return self.u

    @property
    def state(self) -> State:
        return self.guarded.state

    def settle(self) -> "Bench":
        for _ in range(12):
            self.step()
        assert self.state is State.NORMAL
        assert self.u == pytest.approx(TARGET / SLOPE)
        return self


def test_with_good_frames_it_does_what_the_law_does():
    bench, law, force = Bench(), Scheduled(CONFIG), 0.0
    for _ in range(10):
        expected = law.next(TARGET, float(np.float32(force)), np.eye(7)[2] * float(np.float32(force)))
        assert bench.step() == pytest.approx(expected, abs=ROUND_OFF)
        force = SLOPE * expected
    assert bench.guarded.log == []


def test_a_score_above_its_limit_never_reads_as_the_limit():
    bench = Bench().settle()
    bench.step(bench.good(reading=reading(0.3, ood_score=1.0002)))
    assert bench.guarded.problem is not None
    assert "score 1.001" in bench.guarded.problem.cause


def test_missed_periods_count_in_the_age_of_a_frame():
    """After three missed periods a frame of two periods' age shows the command that was held meanwhile."""
    for missed, fault in ((0, True), (3, False)):
        bench = Bench().settle()
        held = bench.step(target=0.0)
        late = bench.good(age=2 * CONFIG.period, commands=np.array([held]))
        bench.guarded.step(TARGET, late, missed)
        assert (bench.guarded.problem is not None) == fault


BAD = {
    "no frame": lambda bench: Measurement(),
    "stale": lambda bench: bench.good(age=0.6),
    "black": lambda bench: bench.good(image=np.zeros((4, 6), np.uint8)),
    "blank": lambda bench: bench.good(image=np.full((4, 6), 200, np.uint8)),
    "no estimate": lambda bench: bench.good(reading=None),
    "an estimate that is no valid reading": lambda bench: bench.good(reading=reading(math.nan)),
    "no valid reading": lambda bench: bench.good(reading=reading(math.inf)),
    "an estimate that is no": lambda bench: bench.good(reading=reading(-1e30)),
    "out-of-distribution image": lambda bench: bench.good(reading=reading(0.3, ood_score=1.2)),
    "score nan": lambda bench: bench.good(reading=reading(0.3, ood_score=math.nan)),
    "not the command that was sent": lambda bench: bench.good(commands=np.array([bench.u - 0.5])),
    "u = nan": lambda bench: bench.good(commands=np.array([math.nan])),
}


@pytest.mark.parametrize("cause", BAD)
def test_bad_frames_hold_then_release_and_say_why(cause):
    bench = Bench().settle()
    held = bench.u
    assert bench.step(BAD[cause](bench)) == held  # the first: u stays, the state too
    assert bench.state is State.NORMAL
    assert bench.step(BAD[cause](bench)) == held
    assert bench.state is State.HOLD
    assert cause in bench.guarded.log[-1].cause
    assert bench.guarded.problem is not None
    assert cause in bench.guarded.problem.cause
    assert bench.guarded.problem.remedy
    for _ in range(5):
        assert bench.step(BAD[cause](bench)) == held
    before = bench.u
    bench.step(BAD[cause](bench))
    assert bench.state is State.RELEASE
    assert bench.u == pytest.approx(before - CONFIG.step)
    for _ in range(3):
        bench.step(BAD[cause](bench))
    assert bench.u == 0.0
    assert [entry.after for entry in bench.guarded.log] == [State.HOLD, State.RELEASE]


WRONG = {
    "image": (None, "frame", [[0, 255]], np.zeros((4, 6)), np.zeros((4, 6, 3), np.uint8), picture(1)[:0]),
    "reading": (
        *("estimate", reading(0.3).forces, malformed(forces=None), malformed(forces=[0.3] * 7)),
        *(malformed(low=np.zeros((1, 6), np.float32)), malformed(high=np.full((1, 7), 1j))),
        *(malformed(ood_score=np.zeros((1, 1), np.float32)), malformed(contact="likely")),
        malformed(forces=np.array([[None] * 7], object)),
    ),
    "age": (None, "now", [0.0], np.zeros(1), 1j, 10**400, math.nan),
    "commands": (
        3.0,
        [3.0],
        np.zeros(2),
        np.zeros((1, 1)),
        np.array(["3"]),
        np.array([3j]),
        np.array([None]),
    ),
}


@pytest.mark.parametrize("field", WRONG)
def test_a_measurement_of_another_shape_or_type_is_a_bad_frame(field):
    for value in WRONG[field]:
        bench = Bench().settle()
        held = bench.u
        for _ in range(2):
            assert bench.step(bench.good(**{field: value})) == held
        assert bench.state is State.HOLD, value
        assert math.isnan(bench.good(**{field: value}).sum(CONFIG.weights)) == (field == "reading"), value
    bench = Bench().settle()
    for nothing in ("no measurement", [0.3] * 7):
        bench.guarded.step(TARGET, nothing)
    assert bench.state is State.HOLD


def test_a_picture_that_is_none_is_not_read():
    def read(images: np.ndarray) -> Reading:
        raise InputError(f"images: expected others, got {images.shape}")

    for image in (None, "picture", [[1]], np.zeros((4, 6)), picture(1)):
        assert read_one(read, image) is None


def test_one_lost_frame_costs_one_step():
    bench = Bench().settle()
    bench.step(Measurement())
    bench.step()
    assert bench.guarded.log == []


def test_frames_lost_now_and_then_hold_but_do_not_let_go():
    bench = Bench().settle()
    held = bench.u
    for _ in range(2):
        bench.step(Measurement())
    assert bench.state is State.HOLD
    for _ in range(10):
        for measurement in (None, None, Measurement()):  # never five good ones in a row, never two bad ones
            assert bench.step(measurement) == held
    for _ in range(5):
        bench.step()
    assert [entry.after for entry in bench.guarded.log] == [State.HOLD, State.SLOW]


def test_a_frame_that_stays_the_same_is_frozen_once_u_has_moved():
    bench, still = Bench(), picture(7)
    bench.step(bench.good(image=still))  # taken at u = 0
    for _ in range(2):
        bench.step(bench.good(image=still))  # taken, so it says, at 1 N and at 2 N
    assert bench.state is State.HOLD
    assert "frozen" in bench.guarded.log[-1].cause


def test_a_frame_that_stays_the_same_at_rest_is_frozen_only_for_a_camera_with_noise():
    for frames, state in ((0, State.NORMAL), (5, State.HOLD)):
        bench = Bench(frozen_frames=frames).settle()
        still = picture(7)
        for _ in range(7):
            bench.step(bench.good(image=still))
        assert bench.state is state


def test_late_pictures_are_compared_with_the_u_under_which_they_were_taken():
    bench, seen = Bench(), []
    for _ in range(30):
        seen.append(bench.good(commands=np.array([bench.u])))
        late = seen[max(0, len(seen) - 4)]
        age = 0.1 * min(len(seen) - 1, 3)
        bench.step(Measurement(late.image, late.reading, age, late.commands))
    assert bench.guarded.log == []
    assert bench.u == pytest.approx(TARGET / SLOPE, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "cause"),
    [({"width": 0.5}, "an interval of 0.50 N"), ({"ood_score": 0.9}, "close to out of distribution")],
)
def test_in_doubt_it_loads_slowly_and_unloads_at_once(changes, cause):
    bench = Bench()
    bench.step(bench.good(reading=reading(0.0, **changes)))
    assert bench.state is State.SLOW
    assert cause in bench.guarded.log[-1].cause
    assert bench.u == pytest.approx(0.25 * CONFIG.step)
    bench = Bench().settle()
    bench.step(bench.good(reading=reading(TARGET, **changes)), target=0.0)
    assert bench.state is State.SLOW
    assert bench.u == pytest.approx(TARGET / SLOPE - CONFIG.step)


def test_a_target_out_of_reach_at_the_largest_u_is_doubted():
    bench = Bench()
    for _ in range(40):
        bench.step(bench.good(reading=reading(0.1)))
    assert bench.u == CONFIG.u_max
    assert bench.state is State.SLOW
    assert "largest u" in bench.guarded.log[-1].cause


def test_a_contact_far_beyond_its_limit_releases_at_once():
    bench = Bench().settle()
    before = bench.u
    bench.step(bench.good(reading=reading(1.3 * FORCE_LIMIT)))
    assert bench.state is State.RELEASE
    assert "C3 presses with 0.52 N" in bench.guarded.log[-1].cause
    assert bench.u == pytest.approx(before - CONFIG.step)


def test_without_eyes_a_target_of_zero_releases_at_once():
    bench = Bench().settle()
    bench.step(Measurement(), target=0.0)
    assert bench.state is State.RELEASE
    for _ in range(round(bench.guarded.release_time / CONFIG.period)):
        bench.step(Measurement(), target=0.0)
    assert bench.u == 0.0


def test_good_frames_lead_back_from_release_to_the_target():
    bench = Bench().settle()
    for _ in range(12):
        bench.step(Measurement())
    assert (bench.state, bench.u) == (State.RELEASE, 0.0)
    for _ in range(40):
        bench.step()
    assert [entry.after for entry in bench.guarded.log] == [
        State.HOLD,
        State.RELEASE,
        State.SLOW,
        State.NORMAL,
    ]
    assert bench.u == pytest.approx(TARGET / SLOPE, rel=1e-3)


LEGAL = {
    (State.NORMAL, State.SLOW),
    (State.NORMAL, State.HOLD),
    (State.NORMAL, State.RELEASE),
    (State.SLOW, State.NORMAL),
    (State.SLOW, State.HOLD),
    (State.SLOW, State.RELEASE),
    (State.HOLD, State.SLOW),
    (State.HOLD, State.RELEASE),
    (State.RELEASE, State.SLOW),
}


@unhurried
@given(st.lists(st.tuples(targets, measurements()), max_size=40))
def test_nothing_seen_makes_it_leave_its_limits_or_its_states_without_cause(steps):
    guarded, before, state = Guarded(Scheduled(CONFIG)), 0.0, State.NORMAL
    released_for = good = 0
    for target, measurement in steps:
        u = guarded.step(target, measurement)
        assert CONFIG.u_min <= u <= CONFIG.u_max  # false for NaN too
        assert abs(u - before) <= CONFIG.step + ROUND_OFF
        # As the guard itself judges, from the outside: a frame without image or numbers is never good.
        forces = getattr(getattr(measurement, "reading", None), "forces", None)
        seen = (
            isinstance(getattr(measurement, "image", None), np.ndarray)
            and isinstance(forces, np.ndarray)
            and forces.dtype.kind == "f"
            and np.isfinite(forces).all()
        )
        if guarded.state is not state:
            entry = guarded.log[-1]
            assert (entry.before, entry.after) == (state, guarded.state)
            assert (state, guarded.state) in LEGAL
            assert entry.cause
            if state in (State.HOLD, State.RELEASE) and guarded.state is State.SLOW:
                assert good + seen >= guarded.guard.good_frames
                assert state is State.HOLD or before == 0.0
            good = released_for = 0
        else:
            good = good + 1 if seen else 0
        if guarded.state is State.HOLD:
            assert u == before
        if guarded.state is State.RELEASE:
            released_for += 1
            assert abs(u) <= abs(before)
            assert u == 0.0 or released_for * CONFIG.period < guarded.release_time + 1e-9
        before, state = u, guarded.state


@unhurried
@given(st.lists(st.tuples(targets, measurements()), max_size=30))
def test_blinded_for_good_it_ends_at_no_actuation_in_a_stated_time(steps):
    guarded = Guarded(Scheduled(CONFIG))
    for target, measurement in steps:
        guarded.step(target, measurement)
    guard = guarded.guard
    blind = guard.bad_frames + guard.hold_steps + 1 + round(guarded.release_time / CONFIG.period)
    for _ in range(blind):
        last = guarded.step(TARGET, Measurement())
    assert last == 0.0


def test_reset_forgets_and_a_target_that_is_no_number_is_refused():
    bench = Bench().settle()
    bench.step(Measurement())
    bench.step(Measurement())
    bench.guarded.reset()
    assert (bench.state, bench.guarded.log, bench.guarded.law.u) == (State.NORMAL, [], 0.0)
    with pytest.raises(InputError, match="target: expected finite"):
        bench.step(target=math.nan)
