"""What a network is shown beside an image in the loop: the same as along a path of its dataset."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from cards import made_up
from toy import SCHEMA

from exosight.control import OnnxEstimator, from_image
from exosight.control.frame_history import FrameHistory
from exosight.errors import InputError
from exosight.learning.model_inputs import HISTORY_SPACING
from exosight.learning.training_data import stacks

CARD = made_up(4, 6, schema=SCHEMA, data={HISTORY_SPACING: 0.16}, history=2, actuation=True)


def picture(gray: float) -> np.ndarray:
    return np.full((4, 6), gray, np.uint8)


def grays(history: FrameHistory, steps: list[tuple[float, int]]) -> list[list[int]]:
    """The history, newest first, that is shown beside pictures of these grays under these u [N]."""
    found = []
    for u, gray in steps:
        inputs = history.inputs(picture(gray), np.array([u]))
        assert inputs.history is not None
        assert inputs.history.shape == (1, 2, 4, 6)
        assert inputs.commands is not None
        assert inputs.commands[0] == pytest.approx([u])
        found.append(inputs.history[0, :, 0, 0].tolist())
    return found


def test_along_a_path_it_shows_what_the_dataset_does() -> None:
    rising = np.arange(5) * 0.16
    u = np.concatenate([rising, rising[-2::-1]])
    steps = list(zip(u.tolist(), range(len(u)), strict=True))
    # The frame before each; at u = 0, where it is at rest, its own.
    expected = stacks(np.array([0, 0, 1, 2, 3, 4, 5, 6, 8]), 2, 9)[:, 1:].tolist()
    history = FrameHistory(CARD)
    assert grays(history, steps) == expected
    assert grays(history, steps) == expected  # at u = 0 it forgets the way before


def test_resting_does_not_change_the_past_and_short_steps_are_not_remembered() -> None:
    steps = [(0.0, 1), (0.2, 2), (0.4, 3), (0.4, 4), (0.4, 5), (0.45, 6), (0.62, 7)]
    expected = [[1, 1], [1, 1], [2, 1], [2, 1], [2, 1], [2, 1], [3, 2]]
    assert grays(FrameHistory(CARD), steps) == expected


def test_a_network_of_one_image_is_shown_nothing_beside() -> None:
    inputs = FrameHistory(replace(CARD, history=0, actuation=False, data={})).inputs(
        picture(1), np.array([0.3])
    )
    assert (inputs.history, inputs.commands) == (None, None)


def test_a_model_that_does_not_tell_how_far_apart_is_refused() -> None:
    with pytest.raises(InputError, match=f"how far its history images lie apart .{HISTORY_SPACING}."):
        FrameHistory(replace(CARD, data={}))


@dataclass
class Session:
    """Answers C1 = the newest gray, C2 = the sum of the earlier ones, C3 = u."""

    given: list[dict[str, np.ndarray]] = field(default_factory=list)

    def run(self, _: list[str], given: dict[str, np.ndarray]) -> list[Any]:
        self.given.append(given)
        forces = np.zeros((len(given["commands"]), 7), np.float32)
        gray = 255 * given["image"][:, :, 0, 0]
        forces[:, 0], forces[:, 1], forces[:, 2] = (
            gray[:, 0],
            gray[:, 1:].sum(axis=1),
            given["commands"][:, 0],
        )
        return [forces, np.ones_like(forces), np.ones_like(forces), np.zeros(len(forces), np.float32)]


def test_the_loop_shows_a_network_all_that_it_asks_for(toy) -> None:
    plant, session = toy(0.1), Session()
    measure = from_image(OnnxEstimator(session, CARD), SCHEMA)
    # Grays are 10 u: 0, 5, 10.
    found = [measure(plant.look(u)) for u in (0.0, 0.5, 1.0)]
    # Single precision of grays in [0, 1].
    assert found == pytest.approx([0, 5 + 0 + 0.5, 10 + 5 + 0 + 1.0], abs=1e-4)
    assert [given["image"].shape for given in session.given] == [(1, 3, 4, 6)] * 3
