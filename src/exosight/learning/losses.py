"""What training makes small: the error of the outputs, and of what a network learns beside them."""

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from exosight.learning.networks import Answers

SPREAD, CONTACT, AUXILIARY = 0.02, 0.1, 0.3
"""Weights beside that of the outputs, 1. Contact and auxiliary targets shape the features; the spread is to
learn from the errors without a say in them."""


def output_loss(
    values: Float[Tensor, "batch outputs"], truth: Float[Tensor, "batch outputs"], corner: float
) -> Tensor:
    """Mean of e²/2 up to |e| = corner, then of corner-matched |e|; both in units of the outputs' scale."""
    return nn.functional.smooth_l1_loss(values, truth, beta=corner)


def training_loss(
    found: Answers,
    truth: Float[Tensor, "batch outputs"],
    auxiliary: Float[Tensor, "batch auxiliary"],
    nonnegative: Bool[np.ndarray, " outputs"],
    corner: float,
) -> tuple[Tensor, Tensor]:
    """What training makes small, and the loss of the outputs alone: they differ where a network answers more.

    Spread: −log of a Laplace density, log b + |e|/b, for the errors as they are. Contact: cross entropy,
    of the outputs that are forces.

    nonnegative   which outputs are forces
    """
    values = output_loss(found.values, truth, corner)
    if found.log_spread is None or found.contact is None:
        return values, values
    error = (found.values - truth).detach().abs()
    spread = (error * torch.exp(-found.log_spread) + found.log_spread).mean()
    loss = values + SPREAD * spread
    if nonnegative.any():
        contact = nn.functional.binary_cross_entropy_with_logits(
            _columns(found.contact, nonnegative), (_columns(truth, nonnegative) > 0).to(truth.dtype)
        )
        loss = loss + CONTACT * contact
    if auxiliary.shape[1]:
        loss = loss + AUXILIARY * nn.functional.smooth_l1_loss(found.auxiliary, auxiliary)
    return loss, values


def _columns(values: Tensor, chosen: Bool[np.ndarray, " outputs"]) -> Tensor:
    return values if chosen.all() else values[:, torch.from_numpy(np.flatnonzero(chosen)).to(values.device)]
