from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from exosight.errors import InputError
from exosight.system import (
    Channel,
    Schema,
    SensorSpec,
    ViewSpec,
    difference,
    network_difference,
    schema_from_dict,
    schema_to_dict,
)

FORCE = ("contact force", "N")
SCHEMA = Schema(
    "hand",
    (Channel("u", "N", -1.0, 4.0, rate=10.0), Channel("p", "kPa", 0.0, 80.0, drive=40.0)),
    (
        SensorSpec("a", *FORCE, estimated=True),
        SensorSpec("b", *FORCE, estimated=True, limit=0.5),
        SensorSpec("c", *FORCE),
        SensorSpec("sum", "net force", "N", parts=("a", "b")),
        SensorSpec("all", "net force", "N", parts=("sum", "c")),
        SensorSpec("angle", "joint angle", "rad", estimated=True),
    ),
    (ViewSpec("side", 128, 96),),
)


def test_what_is_written_reads_back() -> None:
    assert schema_from_dict(schema_to_dict(SCHEMA)) == SCHEMA
    assert difference(SCHEMA, schema_from_dict(schema_to_dict(SCHEMA))) is None


def test_images_of_a_file_that_does_not_say_their_visibility_are_stacked() -> None:
    """So are those of networks and datasets from before there was a choice; what identifies them stays."""
    values = schema_to_dict(SCHEMA)
    assert values["cameras"] == [{"name": "side", "width": 128, "height": 96}]
    assert schema_from_dict(values).cameras[0].visibility == "stacked"
    deep = replace(SCHEMA, cameras=(ViewSpec("side", 128, 96, "depth"),))
    assert schema_from_dict(schema_to_dict(deep)) == deep
    assert network_difference(SCHEMA, deep) == "camera side: expected visibility stacked, got depth"


def test_sums_follow_from_outputs() -> None:
    assert SCHEMA.outputs == ("a", "b", "angle")
    assert SCHEMA.output_indices() == [0, 1, 5]
    assert SCHEMA.controllable == ("a", "b", "sum", "angle")
    assert SCHEMA.controlled == "sum"
    np.testing.assert_array_equal(SCHEMA.weights("sum"), [1, 1, 0])
    np.testing.assert_array_equal(SCHEMA.weights("angle"), [0, 0, 1])
    for name in ("c", "all"):
        with pytest.raises(InputError, match="choose one of a, b, sum, angle"):
            SCHEMA.weights(name)
    with pytest.raises(InputError, match="expected one of a, b"):
        SCHEMA.weights("d")
    with pytest.raises(InputError, match=r"got 'a\+c'; a sum of some is a sensor of type net_force"):
        SCHEMA.weights("a+c")


def test_paths_end_at_drive_or_at_the_farther_end() -> None:
    assert [channel.peak for channel in SCHEMA.channels] == [4.0, 40.0]
    assert Channel("x", "N", -6.0, 2.0).peak == -6.0


@pytest.mark.parametrize(
    ("other", "parts", "sentence"),
    [
        (replace(SCHEMA, system="foot"), ("channels", "sensors", "cameras"), None),
        (
            replace(SCHEMA, channels=SCHEMA.channels[:1]),
            ("channels",),
            "expected the channels u, p, got u",
        ),
        (replace(SCHEMA, channels=SCHEMA.channels[:1]), ("sensors", "cameras"), None),
        (
            replace(SCHEMA, channels=(replace(SCHEMA.channels[0], high=6.0), SCHEMA.channels[1])),
            ("channels",),
            "channel u: expected high 4, got 6",
        ),
        (
            replace(SCHEMA, cameras=(ViewSpec("side", 64, 96),)),
            ("sensors", "cameras"),
            "camera side: expected width 128, got 64",
        ),
        (
            replace(SCHEMA, sensors=(*SCHEMA.sensors[:3], replace(SCHEMA.sensors[3], parts=("a",)))),
            ("sensors",),
            "expected the sensors a, b, c, sum, all, angle, got a, b, c, sum",
        ),
    ],
)
def test_a_difference_is_one_sentence(other: Schema, parts: tuple[str, ...], sentence: str | None) -> None:
    assert difference(SCHEMA, other, parts) == sentence


def test_a_network_serves_every_system_with_its_estimated_sensors_and_cameras() -> None:
    a, b, c, total, _, angle = SCHEMA.sensors
    other_sums = replace(SCHEMA, sensors=(a, replace(b, limit=0.2), angle, replace(total, name="other")))
    assert network_difference(SCHEMA, other_sums) is None
    fewer = replace(SCHEMA, sensors=(a, b, replace(c, estimated=True), total))
    assert network_difference(SCHEMA, fewer) == "expected the sensors a, b, angle, got a, b, c"
    slower = replace(SCHEMA, channels=(replace(SCHEMA.channels[0], rate=1.0), SCHEMA.channels[1]))
    assert network_difference(SCHEMA, slower) is None
    assert network_difference(SCHEMA, slower, channels=True) == "channel u: expected rate 10, got 1"


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"channels": (SCHEMA.channels[0],) * 2}, "channels: expected different names, got u twice"),
        ({"sensors": (SCHEMA.sensors[0],) * 2}, "sensors: expected different names, got a twice"),
        ({"sensors": SCHEMA.sensors[3:]}, "sensor sum: it sums a, which is no sensor before it"),
        (
            {"sensors": (SCHEMA.sensors[5], replace(SCHEMA.sensors[3], parts=("angle",)))},
            "sensor sum: it sums angle, which is in rad, not N",
        ),
        ({"cameras": ()}, "at least 1"),
    ],
)
def test_a_schema_that_contradicts_itself_is_refused(wrong: dict, sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        replace(SCHEMA, **wrong)


@pytest.mark.parametrize("limits", [(1.0, 4.0), (-4.0, -1.0), (0.0, 0.0)])
def test_a_range_without_rest_is_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(ValidationError, match="expected a range with 0 in it"):
        Channel("u", "N", *limits)


def test_text_that_is_no_schema_names_the_entry() -> None:
    with pytest.raises(InputError, match=r"schema: sensors\.0\.quantity"):
        schema_from_dict(
            {**schema_to_dict(SCHEMA), "sensors": [{"name": "a", "quantity": "colour", "unit": "N"}]}
        )
