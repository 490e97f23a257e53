"""CSV of unknown origin: headings, units, separators, damage."""

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from exosight.errors import DataError, ExosightError
from exosight.rig.table import column_of, read_table


@pytest.mark.parametrize(
    ("heading", "name", "unit"),
    [
        ("thumb [N]", "thumb", "N"),
        ("thumb(mN)", "thumb", "mN"),
        ("net force [N m]", "net_force", "N m"),
        ("Kraft Fußspitze", "Kraft_Fu_spitze", None),
        ("F_x []", "F_x", None),
    ],
)
def test_headings_are_names_with_units(heading: str, name: str, unit: str | None) -> None:
    column = column_of(heading, ())
    assert (column.name, column.unit) == (name, unit)


@given(
    rows=st.lists(
        st.tuples(st.floats(allow_nan=False, allow_infinity=False), st.none() | st.integers(-9, 9)),
        min_size=1,
        max_size=9,
    ),
    separator=st.sampled_from(",;\t"),
    end=st.sampled_from(["\n", "\r\n"]),
)
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_numbers_come_back_whatever_the_separator(
    rows: list[tuple[float, int | None]], separator: str, end: str, tmp_path: Path
) -> None:
    lines = [("a [N]", "b"), *((repr(x), "" if y is None else str(y)) for x, y in rows)]
    path = tmp_path / "table.csv"
    path.write_text(end.join(separator.join(line) for line in lines), encoding="utf-8-sig", newline="")
    found = read_table(path)
    np.testing.assert_array_equal(found.column("a").numbers, [x for x, _ in rows])
    assert [None if math.isnan(y) else y for y in found.column("b").numbers] == [y for _, y in rows]


def test_decimal_commas_are_read_between_semicolons(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("a [N];b\n1,5;x,y\n-2,25e-1;z\n")
    found = read_table(tmp_path / "table.csv")
    assert found.column("a").numbers.tolist() == [1.5, -0.225]
    assert not found.column("b").is_numeric


@given(st.binary(max_size=200))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_bytes_are_a_table_or_one_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "table.csv").write_bytes(content)
    with suppress(ExosightError):  # whose message is one line by construction
        assert len(read_table(tmp_path / "table.csv")) >= 1


def test_a_truncated_table_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("a [N],b [N]\n1,2\n3")
    with pytest.raises(DataError, match="row 2 has 1 cells, the headings have 2; is the file truncated"):
        read_table(tmp_path / "table.csv")
