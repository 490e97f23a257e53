"""Trees of arrays as rows of numbers."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as some

from exosight.mechanics.packing import Packing

EXAMPLE = {
    "matrix": np.zeros((2, 3)),
    "one": np.zeros(()),
    "none": np.zeros((0, 2)),
    "count": np.zeros(2, int),
}
PACKING = Packing((EXAMPLE, np.zeros((), bool)))


@given(some.integers(0, 2**32 - 1), some.booleans())
def test_unpacked_is_what_was_packed(seed: int, flag: bool) -> None:
    """Every value to the last bit, of its own type, infinities and what is no number too."""
    rng = np.random.default_rng(seed)
    tree = {name: rng.normal(size=value.shape) for name, value in EXAMPLE.items() if name != "count"}
    tree["matrix"][0, :2] = np.inf, np.nan
    tree["count"] = rng.integers(-(2**31), 2**31, 2)
    row = np.asarray(PACKING.pack((tree, np.array(flag))))
    assert row.shape == (PACKING.numbers,) == (9 + 1,)
    found, its_flag = PACKING.unpack(np.stack([row, row]))
    assert its_flag.tolist() == [flag, flag]
    assert its_flag.dtype == bool
    for name, value in tree.items():
        assert found[name].dtype == value.dtype
        np.testing.assert_array_equal(found[name], np.stack([value, value]))


def test_floats_are_views() -> None:
    """What is written to them is in the rows."""
    rows = np.zeros((3, PACKING.numbers))
    PACKING.unpack(rows)[0]["matrix"][1] = 1.0
    assert rows.sum() == 6
