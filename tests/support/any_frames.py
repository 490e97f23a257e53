"""Readings and pictures made by hand, and measurements that are anything at all."""

from typing import Any

import numpy as np
from hypothesis import strategies as st

from exosight.control import Measurement
from exosight.control.estimator import Reading

TARGET = 0.3  # [N]


def reading(force: float, width: float = 0.01, ood_score: float = 0.3) -> Reading:
    forces = np.zeros((1, 7), np.float32)
    forces[0, 2] = force
    half = np.float32(width / 14)  # seven intervals
    return Reading(
        forces, forces - half, forces + half, np.zeros((1, 7), np.float32), np.array([ood_score], np.float32)
    )


def malformed(**fields) -> Reading:
    """A reading whose fields nobody has checked."""
    found = object.__new__(Reading)
    for name, value in {**vars(reading(0.3)), **fields}.items():
        object.__setattr__(found, name, value)
    return found


def picture(brightness: int) -> np.ndarray:
    image = np.zeros((4, 6), np.uint8)
    image[1, brightness % 6] = 100 + brightness % 100
    return image


anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True, width=32), st.floats(0, 0.5, width=32), st.just(0.25)
)


floats = st.floats(allow_nan=True, allow_infinity=True)
JUNK = st.one_of(
    st.none(),
    st.text(max_size=3),
    st.binary(max_size=3),
    st.lists(floats, max_size=8),
    st.integers(-(2**70), 10**400),
    st.complex_numbers(),
    st.just(object()),
    st.just(np.zeros((4, 6))),
    st.just(np.full((4, 6), 1 + 1j)),
    st.just(np.array([[None] * 6] * 4, object)),
    st.just(np.array(["a"])),
    st.just(np.full((1, 7), np.nan, np.float32)),
    st.just(np.zeros((1, 6), np.float32)),
    st.just(np.zeros((2, 7), np.float32)),
    st.just(np.zeros((1, 7), bool)),
    st.just(np.zeros((4, 6, 3), np.uint8)),
    st.just(np.zeros((0, 6), np.uint8)),
    st.just(np.zeros(0)),
    st.just(np.array(0.3)),
    st.just(np.zeros(2)),
)
"""What is no image, no estimate, no age and no commands: another type, shape, or number of sensors."""


@st.composite
def measurements(draw) -> Any:
    """Anything at all, though often something that looks good."""
    image = draw(st.sampled_from([None, *(picture(k) for k in range(4)), np.zeros((4, 6), np.uint8)]))
    if draw(st.booleans()):
        answer = reading(draw(st.floats(0, 0.6)))
    elif draw(st.booleans()):
        answer = None
    elif draw(st.booleans()):
        answer = malformed(**{draw(st.sampled_from([*vars(reading(0.3))])): draw(JUNK)})
    else:
        rows = [np.array([draw(st.lists(anything, min_size=7, max_size=7))], np.float32) for _ in range(3)]
        answer = Reading(*rows, np.zeros((1, 7), np.float32), np.array([draw(anything)], np.float32))
    age = draw(st.one_of(st.just(0.0), floats))
    u = draw(st.one_of(st.none(), floats))
    found = {"image": image, "reading": answer, "age": age, "commands": None if u is None else np.array([u])}
    if draw(st.integers(0, 3)) == 0:
        found[draw(st.sampled_from([*found]))] = draw(JUNK)
    return draw(JUNK) if draw(st.integers(0, 9)) == 0 else Measurement(**found)


targets = st.one_of(st.just(TARGET), st.just(0.0), st.floats(allow_nan=False, allow_infinity=False))
