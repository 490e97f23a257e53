"""The loss by closed forms of its parts, and what of it the curves show."""

import math

import numpy as np
import pytest
import torch

from exosight.learning.losses import AUXILIARY, CONTACT, SPREAD, output_loss, training_loss
from exosight.learning.networks import Answers

TRUTH = torch.full((3, 7), 2.0)
NOTHING = torch.zeros(3, 0)
FORCES = np.ones(7, dtype=bool)


def test_output_loss_is_quadratic_up_to_its_corner_and_linear_beyond() -> None:
    for error, expected in ((0.0, 0.0), (0.1, 0.1**2 / (2 * 0.2)), (-1.2, 1.2 - 0.2 / 2)):
        assert output_loss(TRUTH + error, TRUTH, 0.2).item() == pytest.approx(expected, rel=1e-5)  # float32


@pytest.mark.parametrize("error", [1e-3, 0.5])
def test_further_answers_add_their_shares_and_are_told_apart(error: float) -> None:
    """A spread b = |e| costs 1 + log |e|, less than nothing for small errors; undecided contact log 2."""
    spread, even = torch.full((3, 7), math.log(error)), torch.zeros(3, 7)
    beside = torch.full((3, 5), 0.5)
    found = Answers(TRUTH + error, spread, even, beside)
    loss, forces = training_loss(found, TRUTH, torch.zeros(3, 5), FORCES, 0.1)
    alone = output_loss(TRUTH + error, TRUTH, 0.1).item()
    assert forces.item() == alone
    shares = SPREAD * (1 + math.log(error)) + CONTACT * math.log(2) + AUXILIARY * 0.5**2 / 2
    assert loss.item() == pytest.approx(alone + shares, abs=1e-5)  # 2 + 1e-3 in float32: 1 + 1e-4 of it


def test_a_network_of_forces_alone_has_one_loss() -> None:
    loss, forces = training_loss(Answers(TRUTH + 1, None, None, NOTHING), TRUTH, NOTHING, FORCES, 0.1)
    assert loss.item() == forces.item() == output_loss(TRUTH + 1, TRUTH, 0.1).item()


def test_contact_is_learned_of_forces_alone() -> None:
    """An angle's log odds change nothing, however wrong; without any force there is no such loss."""
    truth, even = TRUTH.clone(), torch.zeros(3, 7)
    truth[:, 0] = -1.0
    odd = even.clone()
    odd[:, 0] = 50.0
    angle_first = np.array([False, *[True] * 6])
    first, second = (
        training_loss(Answers(truth, even, contact, NOTHING), truth, NOTHING, angle_first, 0.1)[0]
        for contact in (even, odd)
    )
    assert first.item() == second.item()
    none, _ = training_loss(Answers(truth, even, odd, NOTHING), truth, NOTHING, np.zeros(7, dtype=bool), 0.1)
    assert none.item() == 0.0
