"""Every example runs, draws its figure and ends in its number."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"

# name: (number, absolute tolerance) with the reason for both.
NUMBERS = {
    # Bisshopp and Drucker's elastica at α = 10; four quadratic elements are within 1e-6 of it.
    "01_cantilever": (0.8106090, 2e-6),
    # From a separate planar program (tests/reference/planar_paths.json), solved to 1e-10 of the pose.
    "02_exosuit_path": (0.4927185574, 1e-7),
    # 346 of 550 frames. Seven exosuits roll up; on both ways a crossing may begin a frame earlier or later.
    "03_small_dataset": (100 * 346 / 550, 100 * 14 / 550),
    # Where the loading path passes 0.25 N, found by bracketing; 30 steps of the loop come within 1e-7 N.
    "04_closed_loop": (2.71590438, 1e-6),
    # SoRoSim at 1 s (tests/reference/sorosim_dynamics.json), integrated at a tolerance of 1e-6.
    "05_released_cantilever": (0.2525563, 1e-6),
    # The textbook equations of the chain in absolute angles, by scipy's DOP853 at 1e-12.
    "06_hinged_chain": (2.8912521, 1e-6),
}


def main_of(name: str) -> Callable[[Path], float]:
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main


@pytest.mark.parametrize("name", NUMBERS)
def test_example_ends_in_its_number(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    number, tolerance = NUMBERS[name]
    assert main_of(name)(folder) == pytest.approx(number, abs=tolerance)
    figures = list(folder.glob("*.png"))
    assert figures
    for figure in figures:
        image = cv2.imread(str(figure), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        assert min(image.shape) > 400  # large enough to read
        assert (image < 128).mean() > 0.005  # and something is drawn


def test_every_example_is_pinned() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(NUMBERS)
