from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest

from exosight.control.trials import CONTROL_SHAPE
from exosight.errors import InputError
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index_file import index_values
from exosight.system.designs import Design, DesignSet, FileDesigns
from exosight.system.file import Values, replaced
from exosight.system.sensors import ContactForce, PlaceZone
from exosight.system.system import System, stack_systems
from exosight.system.units import split_quantity

HEAD = 'name = "small"\n'
VARY = """vary = [
    { entry = "rods.soft.young", low = "200 kPa", high = "400 kPa" },
    { entry = "surfaces.pads.at.0", low = 0.1, high = 0.9 },
]
"""


@pytest.fixture
def designs(values: Callable[..., Values]) -> FileDesigns:
    return FileDesigns(values((HEAD, HEAD + VARY)))


def test_a_draw_depends_on_seed_and_number_alone(designs: FileDesigns) -> None:
    assert isinstance(designs, DesignSet)
    few, many = designs.draw(3, seed=1), designs.draw(8, seed=1)
    assert many[:3] == few
    assert designs.draw(3, seed=2)[0].parameters != few[0].parameters
    assert len({str(design.parameters) for design in many}) == 8


def test_draws_fill_the_limits_and_build(designs: FileDesigns) -> None:
    drawn = designs.draw(200, seed=0)
    modulus = [split_quantity(str(design.parameters["rods.soft.young"]), "")[0] for design in drawn]
    assert 200 <= min(modulus) < 210
    assert 390 < max(modulus) <= 400
    built = [designs.build(design) for design in drawn[:5]]
    for system, value in zip(built, modulus, strict=False):
        assert float(system.robot["soft"].young) == pytest.approx(1e3 * value, rel=1e-12)  # type: ignore[union-attr]
        assert system.schema == designs.schema
    assert jax.tree.leaves(stack_systems(built))[0].shape[0] == 5


def test_the_file_itself_is_the_nominal_design(designs: FileDesigns) -> None:
    assert float(designs.build(designs.nominal()).robot["soft"].young) == 300e3  # type: ignore[union-attr]


def test_zones_stay_at_their_shares_of_a_link_whose_length_varies() -> None:
    """So the last zone stays on a finger that gets shorter."""
    values = index_values(Exosuit(CONTROL_SHAPE))
    entries = {f"links.finger_{i}.length": f"{0.03 + 0.01 * i!r} m" for i in range(4)}
    vary = [{"entry": entry, "low": "10 mm", "high": "90 mm"} for entry in entries]
    designs = FileDesigns({**values, "vary": vary})

    def middles(system: System) -> np.ndarray:
        (sensor,) = (each for each in system.sensors if each.spec.name == "C1")
        assert isinstance(sensor, ContactForce)
        assert isinstance(sensor.zone, PlaceZone)
        return np.asarray(sensor.zone.middles)

    def ends(table: Values) -> np.ndarray:
        lengths = [split_quantity(link["length"], "")[0] for link in table["links"].values()]
        return np.concatenate([[0], np.cumsum(lengths)])

    nominal, other = designs.build(designs.nominal()), designs.build(Design(0, 0, 0, entries))
    own, moved = ends(values), ends(replaced(values, entries))
    # Both are one rounding of the same interpolation.
    np.testing.assert_allclose(middles(other), np.interp(middles(nominal), own, moved), rtol=1e-12)
    last = max(split_quantity(each["at"], "")[0] for each in values["sensors"].values() if "at" in each)
    assert last > 0.9 * own[-1]
    # An entry that varies itself is where the design says.
    both = FileDesigns({**values, "vary": [*vary, {"entry": "sensors.C1.at", "low": "1 mm", "high": "2 mm"}]})
    own_place = both.build(Design(0, 0, 0, {**entries, "sensors.C1.at": "1.5 mm"}))
    assert np.isclose(middles(own_place), 1.5e-3, rtol=1e-12).sum() == 1


def test_what_does_not_vary_is_refused(designs: FileDesigns) -> None:
    with pytest.raises(InputError, match=r"rods\.soft\.length does not vary in small"):
        designs.build(Design(7, 0, 0, {"rods.soft.length": "3 mm"}))
    for count, seed in ((0, 0), (1, -1)):
        with pytest.raises(InputError, match="expected at least 1 and a seed of at least 0"):
            designs.draw(count, seed)


def test_limits_that_exclude_each_other_are_refused(values: Callable[..., Values]) -> None:
    joint = 'joint = { type = "revolute", stiffness = "0.03 N m/rad"'
    text = """vary = [
        { entry = "links.tip.joint.range.0", low = "-40 deg", high = "15 deg" },
        { entry = "links.tip.joint.range.1", low = "20 deg", high = "60 deg" },
        { entry = "rods.soft.radius.scale", low = 0.5, high = 2.0 },
    ]
    """
    profile = 'radius = { formula = "5 - 4*X*SCALE", unit = "mm", scale = 1.0 }'
    change = (f"{joint} }}", f'{joint}, range = ["0 deg", "30 deg"] }}')
    FileDesigns(values((HEAD, HEAD + text), change, ('radius = "5 mm"', profile.replace("*SCALE", ""))))
    crossing = text.replace('low = "20 deg"', 'low = "-60 deg"')
    with pytest.raises(InputError, match=r"vary\.1: with links\.tip\.joint\.range\.1 = -60\.0 deg"):
        FileDesigns(
            values((HEAD, HEAD + crossing), change, ('radius = "5 mm"', profile.replace("*SCALE", "")))
        )


def test_every_file_of_the_documentation_builds_at_every_draw(examples: Path) -> None:
    from exosight.exosuit.catalogue import find_system

    for path in sorted(examples.glob("*.toml")):
        found = find_system(str(path))
        for design in found.draw(20, seed=0):
            assert found.build(design).schema == found.schema
