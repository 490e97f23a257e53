"""Exosuits and fingers that differ: what each switch changes, and what it leaves alone."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from exosight.errors import InputError
from exosight.exosuit.assembly import ROD, Exosuit, assemble, varied
from exosight.exosuit.finger import Finger
from exosight.exosuit.simulation import simulate
from exosight.exosuit.variation import NOMINAL, PlantVariation, Variant, draw_variant

EVERYTHING = PlantVariation(
    link_length=(0.8, 1.2),
    finger_radius=(0.85, 1.15),
    joint_stiffness=(0.5, 2.0),
    young=(0.5, 2.0),
    contact_stiffness=(0.5, 2.0),
    gap=(0.0, 0.003),
    mount_angle=(-0.1, 0.1),
    mount_offset=(-0.005, 0.005),
    friction=(-0.2, 0.3),
)
SWITCHES = [field.name for field in dataclasses.fields(PlantVariation)]
ROUND_OFF = 1e-12  # a few operations on numbers of order one


COUNT = 200


@pytest.fixture(scope="module")
def variants() -> list[Variant]:
    return [draw_variant(EVERYTHING, 0, number) for number in range(COUNT)]


def values_of(variants: list[Variant], name: str) -> np.ndarray:
    return np.array([np.ravel(getattr(variant, name)) for variant in variants])


def test_by_default_nothing_varies() -> None:
    assert draw_variant(PlantVariation(), 3, 7) == NOMINAL
    assert varied(Exosuit(), NOMINAL) == Exosuit()


@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_moves_its_own_quantity_alone(name: str) -> None:
    one = PlantVariation(**{name: getattr(EVERYTHING, name)})
    for number in range(5):
        variant = draw_variant(one, 1, number)
        together = draw_variant(EVERYTHING, 1, number)
        assert getattr(variant, name) == getattr(together, name) != getattr(NOMINAL, name)
        assert dataclasses.replace(variant, **{name: getattr(NOMINAL, name)}) == NOMINAL


@given(st.integers(0, 2**32), st.integers(0, 10**6))
def test_draws_lie_within_their_limits(seed: int, shape_id: int) -> None:
    variant = draw_variant(EVERYTHING, seed, shape_id)
    for name in SWITCHES:
        low, high = getattr(EVERYTHING, name)
        assert np.all((low <= np.ravel(getattr(variant, name))) & (np.ravel(getattr(variant, name)) <= high))
    assert TypeAdapter(Variant).validate_json(TypeAdapter(Variant).dump_json(variant)) == variant


@pytest.mark.parametrize("name", ["young", "link_length", "joint_stiffness"])
def test_factors_are_even_in_their_logarithm(variants: list[Variant], name: str) -> None:
    low, high = np.log(getattr(EVERYTHING, name))
    values = (np.log(values_of(variants, name)) - low) / (high - low)
    # Five standard errors of the mean of numbers even in 0…1.
    assert values.mean(axis=0) == pytest.approx(0.5, abs=5 * np.sqrt(1 / 12 / COUNT))
    assert np.all(np.histogram(values, 4, (0, 1))[0] > 0.15 * values.size)


def test_links_and_joints_differ_from_each_other_and_between_exosuits(variants: list[Variant]) -> None:
    for name in ("link_length", "joint_stiffness"):
        values = values_of(variants, name)
        assert len(np.unique(values)) == values.size
        between = np.corrcoef(values.T) - np.eye(values.shape[1])
        assert np.abs(between).max() < 5 / np.sqrt(COUNT)  # five standard errors of no correlation


def test_a_variant_changes_the_finger_and_the_mount_as_it_says() -> None:
    variant = Variant(
        link_length=(1.1, 1.0, 0.9, 1.0), finger_radius=1.2, joint_stiffness=(2.0, 1.0, 0.5), young=0.5,
        contact_stiffness=2.0, gap=0.001, mount_angle=0.05, mount_offset=0.003,
    )  # fmt: skip
    exosuit = varied(Exosuit(), variant)
    old, new = Finger(), exosuit.finger
    np.testing.assert_allclose(np.array(new.lengths) / old.lengths, variant.link_length, rtol=ROUND_OFF)
    np.testing.assert_allclose(np.array(new.radii) / old.radii, 1.2, rtol=ROUND_OFF)
    np.testing.assert_allclose(
        np.array(new.joint_stiffness) / old.joint_stiffness, variant.joint_stiffness, rtol=ROUND_OFF
    )
    assert (exosuit.young, exosuit.contact_stiffness) == (150e3, 2000.0)
    mount = np.asarray(assemble(exosuit)[ROD].mount)
    nominal = np.asarray(assemble(Exosuit())[ROD].mount)
    up = np.array([np.cos(0.05), 0.0, np.sin(0.05)])
    np.testing.assert_allclose(mount[:3, 0], up, atol=ROUND_OFF)
    np.testing.assert_allclose(mount[:3, :3] @ mount[:3, :3].T, np.eye(3), atol=ROUND_OFF)
    # Touching at the base: a thicker finger lifts the exosuit by what its radius gains, and the gap adds.
    gained = 0.2 * old.radii[0] + 0.001
    np.testing.assert_allclose(mount[:3, 3] - nominal[:3, 3], [0.003, 0.0, gained], atol=ROUND_OFF)


def bend(**change: object) -> tuple[float, float]:
    """How far a varied exosuit and its finger bend at 0.5 N, where nothing has snapped yet [rad]."""
    found = simulate(varied(Exosuit(), Variant(**change)), [0.5])
    assert found.equilibria.converged.all()
    axis = found.observation.axes["exosuit"][0]
    base = float(np.arctan2(*(axis[1] - axis[0])[[2, 0]]))
    return base - float(found.tip_angle[0]), float(found.reading("angle_1", "angle_2", "angle_3").sum())


@pytest.fixture(scope="module")
def nominal() -> tuple[float, float]:
    return bend()


@pytest.mark.parametrize("stiffer", [{"joint_stiffness": (2.0, 2.0, 2.0)}, {"young": 2.0}])
def test_stiffer_parts_bend_less_under_the_same_load(nominal: tuple[float, float], stiffer: dict) -> None:
    exosuit, finger = bend(**stiffer)
    assert 0 < exosuit < nominal[0]
    assert 0 < finger < nominal[1]


def test_exosuit_inclined_away_flexes_the_finger_less(nominal: tuple[float, float]) -> None:
    assert 0 <= bend(mount_angle=0.15)[1] < nominal[1]


def test_scaled_plant_bends_alike() -> None:
    """Twice as stiff in every part under twice the load is the same pose."""
    soft = simulate(Exosuit(), [1.0])
    hard = simulate(
        varied(Exosuit(), Variant(young=2.0, joint_stiffness=(2.0, 2.0, 2.0), contact_stiffness=2.0)), [2.0]
    )
    # The joints' limits are not scaled, and none is reached. Both solves end at a residual of 1e-10.
    np.testing.assert_allclose(hard.observation.axes["exosuit"], soft.observation.axes["exosuit"], atol=1e-9)
    np.testing.assert_allclose(hard.observation.forces, 2 * soft.observation.forces, rtol=1e-6, atol=1e-9)


def test_unloaded_exosuit_stands_at_its_mount() -> None:
    found = simulate(varied(Exosuit(), Variant(mount_angle=0.2, gap=0.002)), [0.0])
    assert float(found.tip_angle[0]) == pytest.approx(0.2, abs=1e-9)  # residual 1e-10 of the solve
    axis = found.observation.axes["exosuit"][0]
    along = axis[-1] - axis[0]
    assert np.arctan2(along[2], along[0]) == pytest.approx(0.2, abs=1e-9)


@pytest.mark.parametrize(
    "wrong", [{"young": (2.0, 1.0)}, {"young": (0.0, 1.0)}, {"gap": (-0.1, 0.0)}, {"mount_angle": (0.0, 9.0)}]
)
def test_impossible_limits_are_refused(wrong: dict) -> None:
    with pytest.raises(ValidationError):
        PlantVariation(**wrong)


def test_other_fingers_and_negative_seeds_are_refused() -> None:
    other = Finger(lengths=(0.04, 0.03), radii=(0.01, 0.008, 0.006), joint_stiffness=(0.04,) * 2,
                   joint_range=((0.0, 1.0),) * 2)  # fmt: skip
    with pytest.raises(InputError, match="4 links"):
        varied(Exosuit(finger=other), NOMINAL)
    with pytest.raises(InputError, match="seed"):
        draw_variant(EVERYTHING, -1, 0)
