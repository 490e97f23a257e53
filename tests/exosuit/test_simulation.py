"""One exosuit under given loads: the paper's numbers, and answers that stand on their own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.exosuit.simulation import MAX_LOAD, simulate

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "planar_paths.json").read_text())[0]
EXOSUIT = Exosuit(ExosuitShape(Linear(r0=0.01, r1=0.005), length=0.095))
LOADS = (0.0, 1.0, 2.4, 4.0, 2.437, 0.013, -0.05, -1.0, -0.333)
QUANTITIES = {
    *("u", "converged", "residual", "min_eigenvalue", "iterations", "forces", "F_net"),
    *("joint_angles", "rod_tip", "finger_tip"),
}


@pytest.fixture(scope="module")
def records() -> dict[float, dict]:
    """The answer for each of LOADS, all asked for at once."""
    return {record["u"]: record for record in simulate(EXOSUIT, LOADS).records()}


def test_net_forces_are_the_published_systems(records: dict[float, dict]) -> None:
    """Within the 2 % that the choice of contact stiffness leaves open."""
    for load, force in ((1.0, 0.058), (2.4, 0.22), (4.0, 0.49)):
        assert records[load]["F_net"] == pytest.approx(force, rel=0.02)


def test_poses_match_a_separate_planar_program() -> None:
    """On the first smooth stretch, where both programs are converged to 1e-10 and follow the same branch."""
    path = {point["u"]: point for point in REFERENCE["path"]}
    for record in simulate(EXOSUIT, [0.2, 0.6, 1.0, 2.4]).records():
        point = path[record["u"]]
        np.testing.assert_allclose(record["forces"], point["forces"], rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose(record["F_net"], point["net_force"], rtol=1e-5)
        np.testing.assert_allclose(record["joint_angles"], point["joint_angles"], rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose(record["rod_tip"], point["tip"], rtol=1e-5, atol=1e-8)


def test_every_answer_is_a_stable_equilibrium(records: dict[float, dict]) -> None:
    for record in records.values():
        assert record["converged"]
        assert record["residual"] < 1e-10
        assert record["min_eigenvalue"] > 0
        assert record["iterations"] >= 1


def test_net_force_leaves_out_c0(records: dict[float, dict]) -> None:
    for record in records.values():
        assert record["F_net"] == pytest.approx(sum(record["forces"][1:]), rel=1e-12)


@pytest.mark.parametrize(
    "loads",
    [(2.437,), (-0.333,), (4.0, 2.4, 1.0, 0.0), (-1.0, 2.437, -0.05), (0.013, 0.013), (5.9, 2.437, 2.4)],
)
def test_an_answer_does_not_depend_on_the_other_loads(
    records: dict[float, dict], loads: tuple[float, ...]
) -> None:
    """Alone, unsorted, repeated, between grid points, negative, beside larger loads.

    Poses to 1e-9, ten times the solver's tolerance; that of 0.1 m is 1e-7 N at the contacts' 1000 N/m.
    """
    answers = simulate(EXOSUIT, loads).records()
    assert [answer["u"] for answer in answers] == list(loads)
    for answer in answers:
        expected = records.get(answer["u"], answer)
        assert answer["converged"] == expected["converged"]
        for name in ("forces", "F_net", "joint_angles", "rod_tip", "finger_tip", "min_eigenvalue"):
            np.testing.assert_allclose(answer[name], expected[name], rtol=1e-7, atol=1e-7)


def test_loads_between_steps_lie_between_their_neighbours(records: dict[float, dict]) -> None:
    """On a smooth stretch the force grows with the load."""
    low, high = (record["F_net"] for record in simulate(EXOSUIT, [2.4, 2.45]).records())
    assert low < records[2.437]["F_net"] < high


def test_pulling_lifts_the_exosuit_off_the_finger(records: dict[float, dict]) -> None:
    rest = records[0.0]
    for load in (-0.05, -0.333, -1.0):
        record = records[load]
        assert record["rod_tip"][1] > rest["rod_tip"][1]
        assert record["rod_tip"][2] > 0
        assert max(record["forces"]) == 0
        # Nothing touches the finger, which then rests where its springs do.
        np.testing.assert_allclose(record["joint_angles"], 0, atol=1e-9)


def test_records_are_plain_json(records: dict[float, dict]) -> None:
    for record in records.values():
        assert set(record) == QUANTITIES
        assert json.loads(json.dumps(record, allow_nan=False)) == record
        lengths = {name: len(record[name]) for name in ("forces", "joint_angles", "rod_tip", "finger_tip")}
        assert lengths == {"forces": 8, "joint_angles": 3, "rod_tip": 3, "finger_tip": 2}


@pytest.mark.parametrize("loads", [[float("nan")], [float("inf")], [1.0, -1.01 * MAX_LOAD]])
def test_loads_that_no_exosuit_bears_are_refused(loads: list[float]) -> None:
    with pytest.raises(InputError, match=r"u: expected finite loads within ±50 N, got (nan|inf|-50\.5)"):
        simulate(EXOSUIT, loads)


def test_tip_angle_counts_through_full_turns() -> None:
    """Bending about y is the only rotation, so the tip's angle is −∫κ ds, the integral of nodal parabolas."""
    found = simulate(EXOSUIT, [1.0, 4.0])
    simpson = np.array([1, 4, 2, 4, 2, 4, 2, 4, 2, 4, 1]) / 30
    # The steps between the 42 points do not end at the elements' ends, where the parabolas have kinks.
    np.testing.assert_allclose(found.tip_angle, -found.equilibria.q[:, :11] @ simpson, rtol=1e-3)
    assert simulate(Exosuit(), [4.0]).tip_angle[0] < -np.pi


def test_no_load_at_all_is_refused() -> None:
    with pytest.raises(InputError, match="at least one load"):
        simulate(EXOSUIT, [])


def test_the_answer_for_a_load_is_its_own() -> None:
    """Alone, or with others before, after and below zero: within ten times what a pose is solved to."""
    alone = simulate(EXOSUIT, [2.4]).equilibria.q[0]
    among = simulate(EXOSUIT, [3.0, -1.0, 2.4, 0.7]).equilibria.q[2]
    np.testing.assert_allclose(among, alone, rtol=1e-9, atol=1e-9)


def test_code_compiled_as_users_compile_it_finds_the_same_forces(records: dict[float, dict]) -> None:
    """The tests' code is made by another generator, and not optimised (`tests/conftest.py`).

    With both, poses are solved to 1e-10; 1e-11 m of 0.1 m are 1e-8 N at 1000 N/m.
    """
    code = f"""
import json
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.exosuit.simulation import simulate
exosuit = Exosuit(ExosuitShape(Linear(r0=0.01, r1=0.005), length=0.095))
print(json.dumps([record["forces"] for record in simulate(exosuit, {LOADS}).records()]))
"""
    own = ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR")
    environment = {name: value for name, value in os.environ.items() if name not in own}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    expected = np.array([record["forces"] for record in records.values()])
    np.testing.assert_allclose(json.loads(done.stdout), expected, rtol=0, atol=1e-8 * expected.max())
