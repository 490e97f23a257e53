"""The loop in real time on a clock of our own: its steps, their times, and u = 0 however it ends."""

import itertools
from collections.abc import Iterator

import numpy as np
import pytest

from exosight.control import ControllerConfig, Guarded, Scheduled, State
from exosight.control.estimator import Reading
from exosight.control.realtime import STAGES, Clock, Step, run_live, timings
from exosight.control.sources import Frame
from exosight.errors import DataError, InputError

TARGET = 0.3  # [N]
ROUND_OFF = 1e-12  # of sums of numbers up to 5 N


class Time:
    """Passes only when somebody sleeps or works."""

    def __init__(self) -> None:
        self.now = 100.0
        self.clock = Clock(lambda: self.now, self.sleep)

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0
        self.now += seconds


class Plant:
    """F₃ = 0.1 u as source and actuator: 4 ms to see, 1 ms to act; every picture shows u."""

    def __init__(self, time: Time) -> None:
        self.time, self.asked, self.times = time, [], []
        self.shots = itertools.count()
        self.fails: dict[int, BaseException | None] = {}

    def __iter__(self) -> Iterator[Frame | None]:
        return self

    def __next__(self) -> Frame | None:
        shot = next(self.shots)
        self.time.now += 0.004
        if shot in self.fails:
            fault = self.fails[shot]
            if fault is None:
                return None
            raise fault
        image = np.zeros((4, 8), np.uint8)
        image[0], image[1, shot % 8] = 200, 50 + shot % 200
        forces = np.zeros(7)
        forces[2] = 0.1 * max(self.asked[-1], 0.0)
        return Frame(image, self.time.now, np.array([self.asked[-1]]), forces)

    def read(self, images: np.ndarray) -> Reading:
        """A perfect network, which takes 10 ms."""
        self.time.now += 0.010
        forces = np.zeros((1, 7), np.float32)
        forces[0, 2] = 0.1 * max(self.asked[-1], 0.0)
        return Reading(forces, forces, forces, np.ones((1, 7), np.float32), np.zeros(1, np.float32))

    def apply(self, u: float) -> None:
        self.time.now += 0.001
        self.asked.append(u)
        self.times.append(self.time.now)

    def close(self) -> None:
        pass


@pytest.fixture
def plant() -> Plant:
    return Plant(Time())


@pytest.fixture
def guarded(straight_config: ControllerConfig) -> Guarded:
    return Guarded(Scheduled(straight_config))


def go(plant: Plant, guarded: Guarded, target=(TARGET,) * 20, done=lambda step: None) -> list[Step]:
    steps: list[Step] = []

    def both(step: Step) -> None:
        steps.append(step)
        done(step)

    run_live(plant, plant.read, guarded, plant, target, both, plant.time.clock)
    return steps


def keeps_the_rate(plant: Plant, config: ControllerConfig) -> None:
    changes = np.abs(np.diff(plant.asked))
    assert changes.max() <= config.step + ROUND_OFF
    # Between two commands passes a period, and what seeing and reading take less than before, here nothing.
    assert np.diff(plant.times).min() >= config.period - 1e-9


def test_it_reaches_the_target_and_lets_go(plant: Plant, guarded: Guarded) -> None:
    steps = go(plant, guarded)
    assert len(steps) == 20
    assert steps[-1].true is not None
    assert steps[-1].true.sum() == pytest.approx(TARGET, rel=0.02)  # the law's own band is 5 %
    assert plant.asked[0] == 0
    assert plant.asked[-1] == 0
    keeps_the_rate(plant, guarded.config)


def test_steps_keep_their_times(plant: Plant, guarded: Guarded) -> None:
    steps = go(plant, guarded)
    # Round-off of times near 100 s.
    np.testing.assert_allclose([step.time for step in steps], 0.1 * np.arange(20), atol=1e-9)
    np.testing.assert_allclose([step.late for step in steps], 0, atol=1e-9)
    np.testing.assert_allclose([step.seconds for step in steps], [[0.004, 0.010, 0.0, 0.001]] * 20, atol=1e-9)
    np.testing.assert_allclose([step.measurement.age for step in steps], 0.010, atol=1e-9)


def test_a_frame_shows_the_command_that_was_sent_before_it_was_taken(guarded: Guarded) -> None:
    class Late(Plant):
        """Its frames are 250 ms old and say nothing of commands."""

        def __next__(self) -> Frame | None:
            frame = super().__next__()
            return None if frame is None else Frame(frame.image, frame.time - 0.25)

    plant = Late(Time())
    steps = go(plant, guarded)
    # Of the steps at 0, 0.1, 0.2 … s, each of which acts after 14 ms: at 0.254 s before is the third last.
    shown = [step.shown.item() for step in steps if step.shown is not None]
    assert shown[:3] == [0.0, 0.0, 0.0]
    assert shown[3] == 1.0
    assert shown[3:] == [step.command for step in steps[:-3]]


def test_lost_time_is_not_caught_up_with_and_missed_periods_are_counted(
    plant: Plant, guarded: Guarded
) -> None:
    def dawdle(step: Step) -> None:
        if step.time == pytest.approx(0.2):
            plant.time.now += 0.35

    steps = go(plant, guarded, done=dawdle)
    # 15 ms of its own and 350 ms of dawdling: the periods at 0.3, 0.4 and 0.5 s have begun meanwhile.
    begins = [0.0, 0.1, 0.2, *np.arange(6, 20) / 10]
    np.testing.assert_allclose([step.time for step in steps], begins, atol=1e-9)
    np.testing.assert_allclose([step.late for step in steps], 0, atol=1e-9)
    assert [step.missed for step in steps] == [0, 0, 0, 3, *[0] * 13]
    assert steps[3].measurement.age == pytest.approx(0.010)


