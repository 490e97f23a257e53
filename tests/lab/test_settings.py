import json
import shlex
from typing import Any, get_args

import numpy as np
import pydantic
import pytest
from example_systems import THUMB
from hypothesis import given
from hypothesis import strategies as st

from exosight.app.commands.lab import lab as command
from exosight.app.options import read_options
from exosight.errors import InputError
from exosight.exosuit.shapes import FAMILIES, radius
from exosight.lab.controls import about
from exosight.lab.published_controls import STARTS
from exosight.lab.published_design import Family, PublishedDesign, shape_of, values_of
from exosight.lab.settings import Look, LoopSettings, PathSettings, View, read_settings
from exosight.lab.system import LabSystem, stops_of


def bounds_of(kind: type) -> dict[str, tuple[float, float]]:
    return {
        name: (bound["minimum"], bound["maximum"])
        for name, bound in pydantic.TypeAdapter(kind).json_schema()["properties"].items()
        if "minimum" in bound
    }


DESIGN, LOOK = bounds_of(PublishedDesign), bounds_of(Look)


def sent(**changed: Any) -> bytes:
    return json.dumps(changed).encode()


def numbers(bounds: dict[str, tuple[float, float]]) -> st.SearchStrategy[dict[str, float]]:
    return st.fixed_dictionaries({}, optional={name: st.floats(*each) for name, each in bounds.items()})


looks = st.builds(
    lambda values, corruption: Look(**values, corruption=corruption),
    numbers(LOOK),
    st.sampled_from(["none", "noise-high", "background"]),
)


@st.composite
def views(draw: st.DrawFn) -> View:
    family = draw(st.sampled_from(get_args(Family)))
    design = {"family": family, "parameters": list(STARTS[family]), **draw(numbers(DESIGN))}
    stops = draw(st.lists(st.integers(0, 80), max_size=6))
    return View(design, tuple((round(0.05 * k, 10),) for k in stops), draw(looks))


@st.composite
def thumb_views(draw: st.DrawFn) -> View:
    design = draw(numbers({"rods.sleeve.young": (200, 400), "rods.sleeve.radius.scale": (0.85, 1.15)}))
    stops = draw(st.lists(st.integers(-20, 80), max_size=6))
    return View(dict(design), tuple((round(0.05 * k, 10),) for k in stops), draw(looks))


@given(views())
def test_settings_survive_the_way_through_json(view: View) -> None:
    assert read_settings(View, pydantic.TypeAdapter(View).dump_json(view)) == view


def close(lab: LabSystem, first: View, second: View) -> None:
    """The same view; ten digits are written."""
    for key, value in lab.controls.complete(first.design).items():
        other = lab.controls.complete(second.design)[key]
        assert other == (value if isinstance(value, str) else pytest.approx(value, rel=1e-9, abs=1e-12))
    assert lab.moves(first) == lab.moves(second) or not first.drive
    for name in LOOK:
        assert getattr(first.look, name) == pytest.approx(getattr(second.look, name), rel=1e-9, abs=1e-12)
    assert first.look.corruption == second.look.corruption


@given(views())
def test_the_command_opens_the_same_view(lab: LabSystem, view: View) -> None:
    program, name, *words = shlex.split(lab.command(view))
    assert (program, name) == ("exosight", "lab")
    chosen = read_options(command, words)
    assert chosen is not None
    given_to: dict[str, Any] = chosen.keywords  # pyright: ignore[reportFunctionMemberAccess]
    stops = stops_of(given_to["drive"], 1) if given_to["drive"] else lab.start.drive
    close(lab, view, View(values_of(given_to["design"]), stops, given_to["look"]))


@given(thumb_views())
def test_the_command_opens_the_same_view_of_a_file(thumb: LabSystem, view: View) -> None:
    program, name, *words = shlex.split(thumb.command(view))
    assert (program, name, *words[:2]) == ("exosight", "lab", "--system", str(THUMB))
    chosen = read_options(command, words)
    assert chosen is not None
    given_to: dict[str, Any] = chosen.keywords  # pyright: ignore[reportFunctionMemberAccess]
    stops = stops_of(given_to["drive"], 1) if given_to["drive"] else thumb.start.drive
    close(thumb, view, View(thumb.controls.parse(given_to["vary"]), stops, given_to["look"]))  # pyright: ignore[reportAttributeAccessIssue]


