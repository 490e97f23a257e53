"""A learned correction of the adaptive controller on a plant in closed form, and the file it comes in."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from any_frames import TARGET, measurements, picture, reading, targets
from hypothesis import given, settings
from hypothesis import strategies as st
from toy import SLOPE, controller

from exosight.control import Adaptive, Measurement, State
from exosight.control.learned import FRAMES, FULL_AUTHORITY, INPUTS, NO_OVERLOAD, Learned
from exosight.control.policy_file import LearnedPolicy, PolicyCard, policy_path, write_policy
from exosight.errors import DataError, InputError
from exosight.learning.model_file import seal

CONFIG = controller(limit=0.4)
ROUND_OFF = 1e-12  # of sums of numbers up to 5 N
SINGLE = 1e-6  # inputs and weights are float32, of order 1
LARGEST = 0.1
unhurried = settings(deadline=None)


def frame(force: float, u: float, number: int) -> Measurement:
    return Measurement(picture(number), reading(force), 0.0, np.array([u]))


def follow(law: Adaptive, steps: int, s: float = 1.0, d: float = 0.0) -> list[float]:
    """Commands in closed loop with F = s · 0.1 (u − d), as the toy's path is 0.1 u."""
    u = [0.0]
    for number in range(steps):
        u.append(law.step(TARGET, frame(max(s * SLOPE * (u[-1] - d), 0.0), u[-1], number)))
    return u


def test_without_a_correction_it_is_the_adaptive_controller():
    for s, d in ((1.0, 0.0), (1.2, -0.3)):
        plain = follow(Adaptive(CONFIG), 12, s, d)
        assert follow(Learned(CONFIG, lambda _: 0.0, LARGEST), 12, s, d) == plain


def test_a_correction_is_at_most_the_largest_one():
    plain = follow(Adaptive(CONFIG), 1 + 12)
    for share, expected in ((0.5, 0.5), (-0.5, -0.5), (7.0, 1.0), (-7.0, -1.0)):
        law = Learned(CONFIG, lambda _, share=share: share, LARGEST)
        # The plant is the nominal one: where it is read does not change what the observer knows of it.
        corrected = follow(law, 1 + 12)[-1] - plain[-1]
        assert corrected == pytest.approx(expected * LARGEST * 4.0, abs=5e-3)  # a step of the observer


def test_what_is_no_number_corrects_nothing():
    plain = follow(Adaptive(CONFIG), 8)
    for wrong in (math.nan, math.inf, -math.inf):
        assert follow(Learned(CONFIG, lambda _, wrong=wrong: wrong, LARGEST), 8) == plain


def test_the_inputs_say_what_is_known():
    law = Learned(CONFIG, lambda _: 0.0, LARGEST)
    follow(law, 3, s=1.0, d=0.2)
    law.observe(frame(SLOPE * 2.8, 3.0, 3))
    known = dict(zip(INPUTS, law.inputs(TARGET).tolist(), strict=True))
    assert known["target [largest reading]"] == pytest.approx(TARGET / 0.5, abs=SINGLE)
    assert known["u [peak]"] == pytest.approx(law.step(TARGET, None) / 4.0, abs=0.3)
    s, d, _ = law.observer.state
    # By its reading alone the shift is what is left of u once 2.8 N of it press, with s as it is known.
    shift = 3.0 - s * (0.28 / s / SLOPE)
    assert known["frame -1, d by its reading alone − d [peak]"] == pytest.approx((shift - d) / 4.0, abs=0.01)
    assert known["frame -1, age [s]"] == pytest.approx(0.1, abs=SINGLE)
    assert known["frame -2, age [s]"] == pytest.approx(0.2, abs=SINGLE)
    assert known[f"frame -{FRAMES}, age [s]"] == 2.0  # so many have not come
    assert known["time since the start, 1 s at most [s]"] == pytest.approx(0.4, abs=SINGLE)


@unhurried
@given(st.lists(st.tuples(targets, measurements(), st.floats()), max_size=40))
def test_no_policy_and_no_frame_makes_it_leave_its_limits(steps):
    answers = iter([answer for *_, answer in steps] * 2)
    law, before = Learned(CONFIG, lambda _: next(answers), 1.0), 0.0
    for target, measurement, _ in steps:
        u = law.step(target, measurement)
        assert CONFIG.u_min <= u <= CONFIG.u_max  # false for NaN too
        assert abs(u - before) <= CONFIG.step + ROUND_OFF
        if law.state is State.HOLD and target >= 0.005:
            assert u <= before
        if law.state is State.RELEASE:
            assert abs(u) <= abs(before)
        before = u


