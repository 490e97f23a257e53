"""What training makes small: the error of the forces, and of what a network learns beside them."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from exosight.learning.networks import Answers

SPREAD, CONTACT, AUXILIARY = 0.02, 0.1, 0.3
"""Weights beside that of the forces, 1. Contact and auxiliary targets shape what the network looks at; the
spread is to learn from the errors without a say in them."""


def force_loss(forces: Float[Tensor, "batch 7"], truth: Float[Tensor, "batch 7"], corner: float) -> Tensor:
    """Mean of e²/2 up to |e| = corner, then of corner-matched |e|; both in units of the forces' scale."""
    return nn.functional.smooth_l1_loss(forces, truth, beta=corner)


def training_loss(
    found: Answers,
    truth: Float[Tensor, "batch 7"],
    auxiliary: Float[Tensor, "batch auxiliary"],
    corner: float,
) -> tuple[Tensor, Tensor]:
    """What training makes small, and the force loss alone: they differ where the network answers more.

    Spread: −log of a Laplace density, log b + |e|/b, for the errors as they are. Contact: cross entropy.
    """
    forces = force_loss(found.forces, truth, corner)
    if found.log_spread is None or found.contact is None:
        return forces, forces
    error = (found.forces - truth).detach().abs()
    spread = (error * torch.exp(-found.log_spread) + found.log_spread).mean()
    contact = nn.functional.binary_cross_entropy_with_logits(found.contact, (truth > 0).to(truth.dtype))
    loss = forces + SPREAD * spread + CONTACT * contact
    if auxiliary.shape[1]:
        loss = loss + AUXILIARY * nn.functional.smooth_l1_loss(found.auxiliary, auxiliary)
    return loss, forces
