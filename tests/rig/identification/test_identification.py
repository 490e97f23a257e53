"""What pictures tell of a rig, against one whose parameters are known."""

import tomllib

import numpy as np
import pytest
from pictured_rig import COMMANDS, TRUTH, Pictured

from exosight.errors import InputError
from exosight.rig.identification.fit import Problem, fit, information
from exosight.rig.identification.measurements import Measurements
from exosight.rig.identification.misfit import filled
from exosight.rig.identification.parameters import Prior, parameters_of
from exosight.rig.identification.posterior import information_gains, posterior
from exosight.rig.identification.predicted import predicted_outline
from exosight.rig.identification.response import Model, at_rest, followed, relaxed
from exosight.rig.identification.result import Identification, identify
from exosight.system.build import build
from exosight.system.file import Values, describe
from exosight.system.units import split_quantity


@pytest.fixture(scope="module")
def found(lever: Values, pictured: Pictured) -> Identification:
    return identify(lever, pictured.measured)


def test_derivatives_are_those_of_the_solved_poses(model: Model, pictured: Pictured) -> None:
    problem = Problem(model, pictured.measured, Prior())
    x = np.linspace(-0.2, 0.2, problem.unknowns)
    numbers = problem.numbers(x)
    q, stable = followed(numbers.system, COMMANDS)
    assert stable.all()
    rows, moves = problem.linearised(x, numbers, q)
    along, step = np.cos(np.arange(problem.unknowns)), 1e-5

    def at(share: float) -> tuple[np.ndarray, np.ndarray]:
        moved = x + share * along
        there = problem.numbers(moved)
        pose, _ = relaxed(there.system, COMMANDS, q)
        return problem.linearised(moved, there, pose)[0].outline, pose

    ahead, behind = at(step), at(-step)
    # Poses are found to 1e-10 of their size, which 2e-5 enlarges to 1e-5; a point that changes its segment in
    # between has a kink.
    np.testing.assert_allclose(
        (ahead[1] - behind[1]) / (2 * step), moves @ along[: moves.shape[-1]], rtol=1e-4, atol=1e-4
    )
    wrong = np.abs((ahead[0] - behind[0]) / (2 * step) - rows.slope @ along)
    assert np.quantile(wrong, 0.99) < 1e-4 * np.abs(rows.slope @ along).max()


def test_the_true_parameters_are_found(found: Identification) -> None:
    assert found.rested
    assert not found.elsewhere
    for each in found.estimates:
        if each.entry in TRUTH:
            true = split_quantity(TRUTH[each.entry], "1 m")[0]
            # Outlines are found to some hundredths of a pixel of 1 mm, of bodies of 60: some parts in a
            # thousand of sizes, a tenth of a degree; mounts are known by a body's first pixels alone.
            place = any(word in each.entry for word in ("centre", "roll"))
            near = 0.1 if place else 0.15 * (each.low < 0)
            assert each.value == pytest.approx(true, rel=0.0 if near else 0.01, abs=near), each.entry
            assert each.low < each.value < each.high


def test_the_written_file_is_the_fitted_system(found: Identification) -> None:
    values = tomllib.loads(found.toml)
    assert values == found.values
    system = build(describe(values))
    estimate = {each.entry: each.value for each in found.estimates}
    assert float(system.robot["actuator"].young) == 1e3 * estimate["rods.actuator.young"]
    assert system.camera.metres_per_pixel == pytest.approx(1e-3 * estimate["cameras.side.pixel"], rel=1e-12)


