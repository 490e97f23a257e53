"""Links, rods and the tree: closed forms of stiffness and mass, and what is refused."""

import jax.numpy as jnp
import numpy as np
import pytest

from exosight.errors import InputError
from exosight.mechanics import (
    Circular,
    Gauss,
    JointTorque,
    Legendre,
    Link,
    NodalQuadratic,
    PressureLine,
    Revolute,
    Robot,
    Rod,
)
from exosight.mechanics.basis import Basis
from exosight.mechanics.contact import Spheres

POINTS = Gauss(5, 3)


def make_rod(**changes: object) -> Rod:
    given = {"length": 0.1, "section": Circular(jnp.full(POINTS.size, 0.005)), "young": 3e5}
    fixed = {"strains": {"bend_y": NodalQuadratic(5), "stretch_x": Legendre(0)}, "quadrature": POINTS}
    return Rod("rod", **(given | fixed | changes))


def test_energy_of_uniform_bending_and_stretching_of_a_taper() -> None:
    """½ κ² ∫EI ds + ½ ε² ∫EA ds: of degree 4 and 2 for a linear radius, so Gauss integrates them."""
    base, tip, length, young = 0.006, 0.004, 0.1, 3e5
    section = Circular(base + (tip - base) * POINTS.points)
    rod = make_rod(section=section, length=length, young=young)
    angle, stretch = 0.7, 0.05
    q = np.concatenate([np.full(11, angle), [stretch]])  # κ = angle / length
    fourth = (tip**5 - base**5) / (5 * (tip - base)) * length
    second = (tip**3 - base**3) / (3 * (tip - base)) * length
    expected = 0.5 * young * np.pi * ((angle / length) ** 2 * fourth / 4 + stretch**2 * second)
    assert 0.5 * q @ rod.stiffness() @ q == pytest.approx(expected, rel=1e-13)


def test_mass_of_a_taper_is_that_of_the_frustum() -> None:
    base, tip = 0.006, 0.004
    rod = make_rod(section=Circular(base + (tip - base) * POINTS.points), density=1070.0)
    frustum = np.pi * 0.1 / 3 * (base**2 + base * tip + tip**2)
    assert float(rod.mass().sum()) == pytest.approx(1070 * frustum, rel=1e-13)


def test_strains_keep_one_order_however_they_are_named() -> None:
    one = make_rod(strains={"stretch_x": Legendre(0), "bend_y": Legendre(1)})
    other = make_rod(strains={"bend_y": Legendre(1), "stretch_x": Legendre(0)})
    assert one.strains == other.strains
    assert one.rows == (1, 3)
    assert one.dofs == 3


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"length": 0.0}, "length: expected a finite number above 0 m, got 0"),
        ({"length": float("nan")}, "length: expected a finite number above 0 m, got nan"),
        ({"young": -1.0}, "young: expected a finite number above 0 Pa, got -1"),
        ({"poisson": 0.6}, "poisson: expected within"),
        ({"density": -1.0}, "density: expected finite, at least 0"),
        ({"strains": {"bend": NodalQuadratic(5)}}, "strains: expected some of torsion_x, bend_y"),
        ({"strains": {}}, "strains: expected some of"),
        ({"section": Circular(np.ones(2))}, "section: expected sizes at 17 points, got 2"),
        ({"natural": lambda x: np.zeros((len(x), 3))}, "natural: expected a function"),
    ],
)
def test_impossible_rods_are_refused(changes: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make_rod(**changes)


def test_impossible_trees_are_refused() -> None:
    site = jnp.zeros((1, 3))
    with pytest.raises(InputError, match="length: expected a finite length of at least 0 m, got -1"):
        Link("a", -1.0, site)
    with pytest.raises(InputError, match="two bodies are named 'a'"):
        Robot((Link("a", 1.0, site), Link("a", 1.0, site)))
    with pytest.raises(InputError, match="'b' sits on 'c', which does not come before it"):
        Robot((Link("a", 1.0, site), Link("b", 1.0, site, parent="c")))
    robot = Robot((Link("a", 1.0, site),))
    with pytest.raises(InputError, match="no body is named 'b'; it has a"):
        robot.index("b")
    with pytest.raises(InputError, match="no body is named 'b'"):
        Spheres((("b", 0),), jnp.ones(1)).index(robot)


def test_slices_tile_the_tree(tree: Robot) -> None:
    for slices, total in (
        ([tree.dof_slice(body.name) for body in tree.bodies], tree.dofs),
        ([tree.frame_slice(body.name) for body in tree.bodies], tree.frames),
    ):
        assert [s.start for s in slices] == [0, *(s.stop for s in slices[:-1])]
        assert slices[-1].stop == total
    # All six strains on 5 nodes or 3 polynomials, a hinge each; then shear and bending of the branch.
    assert tree.dofs == 1 + 5 * 5 + 3 + 1 + 1 + 5


def test_a_line_needs_a_rod() -> None:
    robot = Robot((Link("a", 1.0, jnp.zeros((1, 3))),))
    with pytest.raises(InputError, match="'a' is a link"):
        PressureLine("a", 0, jnp.zeros((1, 3)), jnp.zeros((1, 3))).bind(robot)


class Flat:
    """A basis that a user got wrong: every function is the same."""

    size = 2

    def evaluate(self, x: np.ndarray) -> np.ndarray:
        return np.ones((len(x), 2))


class Broken(Flat):
    """Or not finite at an end."""

    def evaluate(self, x: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return np.stack([np.ones_like(x), 1 / x], axis=1)


@pytest.mark.parametrize(
    ("basis", "said"),
    [
        (Flat(), "bend_y: expected functions that the quadrature tells apart, got 2"),
        (Legendre(9), "bend_y: expected functions that the quadrature tells apart, got 10"),
        (Broken(), r"bend_y: expected `evaluate` to give finite values of shape \(8, 2\)"),
    ],
)
def test_bases_that_the_quadrature_cannot_resolve_are_refused(basis: Basis, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Rod(
            "rod",
            0.1,
            Circular(np.full(8, 0.01)),
            young=1e5,
            strains={"bend_y": basis},
            quadrature=Gauss(1, 6),
        )


def test_a_load_channel_below_zero_is_refused() -> None:
    link = Link("link", 0.1, np.zeros((1, 3)), joint=Revolute(stiffness=1.0))
    with pytest.raises(InputError, match="JointTorque: expected a load channel 0, 1, 2 …, got -1"):
        Robot((link,), (JointTorque("link", -1),))