def test_the_wall_clock_is_kept_by_steps_that_take_too_long(plant: Plant, guarded: Guarded) -> None:
    """Each step takes 137 ms where a period has 100: every other one is missed, and 6 s remain 6 s."""
    begin = plant.time.now

    def work(step: Step) -> None:
        plant.time.now += 0.137 - 0.015

    steps: list[Step] = []

    def both(step: Step) -> None:
        steps.append(step)
        work(step)

    at_the_end = run_live(plant, plant.read, guarded, plant, (TARGET,) * 60, both, plant.time.clock)
    assert len(steps) == 30
    assert len(steps) + sum(step.missed for step in steps) + at_the_end == 60
    assert at_the_end == 1
    release = guarded.release_time  # after the target's end
    assert 5.9 < plant.time.now - begin < 6.1 + release + 0.2
    keeps_the_rate(plant, guarded.config)


def test_a_target_that_changes_in_a_missed_period_is_followed_by_the_clock(
    plant: Plant, guarded: Guarded
) -> None:
    def dawdle(step: Step) -> None:
        if step.time == pytest.approx(0.2):
            plant.time.now += 0.35

    target = np.arange(20) / 100
    steps = go(plant, guarded, target, dawdle)
    assert [step.target for step in steps] == pytest.approx([step.time / 10 for step in steps])


def test_missing_frames_end_in_release(plant: Plant, guarded: Guarded) -> None:
    plant.fails = dict.fromkeys(range(12, 100))
    steps = go(plant, guarded, (TARGET,) * 40)
    assert steps[11].command == pytest.approx(TARGET / 0.1, rel=0.05)
    assert steps[-1].command == 0
    assert [step.state for step in steps if step.cause] == [State.HOLD, State.RELEASE]
    assert "no frame" in next(step.cause for step in steps if step.cause)


def test_the_end_of_the_source_ends_the_loop(plant: Plant, guarded: Guarded) -> None:
    plant.fails = {8: StopIteration()}
    assert len(go(plant, guarded)) == 8
    assert plant.asked[-1] == 0


@pytest.mark.parametrize("fault", [KeyboardInterrupt(), DataError("camera 0: no frame"), RuntimeError("bug")])
def test_whatever_the_source_raises_u_returns_to_zero(
    plant: Plant, guarded: Guarded, fault: BaseException
) -> None:
    plant.fails = {8: fault}
    with pytest.raises(type(fault)):
        go(plant, guarded)
    assert max(plant.asked) > 2
    assert plant.asked[-1] == 0
    keeps_the_rate(plant, guarded.config)


def test_a_full_disk_ends_the_loop_with_u_at_zero(plant: Plant, guarded: Guarded) -> None:
    def write(step: Step) -> None:
        if step.time > 0.75:
            raise DataError("run.h5: cannot be written (no space left on device)")

    with pytest.raises(DataError, match="no space left"):
        go(plant, guarded, done=write)
    assert max(plant.asked) > 2
    assert plant.asked[-1] == 0


def test_an_actuator_that_fails_is_tried_once_more(plant: Plant, guarded: Guarded) -> None:
    apply, calls = plant.apply, itertools.count()

    def broken(u: float) -> None:
        if next(calls) >= 6:
            raise DataError("u cannot be sent")
        apply(u)

    plant.apply = broken
    with pytest.raises(DataError, match="cannot be sent"):
        go(plant, guarded)
    assert next(calls) == 8  # six that went through, one that did not, one to let go


def test_a_network_without_an_answer_is_no_estimate(plant: Plant, guarded: Guarded) -> None:
    def lost(images: np.ndarray) -> Reading:
        raise DataError("the network answers forces that are not finite")

    plant.read = lost
    steps = go(plant, guarded)
    assert all(step.measurement.reading is None for step in steps)
    assert all(step.command == 0 for step in steps)


def test_a_target_that_is_no_number_is_refused_with_u_at_zero(plant: Plant, guarded: Guarded) -> None:
    with pytest.raises(InputError, match="target"):
        go(plant, guarded, (TARGET,) * 10 + (float("nan"),))
    assert plant.asked[-1] == 0


def test_it_goes_on_until_it_is_stopped(plant: Plant, guarded: Guarded) -> None:
    def stop(step: Step) -> None:
        if step.time > 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        go(plant, guarded, itertools.repeat(TARGET), stop)
    assert plant.asked[-1] == 0


def test_timings_are_quantiles_of_every_stage_and_of_the_whole() -> None:
    seconds = np.zeros((101, 4))
    seconds[:, 1] = np.arange(101) / 1000
    seconds[:, 3] = 0.5
    found = {timing.stage: timing for timing in timings(seconds)}
    assert list(found) == [*STAGES, "whole step"]
    assert (found["estimate"].p50, found["estimate"].p99) == pytest.approx((0.050, 0.099))
    assert found["whole step"].largest == pytest.approx(0.6)
    with pytest.raises(InputError, match="at least one step"):
        timings(np.zeros((0, 4)))
