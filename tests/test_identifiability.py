"""What one outline tells of the forces, against closed forms and the physics of an equilibrium."""

import dataclasses

import jax
import numpy as np
import pytest
from figures_identifiability import beside_network, bounds_and_errors, identifiability_map, with_friction
from identifiability import (
    MATERIAL_KNOWN,
    MATERIAL_VARIES,
    PARAMETERS,
    Prior,
    Sensitivity,
    measured,
    resolved,
    sensitivity,
    system_at,
)
from identifiability_friction import Slopes, told

from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index
from exosight.exosuit.published import PublishedDesigns, published
from exosight.exosuit.shapes import ExosuitShape, Linear
from exosight.exosuit.simulation import simulate

EXOSUIT = Exosuit(ExosuitShape(Linear(r0=0.0095, r1=0.0055), length=0.095))
U, YOUNG, LENGTH = (PARAMETERS.index(name) for name in ("u", "young", "length"))
STIFFNESSES = [i for i, name in enumerate(PARAMETERS) if "stiffness" in name or name == "young"]


@pytest.fixture(scope="module")
def at_one_newton() -> Sensitivity:
    """0.8 N: C6 alone; 1.2 N: C5 and C6."""
    return sensitivity(EXOSUIT, np.array([0.8, 1.2]))


def made_up(points: int = 30, seed: int = 0) -> Sensitivity:
    rng = np.random.default_rng(seed)
    count = len(PARAMETERS)
    return Sensitivity(
        u=np.ones(1),
        forces=np.ones((1, 7)),
        stable=np.ones(1, dtype=bool),
        outline=rng.normal(size=(1, points, count)),
        force=rng.normal(size=(1, 7, count)),
    )


def test_load_and_all_stiffnesses_scaled_alike_move_forces_but_no_outline(at_one_newton: Sensitivity) -> None:
    # Energies are linear in u and the stiffnesses: Π → (1 + ε) Π has the same minima, its forces 1 + ε times.
    for k, u in enumerate(at_one_newton.u):
        direction = np.zeros(len(PARAMETERS))
        direction[U], direction[STIFFNESSES] = u, 1.0
        # Round-off of a solve with a Hessian of condition 1e6, against shifts of 1 cm.
        assert np.abs(at_one_newton.outline[k] @ direction).max() < 1e-9
        np.testing.assert_allclose(at_one_newton.force[k] @ direction, at_one_newton.forces[k], atol=1e-8)


def test_forces_by_load_agree_with_two_simulations(at_one_newton: Sensitivity) -> None:
    step = 1e-3
    names = [f"C{i}" for i in range(1, 8)]
    low, high = simulate(EXOSUIT, [1.2 - step, 1.2 + step]).reading(*names)
    # The second-order term of forces that bend over tenths of a newton, times 1e-6.
    np.testing.assert_allclose(at_one_newton.force[1, :, U], (high - low) / (2 * step), atol=2e-3)
    assert np.abs(at_one_newton.force[1, :, U]).max() > 0.1


def test_free_contacts_have_no_resolved_force(at_one_newton: Sensitivity) -> None:
    found = resolved(at_one_newton)
    free = at_one_newton.forces == 0
    assert free.any()
    assert not free.all()
    np.testing.assert_array_equal(np.isnan(found[:, :7]), free)
    assert not np.isnan(found[:, 7]).any()


def test_sharing_between_neighbours_is_harder_to_see_than_one_contact(at_one_newton: Sensitivity) -> None:
    found = resolved(at_one_newton)
    # One contact follows from the finger's joint angles; how two share it from a gap of a few micrometres.
    assert found[1, 5] > 5 * found[0, 5]
    assert found[1, 5] > found[1, 7]


def test_unknown_stiffness_costs_what_scale_costs(at_one_newton: Sensitivity) -> None:
    loose = resolved(at_one_newton, Prior(stiffness=0.1))
    # At 0.8 N C6 alone presses: the finger's pose gives its torques, up to how stiff its hinges are known,
    # ±10 % each. Several hinges share in the force, so that it is known to less than 10 % but not much less.
    relative = loose[0, 5] / at_one_newton.forces[0, 5]
    assert 0.03 < relative < 0.11
    assert loose[0, 5] > 5 * resolved(at_one_newton, MATERIAL_KNOWN)[0, 5]


