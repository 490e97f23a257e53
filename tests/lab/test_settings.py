import json
import shlex
from typing import Any, get_args

import numpy as np
import pydantic
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exosight.app.commands.lab import lab
from exosight.app.options import read_options
from exosight.errors import InputError
from exosight.exosuit.shapes import FAMILIES, radius
from exosight.lab.controls import STARTS, about
from exosight.lab.saving import command_of
from exosight.lab.settings import LARGEST, STEP, Family, LoopSettings, View, read_settings, shape_of

TOP = round(LARGEST / STEP)
BOUNDS = {
    name: (bound["minimum"], bound["maximum"])
    for name, bound in pydantic.TypeAdapter(View).json_schema()["properties"].items()
    if "minimum" in bound
}


def sent(**changed: Any) -> bytes:
    return json.dumps(changed).encode()


numbers = st.fixed_dictionaries({}, optional={name: st.floats(*bounds) for name, bounds in BOUNDS.items()})


@st.composite
def views(draw: st.DrawFn) -> View:
    family = draw(st.sampled_from(get_args(Family)))
    return View(
        family=family,
        parameters=STARTS[family],
        drive=tuple(STEP * k for k in draw(st.lists(st.integers(0, TOP), min_size=1, max_size=6))),
        corruption=draw(st.sampled_from(["none", "noise-high", "background"])),
        **draw(numbers),
    )


@given(views())
def test_settings_survive_the_way_through_json(view: View) -> None:
    assert read_settings(View, pydantic.TypeAdapter(View).dump_json(view)) == view


@given(views())
def test_the_command_opens_the_same_view(view: View) -> None:
    program, name, *words = shlex.split(command_of(view))
    assert (program, name) == ("exosight", "lab")
    chosen = read_options(lab, words)
    assert chosen is not None
    seen = chosen.keywords["view"]  # pyright: ignore[reportFunctionMemberAccess]
    for key in ("family", "corruption"):
        assert getattr(seen, key) == getattr(view, key)
    # Ten digits are written.
    for key in ("parameters", "drive", *BOUNDS):
        assert getattr(seen, key) == pytest.approx(getattr(view, key), rel=1e-9, abs=1e-12)


@given(st.sampled_from(sorted(BOUNDS)), st.floats(allow_nan=True, allow_infinity=True))
def test_a_number_out_of_bounds_is_refused_by_its_name(name: str, value: float) -> None:
    low, high = BOUNDS[name]
    if low <= value <= high:
        assert getattr(read_settings(View, sent(**{name: value})), name) == value
        return
    with pytest.raises(InputError, match=f"^{name}: "):
        read_settings(View, sent(**{name: value}))


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        (b"", "request: invalid JSON"),
        (b"{", "request: invalid JSON"),
        (b"[" * 100_000, "request: invalid JSON"),
        (b"\xff\xfe", "request: invalid JSON"),
        (b"[]", "request: "),
        (sent(colour="red"), "colour: unexpected"),
        (sent(family="cube"), "family: input should be 'linear'"),
        (sent(family="sine"), "sine: a must be a number within"),
        (sent(parameters=[0.01]), "parameters: the family linear has 2"),
        (sent(parameters=[0.01, 0.2]), "linear: r1 must be a number within"),
        (sent(parameters=[]), "parameters: "),
        (sent(parameters=[True, "0.005"]), "parameters.0: input should be a valid number"),
        (sent(drive=[]), "drive: "),
        (sent(drive=[0.0] * 65), "drive: "),
        (sent(drive=[2.41]), "drive.0: expected multiples of 0.05 N"),
        (sent(drive=[-0.05]), "drive.0: "),
        (b'{"length": NaN}', "length: "),
        (b'{"length": -Infinity}', "length: "),
        (b'{"length": 1e999}', "length: "),
        (sent(length="0.1"), "length: input should be a valid number"),
        (sent(corruption="none; rm -rf /"), "corruption: "),
    ],
)
def test_what_is_no_view_is_refused_in_one_sentence(body: bytes, sentence: str) -> None:
    with pytest.raises(InputError) as refusal:
        read_settings(View, body)
    assert str(refusal.value).startswith(sentence)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 500


def test_a_run_is_refused_for_its_view_too() -> None:
    with pytest.raises(InputError, match=r"^view\.young: "):
        read_settings(LoopSettings, sent(view={"young": 0}))
    with pytest.raises(InputError, match=r"^parameters: "):
        read_settings(LoopSettings, sent(view={"family": "legendre"}))
    with pytest.raises(InputError, match=r"^gain: "):
        read_settings(LoopSettings, sent(gain=0))


@pytest.mark.parametrize("family", get_args(Family))
def test_every_family_starts_with_a_shape_of_its_own(family: Family) -> None:
    shape = shape_of(View(family=family, parameters=STARTS[family]))
    across = radius(shape.surface, np.linspace(0, 1, 9))
    assert shape.surface.family == family
    assert set(get_args(Family)) == set(FAMILIES)
    assert across.max() - across.min() > 1e-4  # 0.1 mm: no plain cylinder


def test_the_page_is_told_every_setting_and_its_bounds() -> None:
    told = about()
    sliders = {spec["key"]: spec for group in told["groups"].values() for spec in group}
    assert set(sliders) == set(BOUNDS)
    for name, spec in sliders.items():
        assert (spec["low"], spec["high"]) == BOUNDS[name]
        assert spec["low"] <= spec["start"] <= spec["high"]
    json.dumps(told, allow_nan=False)
