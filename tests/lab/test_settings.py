import json
import shlex
from typing import Any

import jax
import numpy as np
import pydantic
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.app.commands.lab import lab as command
from exosight.app.options import read_options
from exosight.control import CONTROL_SHAPE
from exosight.errors import InputError
from exosight.exosuit.published import published
from exosight.exosuit.shapes import FAMILIES
from exosight.lab.controls import about
from exosight.lab.designs import Slider
from exosight.lab.settings import CameraSettings, LoopSettings, PathSettings, View, read_settings
from exosight.lab.system import LabSystem, stops_of


def bounds_of(kind: type) -> dict[str, tuple[float, float]]:
    return {
        name: (bound["minimum"], bound["maximum"])
        for name, bound in pydantic.TypeAdapter(kind).json_schema()["properties"].items()
        if "minimum" in bound
    }


CAMERA = bounds_of(CameraSettings)


def sent(**changed: Any) -> bytes:
    return json.dumps(changed).encode()


def numbers(bounds: dict[str, tuple[float, float]]) -> st.SearchStrategy[dict[str, float]]:
    return st.fixed_dictionaries({}, optional={name: st.floats(*each) for name, each in bounds.items()})


cameras = st.builds(
    lambda values, corruption: CameraSettings(**values, corruption=corruption),
    numbers(CAMERA),
    st.sampled_from(["none", "noise-high", "background"]),
)


def sliders_of(lab: LabSystem, family: str = "linear") -> list[Slider]:
    options = [option for group in lab.controls.groups if group.choice for option in group.choice.options]
    own = [slider for option in options if option.name == family for slider in option.sliders]
    return [*own, *(slider for group in lab.controls.groups for slider in group.sliders)]


def a_view(data: st.DataObject, lab: LabSystem) -> View:
    design: dict[str, Any] = {}
    if lab.name == "published":
        design["family"] = data.draw(st.sampled_from(sorted(FAMILIES)))
    sliders = sliders_of(lab, design.get("family", ""))
    design |= data.draw(numbers({each.key: (each.low, each.high) for each in sliders}))
    stops = data.draw(st.lists(st.integers(0 if "family" in design else -20, 80), max_size=6))
    return View(design, tuple((round(0.05 * k, 10),) for k in stops), data.draw(cameras))


@given(st.data())
def test_settings_survive_the_way_through_json(lab: LabSystem, data: st.DataObject) -> None:
    view = a_view(data, lab)
    assert read_settings(View, pydantic.TypeAdapter(View).dump_json(view)) == view


def close(lab: LabSystem, first: View, second: View) -> None:
    """The same view; ten digits are written."""
    for key, value in lab.controls.complete(first.design).items():
        other = lab.controls.complete(second.design)[key]
        assert other == (value if isinstance(value, str) else pytest.approx(value, rel=1e-9, abs=1e-12))
    assert lab.moves(first) == lab.moves(second) or not first.drive
    for name in CAMERA:
        assert getattr(first.camera, name) == pytest.approx(getattr(second.camera, name), rel=1e-9, abs=1e-12)
    assert first.camera.corruption == second.camera.corruption


@pytest.mark.parametrize("name", ["lab", "thumb"])
@given(data=st.data())
def test_the_command_opens_the_same_view(
    name: str, request: pytest.FixtureRequest, data: st.DataObject
) -> None:
    lab: LabSystem = request.getfixturevalue(name)
    view = a_view(data, lab)
    program, verb, *words = shlex.split(lab.command(view))
    assert (program, verb) == ("exosight", "lab")
    assert words[:2] == ["--system", lab.name]
    chosen = read_options(command, words)
    assert chosen is not None
    given_to: dict[str, Any] = chosen.keywords  # pyright: ignore[reportFunctionMemberAccess]
    stops = stops_of(given_to["drive"], 1) if given_to["drive"] else lab.start.drive
    close(lab, view, View(lab.controls.parse(given_to["vary"]), stops, given_to["camera"]))


@given(st.sampled_from(sorted(CAMERA)), st.floats(allow_nan=True, allow_infinity=True))
def test_a_number_out_of_bounds_is_refused_by_its_name(name: str, value: float) -> None:
    low, high = CAMERA[name]
    if low <= value <= high:
        assert getattr(read_settings(View, sent(camera={name: value})).camera, name) == value
        return
    with pytest.raises(InputError, match=f"^camera.{name}: "):
        read_settings(View, sent(camera={name: value}))


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        (b"", "request: invalid JSON"),
        (b"{", "request: invalid JSON"),
        (b"[" * 100_000, "request: invalid JSON"),
        (b"\xff\xfe", "request: invalid JSON"),
        (b"[]", "request: "),
        (sent(colour="red"), "colour: unexpected"),
        (sent(design=[]), "design: "),
        (sent(design={"colour": "red"}), "design.colour: it does not vary in published; expected family, "),
        (sent(design={"family": "cube"}), "design.family: expected one of linear, sine, "),
        (sent(design={"family": ["sine"]}), "design.family: expected one of linear, sine, "),
        (sent(design={"family": "sine", "r1": 5}), "design.r1: it does not vary in published"),
        (sent(design={"r1": 0.005}), "design.r1: expected 4 to 10 mm, got 0.005"),
        (sent(design={"length": "100"}), "design.length: expected 70 to 110 mm, got 100"),
        (b'{"design": {"length": NaN}}', "design.length: "),
        (b'{"design": {"length": 1e999}}', "design.length: "),
        (sent(drive=[[0.0]] * 65), "drive: "),
        (sent(drive=[[]]), "drive.0: "),
        (sent(drive=[[1.0, 2.0]]), "drive.0: expected a command for each channel (u), got 2"),
        (sent(drive=[[2.41]]), "drive.0.u: expected multiples of 0.05 N"),
        (sent(drive=[[-0.05]]), "drive.0.u: expected 0 to 4 N"),
        (b'{"drive": [[1e308]]}', "drive.0.u: expected"),
        (b'{"camera": {"zoom": -Infinity}}', "camera.zoom: "),
        (sent(camera={"corruption": "none; rm -rf /"}), "camera.corruption: "),
    ],
)
def test_what_is_no_view_is_refused_in_one_sentence(lab: LabSystem, body: bytes, sentence: str) -> None:
    with pytest.raises(InputError) as refusal:
        lab.check(read_settings(View, body))
    assert str(refusal.value).startswith(sentence)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 500


