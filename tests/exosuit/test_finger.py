"""The finger's dimensions, its spheres and centres of mass, against numerical integration."""

import numpy as np
import pytest
from scipy.integrate import quad

from exosight.errors import InputError
from exosight.exosuit.finger import Finger

CM = 0.01
LENGTHS = [4.5 * CM, 2.53 * CM, 2.36 * CM, 0.1 * CM]
RADII = [(1.08 * CM, 0.695 * CM), (0.695 * CM, 0.51 * CM), (0.51 * CM, 0.435 * CM), (0.435 * CM, 0.40 * CM)]


def centre_of_frustum(length: float, base: float, tip: float) -> float:
    """∫ x r² dx / ∫ r² dx."""

    def r_squared(x: float) -> float:
        return (base + (tip - base) * x / length) ** 2

    return quad(lambda x: x * r_squared(x), 0, length)[0] / quad(r_squared, 0, length)[0]


def test_links_are_the_published_ones() -> None:
    finger = Finger()
    links = finger.links()
    assert [float(link.length) for link in links] == pytest.approx(LENGTHS, rel=1e-14)
    assert [link.dofs for link in links] == [1, 1, 1, 0]
    assert [link.parent for link in links] == [None, "finger_0", "finger_1", "finger_2"]
    hinges = [link.joint for link in links[:3]]
    assert [float(hinge.stiffness[0]) for hinge in hinges] == [0.04, 0.03, 0.02]
    degrees = [(np.rad2deg(float(h.lower[0])), np.rad2deg(float(h.upper[0]))) for h in hinges]
    np.testing.assert_allclose(degrees, [(-10, 90), (-5, 90), (-5, 90)], rtol=1e-14)
    for hinge in hinges:
        np.testing.assert_array_equal(hinge.groups[0][:, 0], [0, 1, 0, 0, 0, 0])


@pytest.mark.parametrize("link", range(4))
def test_spheres_sit_at_the_base_and_the_centre_of_mass(link: int) -> None:
    finger = Finger()
    base, tip = RADII[link]
    centre = centre_of_frustum(LENGTHS[link], base, tip)
    sites = np.asarray(finger.links()[link].sites)
    # quad is good to about 1e-14 of its integral here.
    np.testing.assert_allclose(sites, [[0, 0, 0], [centre, 0, 0]], atol=1e-15, rtol=1e-12)
    local = base + (tip - base) * centre / LENGTHS[link]
    assert finger.sphere_radii()[2 * link : 2 * link + 2] == pytest.approx((base, local), rel=1e-12)


def test_a_cylinder_and_a_cone_have_known_centres() -> None:
    cylinder = Finger(lengths=(0.04,), radii=(0.01, 0.01), joint_stiffness=(), joint_range=())
    assert cylinder.centre_of_mass(0) == pytest.approx(0.02, rel=1e-15)
    cone = Finger(lengths=(0.04,), radii=(0.01, 1e-9), joint_stiffness=(), joint_range=())
    assert cone.centre_of_mass(0) == pytest.approx(0.01, rel=1e-6)  # a quarter of its height


def test_there_are_eight_contacts() -> None:
    assert len(Finger().sphere_radii()) == 8


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"radii": (0.01, 0.01)}, "finger radii: expected one more than links, 5, got 2"),
        ({"joint_stiffness": (0.04,)}, "finger joints: expected one stiffness and one range a hinge"),
        ({"lengths": (0.045, -0.0253, 0.0236, 0.001)}, "finger lengths: expected finite numbers above 0 m"),
        (
            {"lengths": (0.045, float("nan"), 0.0236, 0.001)},
            "finger lengths: expected finite numbers above 0 m",
        ),
        ({"radii": (0.0, 0.01, 0.01, 0.01, 0.01)}, "finger radii: expected finite numbers above 0 m"),
    ],
)
def test_impossible_fingers_are_refused(changes: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Finger(**changes)
