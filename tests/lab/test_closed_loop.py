import json
from itertools import pairwise

import httpx
import numpy as np
import pytest

from exosight.errors import InputError
from exosight.lab import closed_loop
from exosight.lab.closed_loop import HELD, RELEASED, Step, Stopped, run_trial
from exosight.lab.settings import Disturbance, LoopSettings
from exosight.lab.system import LabSystem


def steps_of(settings: LoopSettings, lab: LabSystem) -> list[Step]:
    lab.check(settings)
    told: list[Step] = []
    run_trial(settings, lab, told.append)
    return told


@pytest.mark.parametrize("name", ["lab", "thumb"])
def test_the_scheduled_law_holds_its_target_on_the_true_reading(
    name: str, request: pytest.FixtureRequest
) -> None:
    told = steps_of(LoopSettings(target=0.3, measured="true"), request.getfixturevalue(name))
    assert len(told) == HELD + RELEASED
    force = np.array([step["readings"]["F_net"] for step in told])
    assert np.all(np.abs(force[20:HELD] - 0.3) < 0.05 * 0.3)  # the band of `measure_response`
    assert force[-1] < 0.01
    assert {step["guard"]["state"] for step in told} == {"normal"}
    assert [step["time"] for step in told[:3]] == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(("name", "sensor", "target"), [("lab", "C4", 0.12), ("thumb", "P3", 0.12)])
def test_one_zone_can_be_held(name: str, sensor: str, target: float, request: pytest.FixtureRequest) -> None:
    settings = LoopSettings(sensor=sensor, target=target, measured="true", law="proportional", gain=2.0)
    told = steps_of(settings, request.getfixturevalue(name))
    assert told[HELD - 1]["readings"][sensor] == pytest.approx(target, rel=0.05)
    assert told[HELD - 1]["reading"]["estimates"][sensor]["value"] == told[HELD - 1]["readings"][sensor]


def test_the_other_channel_can_be_driven(assisted: LabSystem) -> None:
    """With the sleeve at rest the motor alone presses the thumb away from it: no force to hold."""
    settings = LoopSettings(
        channel="u", sensor="P3", target=0.1, measured="true", law="proportional", gain=2.0
    )
    told = steps_of(settings, assisted)
    assert told[HELD - 1]["readings"]["P3"] == pytest.approx(0.1, rel=0.05)
    motor = LoopSettings(
        channel="assist", sensor="P3", target=0.1, measured="true", law="proportional", gain=0.01
    )
    commands = [step["command"] for step in steps_of(motor, assisted)]
    assert max(commands) > 0
    assert max(commands) <= 0.04 + 1e-9  # the range of the channel


@pytest.mark.parametrize(
    ("disturbance", "cause"),
    [("lost", "no frame"), ("frozen", ""), ("elsewhere", "out-of-distribution image")],
)
def test_the_guard_answers_what_goes_wrong(lab: LabSystem, disturbance: Disturbance, cause: str) -> None:
    told = steps_of(LoopSettings(disturbance=disturbance), lab)
    states = [step["guard"]["state"] for step in told]
    assert set(states[:20]) <= {"normal", "slow"}
    if cause:
        assert "hold" in states[20:30]
        assert any(cause in step["guard"]["cause"] for step in told[20:31])
    assert (told[25]["image"] is None) == (disturbance == "lost")
    assert all(abs(after["command"] - before["command"]) <= 1 + 1e-9 for before, after in pairwise(told))


def test_the_papers_law_needs_no_guard_and_keeps_its_command_without_pictures(lab: LabSystem) -> None:
    settings = LoopSettings(law="proportional", gain=1.0, measured="true", disturbance="lost", target=0.2)
    told = steps_of(settings, lab)
    assert all(step["guard"] is None for step in told)
    assert len({step["command"] for step in told[21:31]}) == 1


@pytest.mark.parametrize("name", ["lab", "thumb"])
def test_a_softer_plant_bends_more_than_the_law_knows(name: str, request: pytest.FixtureRequest) -> None:
    lab: LabSystem = request.getfixturevalue(name)
    known, softer = (
        steps_of(LoopSettings(target=0.2, measured="true", disturbance=each), lab)
        for each in ("none", "softer")
    )
    assert softer[HELD - 1]["readings"]["F_net"] == pytest.approx(0.2, rel=0.05)
    assert abs(softer[HELD - 1]["command"] - known[HELD - 1]["command"]) > 0.05


def test_whoever_stops_listening_stops_the_run(lab: LabSystem) -> None:
    told: list[Step] = []

    def tell(step: Step) -> None:
        told.append(step)
        if len(told) == 3:
            raise Stopped

    with pytest.raises(Stopped):
        run_trial(LoopSettings(law="proportional", measured="true"), lab, tell)
    assert len(told) == 3


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (LoopSettings(), "measured: no estimates: the network was trained for the system published"),
        (LoopSettings(measured="true", sensor="knuckle"), "sensor knuckle: it is not estimated"),
        (
            LoopSettings(measured="true", sensor="C1"),
            "sensor: expected one of P1, P2, P3, F_net, knuckle, got 'C1'",
        ),
        (LoopSettings(measured="true", channel="p"), "channel: expected one of u, got 'p'"),
    ],
)
def test_what_a_system_does_not_have_is_refused(
    thumb: LabSystem, settings: LoopSettings, sentence: str
) -> None:
    with pytest.raises(InputError) as refusal:
        thumb.check(settings)
    assert str(refusal.value).startswith(sentence)


def test_steps_come_one_a_line(client: httpx.Client) -> None:
    settings = {"law": "proportional", "measured": "true", "gain": 5, "target": 0.25}
    with client.stream("POST", "/api/trial", json=settings) as answer:
        lines = [json.loads(line) for line in answer.iter_lines()]
    assert len(lines) == HELD + RELEASED
    assert lines[-1]["target"] == 0
    assert lines[10]["readings"]["F_net"] == pytest.approx(0.25, rel=0.05)


def test_a_run_that_cannot_be_ends_with_a_sentence(client: httpx.Client) -> None:
    # A thin rod rolls up and does not let go again.
    far = {"view": {"design": {"r0": 4.0, "r1": 4.0}}, "measured": "true"}
    with client.stream("POST", "/api/trial", json=far) as answer:
        lines = [json.loads(line) for line in answer.iter_lines()]
    assert lines[-1].get("error", "").startswith("tune")


def test_what_goes_wrong_lies_within_the_held_target() -> None:
    assert 0 < closed_loop._WRONG.start < closed_loop._WRONG.stop < HELD
