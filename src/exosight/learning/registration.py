"""Registration: the view of a camera that has moved, brought back to the one that a network learned from.

A camera that is moved or turned sees a planar scene through a homography (Hartley and Zisserman, Multiple
View Geometry, 2nd edition, section 8.1), and one that bends and presses in a plane nearly so. Which one it
is follows from pictures alone: seen through the right one they are like those learned from, so the OOD score
is least. Readings make it surer, as through the right one the network also answers right.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

Homography = Float[Tensor, "8"]
"""The first eight entries of H − 1, row by row, with H₃₃ = 1; it takes places in the new picture to places in
the camera's, both −1 to 1 across the picture, x to the right and y down."""

TURN, SCALE, SHIFT = 0.5, 0.35, 0.35
"""How far the search goes: turn [rad], logarithm of the scale, shift [half a picture]. The corners move
further."""

_STARTS, _KEPT = 60, 4
_STEPS, _RATE = 60, 0.02
_NEAREST = 0.2
"""Least denominator of the projection: nothing comes from behind the camera."""

Objective = Callable[[Homography], Float[Tensor, ""]]


class Registration(nn.Module):
    """Pictures as the former camera would show them; the border repeats into what it does not show."""

    grid: Tensor

    def __init__(self, homography: Homography, size: tuple[int, int]):
        super().__init__()
        self.register_buffer("grid", _grid(homography, size)[None])

    def forward(
        self, image: Float[Tensor, "batch images height width"]
    ) -> Float[Tensor, "batch images height width"]:
        """Interpolated linearly."""
        return _sampled(image, self.grid)


def registered(
    image: Float[Tensor, "batch images height width"], homography: Homography
) -> Float[Tensor, "batch images height width"]:
    """What `Registration` shows, with derivatives by the homography."""
    return _sampled(image, _grid(homography, image.shape[-2:])[None])


def find_registrations(objective: Objective, seed: int, former: Homography | None = None) -> list[Homography]:
    """Homographies at which the objective has minima, the smallest first.

    From the camera as it was and from random turns, scales and shifts; of these the best are followed down.

    former   where the search begins if the camera has been registered before
    """
    rng = np.random.default_rng(seed)
    starts = [torch.zeros(8) if former is None else former]
    for _ in range(_STARTS):
        turn, scale = rng.uniform(-TURN, TURN), math.exp(rng.uniform(-SCALE, SCALE))
        starts.append(_similarity(turn, scale, *rng.uniform(-SHIFT, SHIFT, 2)))
    return descend(objective, lowest(objective, starts, _KEPT))


def descend(objective: Objective, starts: Sequence[Homography]) -> list[Homography]:
    """Follow the objective down from each start (Adam); the smallest first."""
    ends = []
    for start in starts:
        place = start.clone().requires_grad_()
        optimiser = torch.optim.Adam([place], lr=_RATE)
        for step in range(_STEPS):
            optimiser.param_groups[0]["lr"] = _RATE * (1 - step / _STEPS)
            (place.grad,) = torch.autograd.grad(objective(place), [place])
            optimiser.step()
        ends.append(place.detach())
    return lowest(objective, ends, len(ends))


def lowest(objective: Objective, places: Sequence[Homography], count: int) -> list[Homography]:
    """Those with the smallest values, the smallest first."""
    with torch.inference_mode():
        values = [objective(place).item() for place in places]
    return [places[number].clone() for number in np.argsort(values, kind="stable")[:count]]


def _similarity(turn: float, scale: float, right: float, down: float) -> Homography:
    cos, sin = scale * math.cos(turn), scale * math.sin(turn)
    return torch.tensor([cos - 1, -sin, right, sin, cos - 1, down, 0, 0], dtype=torch.float32)


def _grid(homography: Homography, size: Sequence[int]) -> Float[Tensor, "height width 2"]:
    """Where in the camera's picture each pixel of the new one is taken from."""
    height, width = size
    matrix = torch.cat([homography, homography.new_zeros(1)]).reshape(3, 3) + torch.eye(3)
    down, right = ((2 * torch.arange(side) + 1) / side - 1 for side in (height, width))
    places = torch.stack(
        [right.expand(height, width), down[:, None].expand(height, width), torch.ones(height, width)], -1
    )
    found = places @ matrix.T
    return found[..., :2] / found[..., 2:].clamp(min=_NEAREST)


def _sampled(image: Tensor, grid: Float[Tensor, "1 height width 2"]) -> Tensor:
    return nn.functional.grid_sample(
        image, grid.expand(image.shape[0], -1, -1, -1), padding_mode="border", align_corners=False
    )
