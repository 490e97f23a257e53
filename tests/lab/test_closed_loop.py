import json
from itertools import pairwise

import httpx
import numpy as np
import pytest

from exosight.lab import closed_loop
from exosight.lab.closed_loop import HELD, RELEASED, Step, Stopped, run_trial
from exosight.lab.settings import Disturbance, LoopSettings


def steps_of(settings: LoopSettings) -> list[Step]:
    told: list[Step] = []
    run_trial(settings, told.append)
    return told


def test_the_scheduled_law_holds_its_target_on_the_true_force() -> None:
    told = steps_of(LoopSettings(target=0.3, sensor="true"))
    assert len(told) == HELD + RELEASED
    force = np.array([step["F_net"] for step in told])
    assert np.all(np.abs(force[20:HELD] - 0.3) < 0.05 * 0.3)  # the band of `judge_response`
    assert force[-1] < 0.01
    assert {step["guard"]["state"] for step in told} == {"normal"}
    assert [step["time"] for step in told[:3]] == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("disturbance", "cause"),
    [("lost", "no frame"), ("frozen", ""), ("elsewhere", "out-of-distribution image")],
)
def test_the_guard_answers_what_goes_wrong(disturbance: Disturbance, cause: str) -> None:
    told = steps_of(LoopSettings(disturbance=disturbance))
    states = [step["guard"]["state"] for step in told]
    assert set(states[:20]) <= {"normal", "slow"}
    if cause:
        assert "hold" in states[20:30]
        assert any(cause in step["guard"]["cause"] for step in told[20:31])
    assert (told[25]["image"] is None) == (disturbance == "lost")
    assert all(abs(after["u"] - before["u"]) <= 1 + 1e-9 for before, after in pairwise(told))


def test_the_papers_law_needs_no_guard_and_keeps_u_without_pictures() -> None:
    told = steps_of(LoopSettings(law="proportional", gain=1.0, sensor="true", disturbance="lost", target=0.2))
    assert all(step["guard"] is None for step in told)
    assert len({step["u"] for step in told[21:31]}) == 1


def test_whoever_stops_listening_stops_the_run() -> None:
    told: list[Step] = []

    def tell(step: Step) -> None:
        told.append(step)
        if len(told) == 3:
            raise Stopped

    with pytest.raises(Stopped):
        run_trial(LoopSettings(law="proportional", sensor="true"), tell)
    assert len(told) == 3


def test_steps_come_one_a_line(client: httpx.Client) -> None:
    settings = {"law": "proportional", "sensor": "true", "gain": 5, "target": 0.25}
    with client.stream("POST", "/api/trial", json=settings) as answer:
        lines = [json.loads(line) for line in answer.iter_lines()]
    assert len(lines) == HELD + RELEASED
    assert lines[-1]["target"] == 0
    assert lines[10]["F_net"] == pytest.approx(0.25, rel=0.05)


def test_a_run_that_cannot_be_ends_with_a_sentence(client: httpx.Client) -> None:
    # A thin rod rolls up and does not let go again.
    far = {"view": {"parameters": [0.004, 0.004]}, "sensor": "true"}
    with client.stream("POST", "/api/trial", json=far) as answer:
        lines = [json.loads(line) for line in answer.iter_lines()]
    assert lines[-1].get("error", "").startswith("tune")


def test_what_goes_wrong_lies_within_the_held_target() -> None:
    assert 0 < closed_loop._WRONG.start < closed_loop._WRONG.stop < HELD
