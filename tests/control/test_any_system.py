"""Control of systems of a user's own: the thumb of the examples, and one with two channels."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from schemas import published_schema

from exosight.control import (
    ControllerConfig,
    Guarded,
    OnnxEstimator,
    Proportional,
    Scheduled,
    from_image,
    hold,
    hold_and_release,
    run,
    run_guarded,
    true_measurement,
    true_reading,
)
from exosight.control.batch import BatchPlant, Joints
from exosight.control.estimator import DEFAULT_MODEL
from exosight.control.realtime import Clock, Step, run_live
from exosight.control.recording import Recorder, read_recording
from exosight.control.replay import replay
from exosight.control.scheduled import RELEASED
from exosight.control.simulated import SimulatedPlant
from exosight.control.simulated_device import SimulatedDevice
from exosight.control.tuning import default_limits, tune
from exosight.errors import InputError
from exosight.system.designs import FileDesigns
from exosight.system.file import read_system_file
from exosight.system.system import System

THUMB = Path(__file__).parents[2] / "examples" / "systems" / "thumb.toml"
BAND = 0.05  # share of the target within which a response has settled
SMALL = {"width": 48, "height": 32, "pixel": "3 mm"}


def built(**tables: dict) -> System:
    """The thumb with small pictures, half of the points along its sleeve, and further tables."""
    values = dict(read_system_file(THUMB))
    values["cameras"] = {"side": {**values["cameras"]["side"], **SMALL}}
    values["rods"] = {"sleeve": {**values["rods"]["sleeve"], "points_per_element": 4}}
    for name, entries in tables.items():
        values[name] = {**values[name], **entries}
    designs = FileDesigns(values)
    return designs.build(designs.nominal())


@pytest.fixture(scope="module")
def thumb() -> System:
    """Its two further zones are summed by a sensor of their own."""
    return built(sensors={"ends": {"type": "net_force", "parts": ["P2", "P3"]}})


@pytest.fixture(scope="module")
def driven() -> System:
    """The thumb with an air muscle at its knuckle, which extends it against the sleeve on its back."""
    muscle = {
        "type": "joint_torque",
        "body": "proximal",
        "range": ["-20 kPa", "60 kPa"],
        "gain": "-0.001 N m/kPa",
        "rate": "150 kPa/s",
    }
    return built(actuators={"muscle": muscle})


@pytest.fixture(scope="module")
def config(thumb: System) -> ControllerConfig:
    return tune(thumb, "ends")


def test_the_sum_of_two_zones_settles_on_its_target_and_is_released(
    thumb: System, config: ControllerConfig
) -> None:
    target = 0.5 * config.loading.controlled[-1]
    steps = hold_and_release(float(target), 25)
    guarded = Guarded(Scheduled(config))
    record = run_guarded(SimulatedPlant(thumb), guarded, true_measurement, steps)
    parts = [thumb.schema.index(name) for name in ("P2", "P3")]
    assert record.sensor == "ends"
    np.testing.assert_array_equal(np.flatnonzero(thumb.schema.weights("ends")), [1, 2])
    assert np.abs(record.true[10:25] - target).max() <= BAND * target
    assert record.true[-5:].max() < RELEASED
    assert len(parts) == 2
    assert guarded.log == []


def test_the_papers_law_settles_on_a_single_zone(thumb: System) -> None:
    plant, channel = SimulatedPlant(thumb), thumb.schema.channels[0]
    record = run(plant, Proportional(3.0, channel), true_reading("P3"), hold(0.15, 40), "P3")
    assert abs(record.true[-1] - 0.15) <= BAND * 0.15
    assert record.controlled.name == "P3"


def test_the_path_ends_where_the_controlled_sensor_reads_most(
    thumb: System, config: ControllerConfig
) -> None:
    """Further up the sleeve leaves the third zone, which reads less where the second meets its limit."""
    known = tune(thumb, "P3")
    readings = known.loading.controlled
    assert readings[-1] == readings.max() > 30 * RELEASED
    assert known.u_max < config.u_max
    assert known.default_target == pytest.approx(0.5 * readings[-1], rel=0.05)  # two digits
    target = known.default_target
    record = run_guarded(SimulatedPlant(thumb), Guarded(Scheduled(known)), true_measurement, hold(target, 20))
    assert abs(record.true[-1] - target) <= BAND * target


def test_limits_are_those_of_the_zones_and_give_way_to_the_option(
    thumb: System, config: ControllerConfig
) -> None:
    schema = thumb.schema
    tight = replace(
        schema, sensors=tuple(replace(s, limit=0.2) if s.name == "P1" else s for s in schema.sensors)
    )
    np.testing.assert_array_equal(default_limits(tight), [0.2, 0.5, 0.5])
    np.testing.assert_array_equal(default_limits(tight, 0.3), [0.3, 0.3, 0.3])
    assert (config.loading.outputs <= config.output_limits).all()
    # u stays in the channel's range, and the rate is the channel's own.
    assert config.u_max <= schema.channels[0].high
    assert config.rate == schema.channels[0].rate


def test_the_second_channel_is_driven_while_the_first_rests(driven: System) -> None:
    plant = SimulatedPlant(driven)
    known = tune(driven, channel="muscle")
    target = 0.5 * float(known.loading.controlled[-1])
    record = run_guarded(plant, Guarded(Scheduled(known)), true_measurement, hold(target, 25))
    assert record.channel == "muscle"
    assert record.driven.unit == "kPa"
    assert abs(record.true[-1] - target) <= BAND * target
    seen = plant.look()
    assert seen.commands[0] == 0
    assert seen.commands[1] == pytest.approx(record.command[-1])
    changes = np.abs(np.diff(record.command))
    assert changes.max() <= known.rate * known.period + 1e-12  # round-off of sums


def test_a_run_of_the_second_channel_is_recorded_and_replays_to_the_same_numbers(
    driven: System, tmp_path: Path
) -> None:
    known = tune(driven, channel="muscle")
    plant, guarded = SimulatedPlant(driven), Guarded(Scheduled(known))
    device = SimulatedDevice(
        plant, known, clock := Clock(iter(np.arange(1000) * 1e-3).__next__, lambda s: None)
    )

    def read(images: np.ndarray):
        """A perfect network: it answers what the plant reads."""
        answer = true_measurement(plant.look()).reading
        assert answer is not None
        return answer

    steps: list[Step] = []
    recorder = Recorder(tmp_path / "run.h5", (32, 48), guarded, Path(__file__))

    def done(step: Step) -> None:
        steps.append(step)
        recorder.append(step)

    run_live(device, read, guarded, device, [0.1] * 12, done, clock)
    recorder.close()
    told = read_recording(tmp_path / "run.h5")
    assert (told.controller.sensor, told.controller.channel) == ("F_net", "muscle")
    assert told.controller.schema == driven.schema
    np.testing.assert_array_equal(told.command, [step.command for step in steps])
    np.testing.assert_array_equal(told.reported[:, 0], 0.0)
    assert told.reported[-1, 1] > 0
    np.testing.assert_array_equal(told.true, [step.true for step in steps])
    answers = iter(told.estimated)

    def again(images: np.ndarray):
        row = next(answers)[None]
        return replace(read(images), forces=row, low=row, high=row)

    replayed = replay(told, again)
    np.testing.assert_array_equal(replayed.command, told.command)
    np.testing.assert_array_equal(replayed.state, told.state)


def test_a_network_of_another_system_is_refused_in_a_sentence(thumb: System) -> None:
    with pytest.raises(InputError, match=r"expected the sensors .*; choose another model") as caught:
        from_image(OnnxEstimator.load(DEFAULT_MODEL), thumb.schema)
    assert "\n" not in str(caught.value)


def test_a_controller_of_another_system_is_refused(thumb: System, config: ControllerConfig) -> None:
    other = replace(config.schema, channels=(replace(config.schema.channels[0], high=3.0),))
    with pytest.raises(InputError, match="channel u: expected high 3, got 4; tune it again"):
        run_guarded(
            SimulatedPlant(thumb),
            Guarded(Scheduled(replace(config, schema=other))),
            true_measurement,
            hold(0.1, 3),
        )


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({"sensor": "P9"}, "sensor: expected one of P1"),
        ({"sensor": "knuckle"}, "not estimated from images; choose one of P1, P2, P3, F_net"),
        ({"channel": "x"}, "channel: expected one of u, got 'x'"),
    ],
)
def test_names_that_are_none_of_the_systems_are_refused(
    thumb: System, names: dict[str, str], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        tune(thumb, **names)


def test_users_of_a_thumb_rest_flexed_where_nothing_presses(thumb: System) -> None:
    """Below 0 N the sleeve lets go, so each joint turns to where its spring is slack."""
    plants = BatchPlant([thumb] * 2)
    own = plants.resting
    assert own.stiffness.shape == (2, 2)
    rest = np.array([[0.2, 0.1], [0.0, 0.3]])
    state = plants.step(np.full((2, 1), -1.0), Joints(own.stiffness, rest))
    assert state.converged.all()
    assert state.reading("F_net").max() == 0
    np.testing.assert_allclose(state.reading("knuckle"), rest[:, 0], atol=1e-7)  # the solver's tolerance


def test_plants_of_several_systems_are_refused(thumb: System, driven: System) -> None:
    with pytest.raises(InputError, match="expected systems of one schema"):
        BatchPlant([thumb, driven])
    assert published_schema().system != thumb.schema.system