def test_without_a_force_reading_load_and_stiffness_stay_open(lever: Values, pictured: Pictured) -> None:
    measured = pictured.measured
    alone = identify(lever, measured, known_gains=False)
    (widest, *_) = alone.open
    factors = {entry: widest.change[entry] for entry in widest.change}
    # Energies are linear in the load and all stiffnesses: one factor on all of them changes no pose.
    assert set(factors) == {"rods.actuator.young", "links.bone.joint.stiffness", "actuators.p.gain"}
    np.testing.assert_allclose(list(factors.values()), next(iter(factors.values())), rtol=1e-3)
    assert widest.share == pytest.approx(1, abs=1e-3)
    reading = np.array([np.nan, np.nan, pictured.readings[2], np.nan])
    told = identify(lever, Measurements(COMMANDS, measured.outlines, {"pad": reading}), known_gains=False)
    assert not told.open
    gain = next(each for each in told.estimates if each.entry == "actuators.p.gain")
    # The reading is exact, and counts as known to 1 %.
    assert gain.value == pytest.approx(0.05, rel=0.01)
    assert gain.high / gain.low == pytest.approx(np.exp(2 * 1.96 * 0.01), rel=0.02)


def test_a_further_picture_tells_what_its_information_adds(lever: Values, pictured: Pictured) -> None:
    model = Model(lever, parameters_of(lever, Prior()))
    problem = Problem(model, pictured.measured, Prior())
    state, _ = fit(problem)
    known = posterior(problem, state)
    command = np.array([[45.0]])
    (gain,) = information_gains(problem, known, command)
    numbers, slopes = problem.numbers(known.x), model.slopes(known.x[: len(model.parameters)])
    q, _ = relaxed(numbers.system, command, at_rest(numbers.system)[None], np.zeros((1, 1)))
    camera = model.camera(known.x[: len(model.parameters)])
    seen = filled(predicted_outline(numbers.system, q[0], camera))
    _, by_x, _, _ = problem.seen(known.x, numbers, slopes, seen, command[0], q[0])
    sigma = known.noise * np.sqrt(known.crowding)
    before, _ = information(state.rows, sigma)
    prior = np.eye(len(known.x))
    np.testing.assert_allclose(known.independent @ (before + prior), prior, atol=1e-6)
    after = before + by_x.T @ by_x / sigma**2
    rise = np.linalg.slogdet(after + prior)[1] - np.linalg.slogdet(before + prior)[1]
    assert gain == pytest.approx(rise / 2, rel=1e-6)
    assert gain > 0


def test_intervals_hold_their_share(model: Model, pictured: Pictured) -> None:
    """Linear model, many draws of noise: estimates are in their 95 % intervals 95 times of 100."""
    problem = Problem(model, pictured.measured, Prior())
    x = np.zeros(problem.unknowns)
    q, _ = followed(problem.numbers(x).system, COMMANDS)
    rows, _ = problem.linearised(x, problem.numbers(x), q)
    random, sigma, inside = np.random.default_rng(0), 0.3, []
    matrix = rows.slope.T @ rows.slope / sigma**2 + np.eye(len(x))
    covariance = np.linalg.inv(matrix)
    for _ in range(400):
        true = random.normal(size=len(x))
        seen = rows.slope @ true + random.normal(scale=sigma, size=len(rows.outline))
        estimate = covariance @ rows.slope.T @ seen / sigma**2
        inside.append(np.abs(estimate - true) < 1.96 * np.sqrt(np.diag(covariance)))
    # 400 draws of some independent directions: 1 % of standard error.
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


def test_what_cannot_be_identified_is_refused(lever: Values, pictured: Pictured) -> None:
    outlines = pictured.measured.outlines
    with pytest.raises(InputError, match="at least two"):
        identify(lever, Measurements(COMMANDS[:1], outlines[:1]))
    with pytest.raises(InputError, match="one row a picture, 4"):
        Measurements(COMMANDS[:3], outlines)
    with pytest.raises(InputError, match="two commands or more"):
        identify(lever, Measurements(0 * COMMANDS, outlines))
    with pytest.raises(InputError, match="got palm"):
        identify(lever, Measurements(COMMANDS, outlines, {"palm": np.ones(4)}))
    rough = {**lever, "contacts": {"press": {**lever["contacts"]["press"], "friction": 0.3}}}
    with pytest.raises(InputError, match="friction"):
        identify(rough, pictured.measured)