@pytest.mark.parametrize(
    ("design", "sentence"),
    [
        ({"young": 1.0}, "design.young: it does not vary in thumb; expected rods.sleeve.young, "),
        ({"rods.sleeve.young": 199.0}, "design.rods.sleeve.young: expected 200 to 400 kPa, got 199"),
        ({"rods.sleeve.young": "300 kPa"}, "design.rods.sleeve.young: expected 200 to 400 kPa"),
        ({"rods.sleeve.young": True}, "design.rods.sleeve.young: "),
        ({"rods.sleeve.young": float("nan")}, "design.rods.sleeve.young: "),
        ({"rods.sleeve.radius.scale": [1.0]}, "design.rods.sleeve.radius.scale: expected 0.85 to 1.15, got"),
    ],
)  # fmt: skip
def test_what_is_no_design_of_a_file_is_refused(thumb: LabSystem, design: Any, sentence: str) -> None:
    with pytest.raises(InputError) as refusal:
        thumb.check(View(design))
    assert str(refusal.value).startswith(sentence)


@pytest.mark.parametrize(
    ("text", "value"), [("250 kPa", 250.0), ("0.25 MPa", 250.0), ("250000 Pa", 250.0), ("2.5e2 kPa", 250.0)]
)
def test_entries_are_read_in_any_unit_of_their_quantity(thumb: LabSystem, text: str, value: float) -> None:
    values = thumb.controls.parse([f"rods.sleeve.young={text}"])
    assert values == {"rods.sleeve.young": pytest.approx(value)}
    rod = thumb.controls.build(thumb.controls.complete(values)).bodies
    assert [float(body.young) for body in rod if body.name == "sleeve"] == [pytest.approx(250e3)]  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("settings", [LoopSettings, PathSettings])
def test_a_run_and_a_path_are_refused_for_their_view_too(lab: LabSystem, settings: Any) -> None:
    with pytest.raises(InputError, match=r"^design\.young: "):
        lab.check(read_settings(settings, sent(view={"design": {"young": 0}})))
    with pytest.raises(InputError, match=r"^view\.camera\.zoom: "):
        read_settings(settings, sent(view={"camera": {"zoom": 0}}))


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_starts_with_a_shape_of_its_own(lab: LabSystem, family: str) -> None:
    system = lab.controls.build(lab.controls.complete({"family": family}))
    (radii,) = (np.asarray(tube.radius) for tube in system.tubes if tube.name == "exosuit")
    assert np.ptp(radii) > 1e-4  # 0.1 mm: no plain cylinder


def test_the_ends_of_every_slider_are_shapes(lab: LabSystem) -> None:
    for family in FAMILIES:
        for end in ("low", "high"):
            values = {slider.key: getattr(slider, end) for slider in sliders_of(lab, family)}
            lab.controls.build(lab.controls.complete({"family": family, **values}))


def test_nominal_values_are_the_exosuit_of_the_papers_controller(lab: LabSystem) -> None:
    ours, theirs = lab.controls.build(lab.controls.complete({})), published(CONTROL_SHAPE)
    for mine, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-15)


@pytest.mark.parametrize("name", ["lab", "thumb", "assisted"])
def test_the_page_is_told_every_channel_sensor_and_slider(name: str, request: pytest.FixtureRequest) -> None:
    lab: LabSystem = request.getfixturevalue(name)
    told = about(lab, lab.start)
    json.dumps(told, allow_nan=False)
    assert [(each["name"], each["unit"]) for each in told["channels"]] == [
        (channel.name, channel.unit) for channel in lab.schema.channels
    ]
    assert [each["name"] for each in told["sensors"]] == [sensor.name for sensor in lab.schema.sensors]
    sliders = [spec for group in told["design"] for spec in group["sliders"]]
    assert {spec["key"] for spec in sliders} <= set(lab.controls.complete({}))
    for spec in [*sliders, *told["camera"]]:
        assert spec["low"] <= spec["start"] <= spec["high"]
    assert [option["name"] for option in told["run"]["measured"]] == (
        ["network", "true"] if lab.refusal is None else ["true"]
    )