@given(st.sampled_from(sorted(LOOK)), st.floats(allow_nan=True, allow_infinity=True))
def test_a_number_out_of_bounds_is_refused_by_its_name(name: str, value: float) -> None:
    low, high = LOOK[name]
    if low <= value <= high:
        assert getattr(read_settings(View, sent(look={name: value})).look, name) == value
        return
    with pytest.raises(InputError, match=f"^look.{name}: "):
        read_settings(View, sent(look={name: value}))


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
        (sent(design={"colour": "red"}), "design.colour: unexpected"),
        (sent(design={"family": "cube"}), "design.family: input should be 'linear'"),
        (sent(design={"family": "sine"}), "sine: a must be a number within"),
        (sent(design={"parameters": [0.01]}), "parameters: the family linear has 2"),
        (sent(design={"parameters": [0.01, 0.2]}), "linear: r1 must be a number within"),
        (sent(design={"parameters": []}), "design.parameters: "),
        (sent(design={"parameters": [True, "0.005"]}), "design.parameters.0: input should be a valid number"),
        (sent(design={"length": "0.1"}), "design.length: input should be a valid number"),
        (b'{"design": {"length": NaN}}', "design.length: "),
        (b'{"design": {"length": 1e999}}', "design.length: "),
        (sent(drive=[[0.0]] * 65), "drive: "),
        (sent(drive=[[]]), "drive.0: "),
        (sent(drive=[[1.0, 2.0]]), "drive.0: expected a command for each channel (u), got 2"),
        (sent(drive=[[2.41]]), "drive.0.u: expected multiples of 0.05 N"),
        (sent(drive=[[-0.05]]), "drive.0.u: expected 0 to 4 N"),
        (b'{"drive": [[1e308]]}', "drive.0.u: expected"),
        (b'{"look": {"zoom": -Infinity}}', "look.zoom: "),
        (sent(look={"corruption": "none; rm -rf /"}), "look.corruption: "),
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
    values = thumb.controls.parse([f"rods.sleeve.young={text}"])  # pyright: ignore[reportAttributeAccessIssue]
    assert values == {"rods.sleeve.young": pytest.approx(value)}
    rod = thumb.controls.build(thumb.controls.complete(values)).bodies
    assert [float(body.young) for body in rod if body.name == "sleeve"] == [pytest.approx(250e3)]  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("settings", [LoopSettings, PathSettings])
def test_a_run_and_a_path_are_refused_for_their_view_too(lab: LabSystem, settings: Any) -> None:
    with pytest.raises(InputError, match=r"^design\.young: "):
        lab.check(read_settings(settings, sent(view={"design": {"young": 0}})))
    with pytest.raises(InputError, match=r"^view\.look\.zoom: "):
        read_settings(settings, sent(view={"look": {"zoom": 0}}))


@pytest.mark.parametrize("family", get_args(Family))
def test_every_family_starts_with_a_shape_of_its_own(family: Family) -> None:
    shape = shape_of(PublishedDesign(family=family, parameters=STARTS[family]))
    across = radius(shape.surface, np.linspace(0, 1, 9))
    assert shape.surface.family == family
    assert set(get_args(Family)) == set(FAMILIES)
    assert across.max() - across.min() > 1e-4  # 0.1 mm: no plain cylinder


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
    own = set(lab.controls.complete({})) - {"family", "parameters"}
    assert {spec["key"] for spec in sliders} == own
    for spec in [*sliders, *told["look"]]:
        assert spec["low"] <= spec["start"] <= spec["high"]
    assert [option["name"] for option in told["run"]["measured"]] == (
        ["network", "true"] if lab.refusal is None else ["true"]
    )
