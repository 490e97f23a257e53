"""docs/validation.md shows the numbers of docs/results, and these are what the page says of them."""

from itertools import pairwise
from typing import Any

import figures_validation as figures
import numpy as np
import pytest


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    return figures.load()


def test_its_pictures_can_be_drawn_and_are_there(found: dict[str, Any]) -> None:
    assert len(figures.convergence(found["convergence"]).axes) == 4
    assert len(figures.neighbours(found["neighbours"]["rows"]).axes) == 6
    for name in ("convergence", "neighbours"):
        assert (figures.IMAGES / f"validation_{name}.png").stat().st_size > 10_000


def test_magnus_steps_are_of_fourth_order(found: dict[str, Any]) -> None:
    for line in found["convergence"]["steps"].values():
        order = -np.log(line["error"][-1] / line["error"][-3]) / np.log(line["steps"][-1] / line["steps"][-3])
        assert order == pytest.approx(4, abs=0.15)  # the limit of small steps, nearly


def test_newton_ends_quadratically(found: dict[str, Any]) -> None:
    for line in found["convergence"]["newton"].values():
        pairs = [(a, b) for a, b in pairwise(line) if 1e-6 < a < 0.03]
        assert len(pairs) >= 2
        assert all(after < 3 * before**2 for before, after in pairs)


def test_the_median_is_at_most_five_iterations(found: dict[str, Any]) -> None:
    path = found["convergence"]["iterations"]
    assert path["median"] <= 5
    assert path["converged"] >= 0.999
    assert sum(path["counts"]) == path["shapes"] * path["loads"]


def test_sorosim_is_met_within_what_its_tests_allow(found: dict[str, Any]) -> None:
    assert {row["test"].split("[")[0] for row in found["sorosim"]} >= {
        "test_cantilever",
        "test_tapered_rod_with_a_line",
        "test_spatial_cantilever",
        "test_hinged_chain",
        "test_contact",
        "test_released_cantilever_of_sorosim",
    }
    assert all(row["difference"] <= row["tolerance"] * 1.001 for row in found["sorosim"])


def test_what_the_page_concludes_is_what_was_timed(found: dict[str, Any]) -> None:
    """At rest exosight is nearer and faster; in motion SoRoMoX is nearer, exosight faster to three digits."""
    rows = found["neighbours"]["rows"]

    def of(problem: str, program: str) -> np.ndarray:
        own = [r for r in rows if (r["problem"], r["program"]) == (problem, program)]
        return np.array([(r["error"], r["seconds"]) for r in own])

    for problem in ("cantilever", "contact"):
        ours, theirs = of(problem, "exosight"), of(problem, "PyElastica")
        best = ours[1]
        assert np.all(best < theirs.min(axis=0))
    for problem in ("motion in a plane", "motion in space", "motion in space, slender"):
        ours, theirs = of(problem, "exosight"), of(problem, "SoRoMoX")
        assert theirs[:, 0].max() < ours[:, 0].min()
        assert ours[ours[:, 0] < 3e-3, 1].min() < theirs[:, 1].min()
    assert ours[:, 1].max() < theirs[:, 1].min()  # the slender rod, at any tolerance


def test_what_the_page_concludes_of_rigid_bodies_is_what_was_timed(found: dict[str, Any]) -> None:
    """MuJoCo is faster everywhere; with stiff friction nearer, and as it comes mostly further off."""
    rows = found["rigid"]["rows"]

    def of(problem: str, program: str) -> dict[str, tuple[float, float]]:
        own = [r for r in rows if (r["problem"], r["program"]) == (problem, program)]
        return {r["setting"]: (r["error"], r["seconds"]) for r in own}

    for problem in ("stick", "slide", "stack", "finger"):
        ours, theirs = of(problem, "exosight"), of(problem, "MuJoCo")
        assert max(time for _, time in theirs.values()) < min(time for _, time in ours.values())
        nearest = min(error for error, _ in ours.values())
        assert nearest < theirs["as it comes"][0]
        if problem == "finger":
            assert nearest < theirs["solref 2 ms"][0]
        else:
            assert theirs["solref 2 ms, impratio 100"][0] < nearest


def test_what_the_page_concludes_of_rods_in_contact_is_what_was_measured(found: dict[str, Any]) -> None:
    """PyElastica's friction needs speed, and its rods press on themselves several times as hard as K."""
    rows = found["belt"]["rows"]

    def of(problem: str, program: str) -> dict[str, float]:
        own = [r for r in rows if (r["problem"], r["program"]) == (problem, program)]
        return {r["setting"]: r["error"] for r in own}

    ours, theirs = of("belt", "exosight"), of("belt", "PyElastica")
    assert max(ours.values()) < min(theirs.values())
    slow = next(error for setting, error in theirs.items() if "mm/s" in setting)
    assert slow > 0.2
    assert theirs["104 elements, 1e+06 N/m²"] < 0.6 * theirs["52 elements, 1e+06 N/m²"] < 0.1
    assert (
        max(error for setting, error in of("strands", "exosight").items() if setting != "5 elements") < 0.0025
    )
    assert min(of("strands", "PyElastica").values()) > 1.9
    coarse, fine = of("twist", "PyElastica").values()
    assert max(of("twist", "exosight").values()) < 0.006
    assert fine < 0.3 * coarse < 0.01


def test_the_balance_of_energy_closes_with_the_square_of_the_step(found: dict[str, Any]) -> None:
    """A quarter of the order's factor is left to how many points begin to touch and to slip where.

    The finest steps of friction gain less.
    """
    kinds = found["balance"]["kinds"]
    coarse, *_, fine, finest = kinds["friction"]
    square = (coarse["step [N]"] / fine["step [N]"]) ** 2
    calm, snapping = "largest difference there, relative", "largest difference on paths with snaps, relative"
    assert fine[calm] < min(1e-6, 4 * coarse[calm] / square)
    assert np.median(fine["difference of each path, relative"]) < 1e-7
    assert max(lines[-1][each] for lines in kinds.values() for each in (calm, snapping)) < 1e-6
    assert finest[calm] < fine[calm]
    for line in [line for lines in kinds.values() for line in lines]:
        assert line["least lost in a step [mJ]"] > -1e-12  # round-off of millijoules
