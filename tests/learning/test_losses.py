"""The loss by closed forms of its parts, and what of it the curves show."""

import math

import pytest
import torch

from exosight.learning.losses import AUXILIARY, CONTACT, SPREAD, force_loss, training_loss
from exosight.learning.networks import Answers

TRUTH = torch.full((3, 7), 2.0)
NOTHING = torch.zeros(3, 0)


def test_force_loss_is_quadratic_up_to_its_corner_and_linear_beyond() -> None:
    for error, expected in ((0.0, 0.0), (0.1, 0.1**2 / (2 * 0.2)), (-1.2, 1.2 - 0.2 / 2)):
        assert force_loss(TRUTH + error, TRUTH, 0.2).item() == pytest.approx(expected, rel=1e-5)  # float32


@pytest.mark.parametrize("error", [1e-3, 0.5])
def test_further_answers_add_their_shares_and_are_told_apart(error: float) -> None:
    """A spread b = |e| costs 1 + log |e|, less than nothing for small errors; undecided contact log 2."""
    spread, even = torch.full((3, 7), math.log(error)), torch.zeros(3, 7)
    beside = torch.full((3, 5), 0.5)
    found = Answers(TRUTH + error, spread, even, beside)
    loss, forces = training_loss(found, TRUTH, torch.zeros(3, 5), 0.1)
    alone = force_loss(TRUTH + error, TRUTH, 0.1).item()
    assert forces.item() == alone
    shares = SPREAD * (1 + math.log(error)) + CONTACT * math.log(2) + AUXILIARY * 0.5**2 / 2
    assert loss.item() == pytest.approx(alone + shares, abs=1e-5)  # 2 + 1e-3 in float32: 1 + 1e-4 of it


def test_a_network_of_forces_alone_has_one_loss() -> None:
    loss, forces = training_loss(Answers(TRUTH + 1, None, None, NOTHING), TRUTH, NOTHING, 0.1)
    assert loss.item() == forces.item() == force_loss(TRUTH + 1, TRUTH, 0.1).item()
