import pytest
import torch

from exosight.learning.config import TrainConfig, resolve
from exosight.learning.history import EpochRecord
from exosight.learning.recipes import RECIPES


def after(losses: list[float | None], first_epoch: int = 1) -> list[EpochRecord]:
    """A history with these validation losses, one an epoch."""
    return [EpochRecord(first_epoch + i, i, 1.0, 1.0, loss, loss, 0.0) for i, loss in enumerate(losses)]


def every_fifth(losses: list[float]) -> list[EpochRecord]:
    """A history with these validation losses, one every five epochs."""
    return after([cell for loss in losses for cell in (None, None, None, None, loss)])


@pytest.mark.parametrize("steps", [10, 97, 1000])
def test_one_cycle_agrees_with_pytorch(steps: int):
    optimizer = torch.optim.SGD([torch.zeros(1, requires_grad=True)], lr=1.0)
    scheduler = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, max_lr=3e-3, total_steps=steps, pct_start=0.3, cycle_momentum=False
    )
    theirs, ours = [], []
    for step in range(steps):
        theirs.append(optimizer.param_groups[0]["lr"])
        ours.append(RECIPES["modern"].schedule.rate(3e-3, step, steps, ()))
        optimizer.step()
        scheduler.step() if step + 1 < steps else None
    # Both evaluate the same cosine in double precision.
    assert ours == pytest.approx(theirs, rel=1e-9)


@pytest.mark.parametrize("steps", [1, 2, 3, 4, 5])
def test_one_cycle_is_defined_for_the_shortest_runs(steps: int):
    rates = [RECIPES["modern"].schedule.rate(1.0, step, steps, ()) for step in range(steps)]
    assert all(0 < rate <= 1 for rate in rates)


def test_modern_recipe_never_stops_early():
    assert not RECIPES["modern"].schedule.should_stop(after([1.0] * 50))


@pytest.mark.parametrize(
    ("losses", "cuts", "stalled"),
    [
        ([], 0, False),
        ([1.0], 0, False),
        ([1.0, 0.9, 0.8, 0.7, 0.6, 0.5], 0, False),
        # 5 epochs without improvement are no plateau, 10 are.
        ([1.0, 1.0], 0, False),
        ([1.0, 1.0, 1.0], 1, False),
        # A second plateau is counted from the first cut.
        ([1.0, 1.0, 1.0, 1.0], 1, False),
        ([1.0, 1.0, 1.0, 1.0, 1.0], 2, False),
        # Five validations in a row without improvement end the run; equal is no improvement.
        ([1.0, 1.0, 1.0, 1.0, 1.0, 1.0], 2, True),
        ([1.0, 2.0, 3.0, 1.5, 1.1, 1.0], 2, True),
        # Anything lower starts both counts again, but never raises the rate.
        ([1.0, 1.0, 1.0, 0.9, 1.0, 1.0], 2, False),
        ([1.0, 1.0, 1.0, 1.0, 0.9, 1.0, 1.0, 1.0, 1.0], 3, False),
        ([1.0, 1.0, 1.0, 1.0, 0.9, 1.0, 1.0, 1.0, 1.0, 1.0], 3, True),
    ],
)
def test_paper_recipe_on_scripted_losses(losses: list[float], cuts: int, stalled: bool):
    recipe, history = RECIPES["paper"], every_fifth(losses)
    assert recipe.schedule.rate(2e-4, 0, 1, history) == pytest.approx(2e-4 * 0.1**cuts)
    assert recipe.schedule.should_stop(history) is stalled


def test_paper_recipe_is_the_printed_one():
    recipe = RECIPES["paper"]
    assert (recipe.learning_rate, recipe.weight_decay, recipe.validate_every) == (2e-4, 0.0, 5)
    assert (recipe.scales_outputs, recipe.smooth_l1_beta, recipe.augments) == (False, 0.0, False)


def test_adamw_without_decay_is_adam():
    """The paper's optimiser is Adam; training uses AdamW for both recipes."""
    weights = [torch.linspace(-1, 1, 9, requires_grad=True) for _ in range(2)]
    adam = torch.optim.Adam([weights[0]], lr=0.1)
    adamw = torch.optim.AdamW([weights[1]], lr=0.1, weight_decay=0)
    for weight, optimizer in ((weights[0], adam), (weights[1], adamw)):
        for _ in range(20):
            optimizer.zero_grad()
            (weight**4 - weight).sum().backward()
            optimizer.step()
    assert torch.equal(weights[0], weights[1])


def test_a_step_has_fewer_large_images() -> None:
    batches = [
        resolve(TrainConfig(), "cpu", "float32", pixels=side**2).batch for side in (64, 128, 256, 512, 1024)
    ]
    assert batches == [128, 128, 128, 32, 8]
    assert resolve(TrainConfig(batch=64), "cpu", "float32", pixels=1024**2).batch == 64
