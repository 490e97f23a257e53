"""How pictures may differ: what each switch draws, and what that depends on."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from exosight.errors import InputError
from exosight.vision import TRAINING, Appearance, AppearanceVariation, augment, draw_appearance
from exosight.vision.augment import COLUMNS
from exosight.vision.background import BACKGROUNDS, HELD_OUT_BACKGROUNDS
from exosight.vision.occlusion import HELD_OUT_OCCLUSIONS, OCCLUSIONS
from exosight.vision.transforms import TRANSFORMS
from exosight.vision.transforms.composition import BACKGROUND_KINDS
from exosight.vision.transforms.foreground import OCCLUSION_KINDS

EVERYTHING = dataclasses.replace(TRAINING, fingers_in_front=2, share=1.0)
NUMBERS = np.arange(500)
NEUTRAL = draw_appearance(AppearanceVariation(), 0, NUMBERS)

# Which columns each switch moves. Angles that only count together with another column are drawn always.
MOVED = {
    "shift": {"shift_x", "shift_y"},
    "roll": {"roll"},
    "zoom": {"zoom"},
    "tilt": {"tilt_x", "tilt_y"},
    "distortion": {"distortion"},
    "body_contrast": {"body_dark", "body_range"},
    "backgrounds": {name for name in COLUMNS if name.startswith("background")},
    "occlusions": {name for name in COLUMNS if name.startswith("occl")},
    "fingers_behind": {"fingers_behind"},
    "fingers_in_front": {"fingers_in_front"},
    "gradient": {"gradient"},
    "vignette": {"vignette"},
    "blur": {"blur"},
    "motion": {"motion"},
    "contrast": {"dark", "range"},
    "gamma": {"gamma"},
    "noise": {"noise"},
    "shot": {"shot"},
}
SWITCHES = [field.name for field in dataclasses.fields(AppearanceVariation)]


def test_every_switch_is_tested() -> None:
    assert {*MOVED, "share", "occluded"} == set(SWITCHES)


def test_by_default_pictures_stay_as_they_are(clean: np.ndarray) -> None:
    appearance = draw_appearance(AppearanceVariation(), 5, np.arange(len(clean)))
    np.testing.assert_array_equal(augment(clean, appearance), clean)


@pytest.mark.parametrize("switch", MOVED)
def test_a_switch_moves_its_own_columns_alone(switch: str) -> None:
    one = draw_appearance(AppearanceVariation(**{switch: getattr(EVERYTHING, switch)}), 0, NUMBERS)
    together = draw_appearance(dataclasses.replace(EVERYTHING, occluded=(0.02, 0.15)), 0, NUMBERS)
    changed = {name for name in COLUMNS if np.any(one[name] != NEUTRAL[name])}
    assert changed == MOVED[switch]
    for name in changed:
        np.testing.assert_array_equal(one[name], together[name])


@settings(max_examples=25)
@given(st.integers(0, 2**40), st.lists(st.integers(0, 2**40), min_size=1, max_size=6))
def test_a_frame_does_not_depend_on_batch_or_order(seed: int, numbers: list[int]) -> None:
    together = draw_appearance(EVERYTHING, seed, np.array(numbers))
    for row, number in enumerate(numbers):
        alone = draw_appearance(EVERYTHING, seed, np.array([number]))
        assert {name: alone[name][0] for name in COLUMNS} == {name: together[name][row] for name in COLUMNS}


@settings(max_examples=20)
@given(st.floats(0, 1), st.integers(0, 2**40))
def test_numbers_lie_within_the_limits(share: float, seed: int) -> None:
    v = dataclasses.replace(EVERYTHING, share=share)
    a = draw_appearance(v, seed, NUMBERS)
    for name, limit in (
        ("shift_x", v.shift), ("shift_y", v.shift), ("roll", v.roll), ("tilt_x", v.tilt), ("tilt_y", v.tilt),
        ("distortion", v.distortion), ("gradient", v.gradient), ("vignette", v.vignette), ("blur", v.blur),
        ("motion", v.motion), ("range", v.contrast), ("body_range", v.body_contrast), ("noise", v.noise),
        ("shot", v.shot), ("fingers_behind", v.fingers_behind), ("fingers_in_front", v.fingers_in_front),
    ):  # fmt: skip
        assert np.all(np.abs(a[name]) <= limit), name
    assert np.all(np.abs(np.log(a["zoom"])) <= np.log(1 + v.zoom) + 1e-12)
    assert np.all(np.abs(np.log2(a["gamma"])) <= v.gamma + 1e-12)
    assert np.all(
        (a["dark"] >= 0) & (a["dark"] <= a["range"])
    )  # white becomes dark + 1 − range, at most white
    assert np.all((a["body_dark"] >= 0) & (a["body_dark"] <= a["body_range"]))
    for end in (-1, 1):
        level = a["background_level"] + end * a["background_contrast"]
        assert np.all((level > -1e-12) & (level < 1 + 1e-12))  # a pattern is never clipped
    there = a["occlusion"] > 0
    assert np.all((a["occluded"][there] >= v.occluded[0]) & (a["occluded"][there] <= v.occluded[1]))
    assert np.all((a["seed"] >= 0) & (a["seed"] < 2**32) & (a["seed"] == np.floor(a["seed"])))


def test_a_switch_acts_on_its_share_of_the_frames_whatever_the_others_do() -> None:
    a = draw_appearance(dataclasses.replace(EVERYTHING, share=0.3), 1, np.arange(4000))
    acts = np.stack([a["noise"] > 0, a["background"] > 0, a["occlusion"] > 0, a["blur"] > 0, a["roll"] != 0])
    assert np.abs(acts.mean(axis=1) - 0.3).max() < 5 * np.sqrt(0.21 / 4000)  # five standard errors
    assert np.abs(np.corrcoef(acts) - np.eye(5)).max() < 5 / np.sqrt(4000)


def test_only_named_kinds_are_drawn_and_all_of_them() -> None:
    v = AppearanceVariation(backgrounds=("rings", "flat"), occlusions=HELD_OUT_OCCLUSIONS)
    a = draw_appearance(v, 0, NUMBERS)
    assert {BACKGROUND_KINDS[int(k) - 1] for k in a["background"]} == {"rings", "flat"}
    assert {OCCLUSION_KINDS[int(k) - 1] for k in a["occlusion"]} == set(HELD_OUT_OCCLUSIONS)


def test_kinds_to_train_with_and_to_test_with_are_apart() -> None:
    assert not set(BACKGROUNDS) & set(HELD_OUT_BACKGROUNDS)
    assert not set(OCCLUSIONS) & set(HELD_OUT_OCCLUSIONS)
    assert set(TRAINING.backgrounds) == set(BACKGROUNDS)
    assert set(TRAINING.occlusions) == set(OCCLUSIONS)


def test_training_holds_the_papers_noise_and_contrast() -> None:
    assert TRAINING.noise >= 0.1
    assert TRAINING.contrast >= 1 - (240 - 174) / 255


def test_every_transform_has_columns_of_its_own() -> None:
    names = [name for transform in TRANSFORMS for name in transform.columns]
    assert len(set(names)) == len(names)
    assert (*names, "seed") == COLUMNS
    for transform in TRANSFORMS:
        assert set(transform.switches) <= set(transform.columns)


@pytest.mark.parametrize("transform", TRANSFORMS, ids=lambda each: type(each).__name__)
def test_without_its_switches_a_transform_leaves_pictures_as_they_are(transform, clean: np.ndarray) -> None:
    """Whatever its other columns say: they only count together with a switch."""
    drawn = draw_appearance(EVERYTHING, 1, np.arange(len(clean)))
    others = {name: drawn[name] for name in transform.columns if name not in transform.switches}
    np.testing.assert_array_equal(augment(clean, Appearance.neutral(len(clean), **others)), clean)


def test_other_columns_are_refused() -> None:
    with pytest.raises(InputError, match="got 'haze'"):
        Appearance.neutral(3, haze=1.0)
    with pytest.raises(InputError, match="one length"):
        Appearance({**NEUTRAL.columns, "roll": np.zeros(3)})
    with pytest.raises(InputError, match="roll"):
        Appearance({name: values for name, values in NEUTRAL.columns.items() if name != "roll"})


@pytest.mark.parametrize(
    "wrong",
    [{"roll": -0.1}, {"noise": 2.0}, {"backgrounds": ("sky",)}, {"occluded": (0.3, 0.1)}, {"colour": 1.0}],
)
def test_impossible_variations_are_refused(wrong: dict) -> None:
    with pytest.raises(ValidationError):
        AppearanceVariation(**wrong)
