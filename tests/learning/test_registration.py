"""A camera that has moved, and the view that it is brought back to."""

import numpy as np
import pytest
import torch

from exosight.learning.registration import (
    SCALE,
    SHIFT,
    TURN,
    Homography,
    Registration,
    descend,
    find_registrations,
    registered,
)


def pictures(count: int, rows: int = 48, columns: int = 64) -> torch.Tensor:
    """Smooth ones, each with an L of blobs, which no turn brings onto itself."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:rows, :columns]
    found = np.zeros((count, 1, rows, columns), np.float32)
    for picture in found:
        for across, down in ((0.4, 0.4), (0.6, 0.4), (0.4, 0.7)):
            place = np.array([across, down]) + rng.uniform(-0.03, 0.03, 2)
            far = ((x / columns - place[0]) * columns) ** 2 + ((y / rows - place[1]) * rows) ** 2
            picture += np.exp(-far / 40)
    return torch.from_numpy(found)


def homography(matrix: np.ndarray) -> Homography:
    """The eight numbers of a 3×3 matrix."""
    return torch.tensor((matrix / matrix[2, 2] - np.eye(3)).reshape(-1)[:8], dtype=torch.float32)


TILTED = np.array([[0.95, -0.1, 0.06], [0.12, 1.02, -0.05], [0.04, -0.03, 1.0]])


def test_no_homography_leaves_pictures_as_they_are() -> None:
    seen = pictures(2)
    # Interpolation at the pixels' centres, which float32 finds to 1e-5 of a pixel.
    torch.testing.assert_close(registered(seen, torch.zeros(8)), seen, atol=1e-5, rtol=0)


def test_a_shift_by_whole_pixels_is_exact_and_repeats_the_border() -> None:
    seen = pictures(1)
    moved = registered(seen, torch.tensor([0, 0, 2 * 3 / 64, 0, 0, 2 * 2 / 48, 0, 0], dtype=torch.float32))
    torch.testing.assert_close(moved[..., :-2, :-3], seen[..., 2:, 3:], atol=1e-5, rtol=0)
    torch.testing.assert_close(moved[..., -1, -1], seen[..., -1, -1], atol=1e-5, rtol=0)


def test_one_homography_after_another_is_their_product() -> None:
    seen = pictures(2)
    there = registered(seen, homography(TILTED))
    back = registered(there, homography(np.linalg.inv(TILTED)))
    # Linear interpolation is off by f''/8 a direction, f'' = 2/40 a pixel² at most; twice, and in two
    # directions.
    assert (back - seen)[..., 8:-8, 8:-8].abs().max() < 2 * 2 / 8 * 2 / 40 + 1e-3


def test_the_layer_shows_what_the_function_does() -> None:
    seen = pictures(2)
    torch.testing.assert_close(
        Registration(homography(TILTED), (48, 64))(seen), registered(seen, homography(TILTED))
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_move_within_the_range_of_the_search_is_found(seed: int) -> None:
    """Of pictures seen through a random similarity with perspective, beside the former ones."""
    rng = np.random.default_rng(seed)
    turn, scale = rng.uniform(-0.7, 0.7) * TURN, np.exp(rng.uniform(-0.7, 0.7) * SCALE)
    cos, sin = scale * np.cos(turn), scale * np.sin(turn)
    shift = rng.uniform(-0.7, 0.7, 2) * SHIFT
    moved = np.array([[cos, -sin, shift[0]], [sin, cos, shift[1]], [*rng.uniform(-0.03, 0.03, 2), 1]])
    seen = pictures(4)
    now = registered(seen, homography(moved))
    best, *others = find_registrations(lambda place: ((registered(now, place) - seen) ** 2).mean(), seed)
    error = ((registered(now, best) - seen) ** 2).mean()
    # What leaves the picture does not come back.
    assert error < 0.05 * ((now - seen) ** 2).mean()
    assert all(error <= ((registered(now, place) - seen) ** 2).mean() for place in others)


def test_descent_ends_no_higher_than_it_began() -> None:
    seen = pictures(2)
    now = registered(seen, homography(TILTED))

    def objective(place: Homography) -> torch.Tensor:
        return ((registered(now, place) - seen) ** 2).mean()

    (end,) = descend(objective, [torch.zeros(8)])
    assert objective(end) < 0.1 * objective(torch.zeros(8))
