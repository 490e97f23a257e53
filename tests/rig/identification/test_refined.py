"""Forces on one picture by a model that is known within intervals, against rigs drawn from these."""

from dataclasses import replace

import numpy as np
import pytest
from pictured_rig import UNCERTAIN, Pictured, scaled, vary

from exosight.errors import InputError
from exosight.rig.identification.outlines import Outline, outline_of_picture
from exosight.rig.identification.refined import ONE_PICTURE, Refined, Refiner
from exosight.system.build import build
from exosight.system.file import Values, describe, replaced
from exosight.system.simulation import simulate_path
from exosight.system.system import System
from exosight.vision.scene import picture

NOISE = 0.3
"""Of an outline point, in each direction [pixels]."""
COMMAND = np.array([30.0])


@pytest.fixture(scope="module")
def known(lever: Values) -> Values:
    """The lever as an identification leaves it."""
    return {**lever, "vary": vary()}


@pytest.fixture(scope="module")
def refiner(known: Values) -> Refiner:
    return Refiner(known)


def _seen(system: System, command: np.ndarray, random: np.random.Generator) -> tuple[Outline, float]:
    """The outline with noise, and the true reading of its one sensor."""
    states = simulate_path(system, command[None])
    axes = {name: np.asarray(axis) for name, axis in states.observation.axes.items()}
    found = outline_of_picture(picture(system, axes)[0], [tube.shade for tube in system.tubes])
    noise = random.normal(scale=NOISE, size=found.points.shape)
    return replace(found, points=found.points + noise), float(states.observation.readings[0, 0])


def test_forces_are_within_what_their_deviations_say(known: Values, refiner: Refiner) -> None:
    random, squares, errors, nominal = np.random.default_rng(0), [], [], []
    _, middle = _seen(refiner.system, COMMAND, random)
    for _ in range(12):
        truth = {entry: scaled(entry, random.normal()) for entry in UNCERTAIN}
        load = COMMAND * np.exp(ONE_PICTURE.gain * random.normal())
        outline, true = _seen(build(describe(replaced(known, truth))), load, random)
        found = refiner.refine(outline, COMMAND)
        assert found.rested
        # Noise in both directions counts once, along the normal; outlines are found to 0.1 pixel beside it.
        assert found.misfit == pytest.approx(NOISE, abs=0.1)
        squares.append(((found.readings[0] - true) / found.deviations[0]) ** 2)
        errors.append(found.readings[0] - true)
        nominal.append(middle - true)
    # Mean of 12 squares of normal deviates: within 0.25 to 2.4 in 998 of 1000 draws.
    assert 0.25 < np.mean(squares) < 2.4
    # The outline tells more than the load and the file alone.
    assert np.square(errors).mean() < 0.5 * np.square(nominal).mean()


def test_a_wrong_load_is_corrected_as_far_as_the_outline_tells(known: Values) -> None:
    """With bodies known exactly, deviations grow with the load's, and so does what the outline corrects."""
    random = np.random.default_rng(1)
    exact = {**known, "vary": vary(1e-6)}
    outline, true = _seen(build(describe(exact)), COMMAND, random)
    said = 1.05 * COMMAND
    sure, unsure = (
        Refiner(exact, replace(ONE_PICTURE, gain=gain)).refine(outline, said) for gain in (1e-4, 0.1)
    )
    assert sure.command == pytest.approx(said, rel=1e-3)
    assert unsure.command == pytest.approx(COMMAND, rel=0.01)  # five times nearer than what was said
    assert abs(unsure.readings[0] - true) < 4 * unsure.deviations[0]
    assert unsure.deviations[0] > sure.deviations[0]


def test_the_pose_before_is_one_to_start_from(refiner: Refiner) -> None:
    outline, _ = _seen(refiner.system, COMMAND, np.random.default_rng(2))
    first = refiner.refine(outline, COMMAND)
    again: Refined = refiner.refine(outline, COMMAND, first)
    # One branch: whichever way it is reached, the search ends where little is left to gain.
    np.testing.assert_allclose(again.readings, first.readings, atol=0.1 * first.deviations[0])


def test_commands_in_newtons_may_be_in_error_too(known: Values, refiner: Refiner) -> None:
    """A gain of 0.05 N/kPa makes 30 kPa and 1.5 N the same load."""
    newtons = {
        **known,
        "actuators": {
            "p": {"type": "pressure_line", "body": "actuator", "range": ["0 mN", "3000 mN"], "drive": "2 mN"}
        },
    }
    outline, _ = _seen(refiner.system, COMMAND, np.random.default_rng(3))
    one, other = refiner.refine(outline, COMMAND), Refiner(newtons).refine(outline, 0.05 * COMMAND)
    np.testing.assert_allclose(other.readings, one.readings, rtol=1e-6)
    np.testing.assert_allclose(other.deviations, one.deviations, rtol=1e-5)
    np.testing.assert_allclose(other.command, 0.05 * one.command, rtol=1e-6)


def test_what_does_not_fit_is_refused(known: Values, refiner: Refiner, pictured: Pictured) -> None:
    (outline, *_) = pictured.measured.outlines
    with pytest.raises(InputError, match="expected 0 to 60 kPa, got 70"):
        refiner.refine(outline, np.array([70.0]))
    other = [{"entry": "links.bone.length", "low": "4 cm", "high": "6 cm"}]
    with pytest.raises(InputError, match=r"expected its ends in mm.*got 4 cm"):
        Refiner({**known, "vary": other})