def test_halving_noise_halves_the_resolved_force_when_the_prior_is_wide() -> None:
    wide = Prior(u=1e6, stiffness=1e6, length=1e6, radius=1e6)
    coarse, fine = (resolved(made_up(), wide, noise, metres_per_pixel=1.0) for noise in (1.0, 0.5))
    # The prior adds one part in its variance, 1e12.
    np.testing.assert_allclose(fine, coarse / 2, rtol=1e-9)


def test_wide_prior_gives_least_squares_and_no_picture_gives_the_prior() -> None:
    of = made_up()
    wide = Prior(u=1e6, stiffness=1e6, length=1e6, radius=1e6)
    fisher = np.linalg.inv(of.outline[0].T @ of.outline[0])
    expected = np.sqrt(np.diag(of.force[0] @ fisher @ of.force[0].T))
    # Squaring a matrix of condition 10 costs two of sixteen digits.
    np.testing.assert_allclose(resolved(of, wide, 1.0, 1.0)[0, :7], expected, rtol=1e-9)
    before = np.sqrt(of.force[0] ** 2 @ Prior().deviations() ** 2)
    np.testing.assert_allclose(resolved(of, Prior(), np.inf)[0, :7], before, rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_more_information_never_raises_it(seed: int) -> None:
    of = made_up(points=8, seed=seed)  # fewer points than unknowns: some directions are not seen
    more = dataclasses.replace(of, outline=np.concatenate([of.outline, made_up(3, seed + 9).outline], axis=1))
    base = resolved(of, MATERIAL_VARIES, 1.0, 1.0)
    for better in (
        resolved(more, MATERIAL_VARIES, 1.0, 1.0),
        resolved(of, MATERIAL_KNOWN, 1.0, 1.0),
        resolved(of, MATERIAL_VARIES, 0.3, 1.0),
    ):
        assert np.all(better <= base * (1 + 1e-12))
        assert np.any(better < base)


def test_poses_without_derivatives_resolve_nothing() -> None:
    unstable = dataclasses.replace(made_up(), stable=np.zeros(1, dtype=bool))
    assert np.isnan(resolved(unstable)).all()


def test_without_a_change_of_parameters_the_system_is_the_preset() -> None:
    for surfaces, preset in ((False, published), (True, index)):
        own, other = system_at(EXOSUIT, np.zeros(len(PARAMETERS)), surfaces), preset(EXOSUIT)
        assert jax.tree.structure(own) == jax.tree.structure(other)
        # The radii pass through other sums: round-off.
        for one, two in zip(jax.tree.leaves(own), jax.tree.leaves(other), strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-15)


def test_where_surfaces_overlap_the_outline_is_the_boundary_that_pictures_show() -> None:
    # Straight and inclined towards the finger, an exosuit reaches into it by up to 2 mm.
    inclined = Exosuit(ExosuitShape(Linear(r0=0.006, r1=0.006), length=0.07), mount_angle=-0.1)
    system = system_at(inclined, np.zeros(len(PARAMETERS)), surfaces=True)
    points, across, _ = jax.jit(measured)(system, np.zeros(25))
    upper, lower = points[:42], points[42:84]
    free = upper - 2 * 0.006 * across[:42]
    finger = inclined.finger
    top = np.interp(free[:, 0], np.cumsum([0, *finger.lengths]), finger.radii)
    deep = top - free[:, 1]
    assert 1e-3 < deep.max() < 3e-3
    raised = np.asarray(lower - free)[:, 1]
    assert not raised[deep < -1e-4].any()
    # Of two that overlap by d, the first ends d r₂/(r₁ + r₂) early, to first order in d / r; normals that
    # differ by 0.1 rad shift a point by 0.1²/2 of 6 mm.
    expected = deep * top / (top + 0.006)
    np.testing.assert_allclose(raised[deep > 1e-4], expected[deep > 1e-4], rtol=0.1, atol=3e-5)


def test_loads_and_noise_out_of_range_are_refused() -> None:
    for loads in ([], [1.0, 0.5], [-1.0], [0.0, np.nan]):
        with pytest.raises(InputError, match="loads: expected rising numbers from 0 N"):
            sensitivity(EXOSUIT, np.array(loads))
    with pytest.raises(InputError, match="noise: expected above 0 pixels, got 0"):
        resolved(made_up(), noise=0.0)


def test_the_map_shows_every_contact_of_every_case() -> None:
    found = np.full((3, 8), 0.01)
    found[0] = np.nan
    figure = identifiability_map(
        PublishedDesigns().schema.controllable, np.array([0.0, 1.0, 2.0]), {"known": found, "varies": found}
    )
    panels = [ax for ax in figure.axes if ax.get_title()]
    assert [ax.get_title() for ax in panels] == ["known", "varies"]
    for ax in panels:
        assert [label.get_text() for label in ax.get_yticklabels()] == [f"C{i}" for i in range(1, 8)] + [
            "F_net"
        ]
        (mesh,) = ax.collections
        np.testing.assert_array_equal(np.ma.getmaskarray(mesh.get_array())[:, 0], True)
    assert panels[-1].get_xlabel() == "actuation u [N]"
    assert figure.axes[-1].get_ylabel() == "smallest force resolved [N]"


def test_bounds_stand_beside_the_errors_of_the_network() -> None:
    row = {
        "touched [%]": 4.0,
        "resolved [N]": {"0.1": 0.0033, "0.03": 0.001},
        "RMSE where touched [N]": 0.0053,
        "RMSE [N]": 0.0015,
        "error where not touched [%]": 54.0,
        "r": 0.9667,
        "r at the bound": {"0.1": 0.9941, "0.03": 0.9995},
    }
    found = {
        "C6": row,
        "F_net": row | {"shown": {"resolved [N]": [0.001, 0.003], "error [N]": [0.002, 0.0005]}},
    }
    assert "| C6 | 4 | 3.3 | 1.0 | 5.3 | 1.5 | 54 | 0.9941 | 0.9995 | 0.9667 |" in beside_network(found)
    (ax,) = bounds_and_errors(found).axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("force [mN]", "share of the frames [%]")
    for line, sizes in zip(ax.lines, ((1, 3), (0.5, 2)), strict=True):
        np.testing.assert_allclose(np.asarray(line.get_xydata()), np.column_stack([sizes, (50, 100)]))


def test_past_images_and_a_known_friction_never_tell_less() -> None:
    rng = np.random.default_rng(3)
    # Four loads, six outline points of about a pixel a deviation, seven contacts, three shared unknowns.
    outline = Slopes(1e-4 * rng.normal(size=(4, 6)), 1e-4 * rng.normal(size=(4, 6, 3)))
    force = Slopes(rng.normal(size=(4, 7)), rng.normal(size=(4, 7, 3)))
    one, past, known = (
        told(outline, force, [3]),
        told(outline, force, [0, 1, 2, 3]),
        told(outline, force, [3], known=1),
    )
    assert one.shape == (8,)
    for better in (past, known):
        assert np.all(better <= one * (1 + 1e-12))
        assert np.any(better < 0.99 * one)
    # An outline that nothing moves tells nothing: what is left is the prior's.
    blind = told(Slopes(0 * outline.own, 0 * outline.shared), force, [3])
    unknown = np.column_stack([force.own[3], force.shared[3]])
    np.testing.assert_allclose(blind[:7], np.linalg.norm(unknown, axis=1), rtol=1e-12)
    np.testing.assert_allclose(blind[7], np.linalg.norm(unknown.sum(axis=0)), rtol=1e-12)


def test_friction_table_has_a_row_a_way_and_a_column_a_case() -> None:
    case = {"one image": [0.0006, 0.0008], "with past images": [0.0003, 0.0005]}
    table = with_friction({"taper": {"rising": case, "falling": case}}).splitlines()
    assert table[0] == "| exosuit | one image [mN] | with past images [mN] |"
    assert table[2:] == [f"| taper; u {way} | 0.6 / 0.8 | 0.3 / 0.5 |" for way in ("rising", "falling")]