def test_full_authority_is_never_lost_for_lack_of_frames():
    law = Learned(CONFIG, lambda _: 0.0, LARGEST, FULL_AUTHORITY, NO_OVERLOAD)
    follow(law, 8)
    for _ in range(60):
        last = law.step(TARGET, Measurement())
    assert law.log == []
    assert last == pytest.approx(TARGET / SLOPE, abs=0.05)


def card(**others) -> PolicyCard:
    given = {
        "exosight_version": "1",
        "schema": CONFIG.schema,
        "sensor": "F_net",
        "channel": "u",
        "inputs": INPUTS,
        "largest": LARGEST,
        "period": 0.1,
        "training": {"seed": 1},
    }
    return PolicyCard(**{**given, **others})


LAYERS = [
    (np.random.default_rng(0).normal(size=(8, len(INPUTS))), np.linspace(-1, 1, 8)),
    (np.random.default_rng(1).normal(size=(1, 8)), np.array([0.25])),
]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_policy(tmp_path / "policy.onnx", card(), LAYERS)
    return tmp_path / "policy.onnx"


def test_a_policy_comes_back_as_it_was_written(file: Path):
    policy = LearnedPolicy.load(file)
    assert policy.card == card()
    x = np.random.default_rng(2).normal(size=len(INPUTS)).astype(np.float32)
    (weight, bias), (last, offset) = LAYERS
    expected = float((last @ np.maximum(weight @ x + bias, 0) + offset)[0])
    assert policy(x) == pytest.approx(expected, rel=1e-5)  # sums of 51 products in single precision
    steps = follow(policy.controller(CONFIG), 5)
    assert len(set(steps)) > 3
    with pytest.raises(DataError, match="exists"):
        write_policy(file, card(), LAYERS)


def resealed(file: Path, change) -> Path:
    """A file that somebody changed and sealed again."""
    model = onnx.load_from_string(file.read_bytes())
    entries = {entry.key: entry.value for entry in model.metadata_props if entry.key != "sha256"}
    del model.metadata_props[:]
    onnx.helper.set_model_props(model, entries)
    change(model)
    other = file.with_name("other.onnx")
    other.write_bytes(seal(model.SerializeToString()))
    return other


def entry(model: onnx.ModelProto, key: str) -> onnx.StringStringEntryProto:
    return next(each for each in model.metadata_props if each.key == key)


def foreign(model: onnx.ModelProto) -> None:
    model.graph.node[1].op_type = "Loop"


def other_inputs(model: onnx.ModelProto) -> None:
    entry(model, "inputs").value = '["target"]'


def too_far(model: onnx.ModelProto) -> None:
    entry(model, "largest").value = "3.0"


def narrow(model: onnx.ModelProto) -> None:
    model.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (foreign, "the operator 'Loop'"),
        (other_inputs, "its card names 1 others; train it again"),
        (too_far, "largest"),
        (narrow, "do not fit its metadata"),
    ],
)
def test_a_changed_file_is_refused_in_a_sentence(file: Path, change, words: str):
    with pytest.raises(DataError, match=words):
        LearnedPolicy.load(resealed(file, change))


def test_a_damaged_or_huge_file_is_refused(file: Path, tmp_path: Path):
    content = file.read_bytes()
    for name, bytes_, words in (
        ("cut", content[:-100], "not a policy that exosight exported"),
        ("bit", content[:300] + bytes([content[300] ^ 1]) + content[301:], "truncated or changed"),
        ("huge", content + bytes(2**20), "more than 1 MiB"),
    ):
        (tmp_path / name).write_bytes(bytes_)
        with pytest.raises(DataError, match=words):
            LearnedPolicy.load(tmp_path / name)
    with pytest.raises(DataError, match="no such file"):
        LearnedPolicy.load(tmp_path / "missing")


@pytest.mark.parametrize(
    ("others", "words"),
    [
        ({"sensor": "C3"}, "the sensor 'C3' there"),
        ({"channel": "p"}, "the channel 'p' there"),
        ({"period": 0.05}, "steps of 0.05 s there"),
        ({"schema": replace(CONFIG.schema, channels=())}, "channels"),
    ],
)
def test_a_policy_of_another_loop_is_refused(tmp_path: Path, others: dict, words: str):
    write_policy(tmp_path / "policy.onnx", card(**others), LAYERS)
    with pytest.raises(InputError, match=words):
        LearnedPolicy.load(tmp_path / "policy.onnx").controller(CONFIG)


def test_names_of_policies():
    shipped = policy_path(None)
    assert shipped == policy_path(Path("index-policy"))
    assert shipped.name == "index-policy.onnx"
    assert policy_path(Path("mine.onnx")) == Path("mine.onnx")
