import json
import math

import numpy as np
import pytest
from schemas import mixed_schema, published_schema

from exosight.errors import InputError
from exosight.evaluation.metrics import Scores, Spread, score
from exosight.evaluation.tables import (
    Column,
    Table,
    cell_text,
    largest_table,
    mean_table,
    robustness_table,
    sensor_table,
)


def scores(constant: int | None = None):
    true, estimated = np.random.default_rng(0).gamma(1.0, 0.2, (2, 30, 7))
    if constant is not None:
        true[:, constant] = 0
    return score(published_schema(), true, estimated)


@pytest.mark.parametrize(
    ("cell", "digits", "text"),
    [
        (None, None, "–"),
        (math.nan, 2, "–"),
        (math.inf, None, "–"),
        (78847, None, "78\N{NARROW NO-BREAK SPACE}847"),
        (0.83, 2, "0.83"),
        (-0.0123, 3, "−0.012"),
        (0.012345, None, "0.0123"),
        (1234.5, None, "1\N{NARROW NO-BREAK SPACE}234"),
        (Spread(0.8386, 0.161, 7), 2, "0.84 ± 0.16"),
        (Spread(0.8386, math.nan, 1), 2, "0.84"),
        (Spread(math.nan, math.nan, 0), 2, "–"),
        ("too slow", 2, "too slow"),
        ("a-b, 1,000", None, "a-b, 1,000"),
    ],
)
def test_cells_read_well(cell, digits, text):
    assert cell_text(cell, Column("quantity", digits=digits)) == text


def test_keys_carry_group_and_unit():
    assert Column("exosight", "N", "RMSE").key() == "RMSE exosight [N]"
    assert Column("exosight", "N", "RMSE").key("SD") == "RMSE exosight SD [N]"
    assert Column("contact").key() == "contact"


def test_records_of_a_table_share_their_keys_and_are_json():
    table = Table(
        "mixed",
        "Mixed",
        (Column("case"), Column("r")),
        (("a", Spread(0.5, math.nan, 1)), ("b", math.nan), ("c", 3)),
    )
    assert json.loads(json.dumps(table.records(), allow_nan=False)) == [
        {"case": "a", "r": 0.5, "r SD": None, "r count": 1},
        {"case": "b", "r": None, "r SD": None, "r count": None},
        {"case": "c", "r": 3, "r SD": None, "r count": None},
    ]


def test_rows_of_another_length_are_refused():
    with pytest.raises(InputError, match="expected 2 cells"):
        Table("t", "T", (Column("a"), Column("b")), (("x",),))


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a" * 65, "null\0"])
def test_names_that_are_no_file_names_are_refused(name):
    with pytest.raises(InputError, match="table name"):
        Table(name, "T", (Column("a"),), ())


def test_contacts_stand_beside_the_papers():
    ours = scores()
    table = sensor_table("contacts", "Each contact", ours)
    record = table.records()[5]
    assert record["contact"] == "C6"
    assert record["r exosight"] == ours.outputs[5].r
    assert record["r paper"] == 0.51
    assert record["RMSE paper [N]"] == 0.07
    assert record["RMS% paper [%]"] == 3.85
    mean = table.records()[7]
    assert mean["r exosight"] == ours.r.mean
    assert mean["r paper SD"] == 0.16
    assert "undefined" not in table.note


def test_undefined_contact_is_a_dash_and_is_explained():
    table = sensor_table("contacts", "Each contact", scores(constant=2))
    heads = [column.key() for column in table.columns]
    row = dict(zip(heads, zip(table.rows[2], table.columns, strict=True), strict=True))
    assert cell_text(*row["r exosight"]) == "–"
    assert cell_text(*row["RMS% exosight [%]"]) == "–"
    assert cell_text(*row["RMSE exosight [N]"]) != "–"
    assert "1 of 7 contacts are left out of the mean r" in table.note


def test_largest_forces_stand_beside_the_papers():
    ours = scores()
    record = largest_table("largest", "Largest forces", ours).records()[0]
    assert record["exosight true [N]"] == ours.outputs[0].largest_true
    assert record["exosight estimated [N]"] == ours.outputs[0].largest_estimated
    assert (record["paper true [N]"], record["paper estimated [N]"]) == (2.41, 0.69)


def test_each_corruption_stands_beside_its_own_column_of_table_4():
    ours = scores()
    table = robustness_table("robustness", "Degraded images", {"clean": ours, "noise-high": ours})
    clean, noisy = table.records()
    assert (clean["r paper"], noisy["r paper"]) == (0.83, 0.11)
    assert (clean["RMS% paper [%]"], noisy["RMS% paper [%]"]) == (2.72, 6.42)
    assert noisy["images"] == "noise, high"
    assert noisy["RMSE exosight [N]"] == ours.rmse.mean


def test_splits_stand_beside_the_papers_only_one():
    table = mean_table("splits", "Splits", {"by frame": scores(), "by shape": scores()})
    assert [record["split"] for record in table.records()] == ["by frame", "by shape"]
    assert {record["r paper"] for record in table.records()} == {0.83}


def mixed() -> Scores:
    true, estimated = np.random.default_rng(0).gamma(1.0, 0.2, (2, 30, 4))
    return score(mixed_schema(), true, estimated)


@pytest.mark.parametrize(
    "table",
    [
        sensor_table("sensors", "Each sensor", mixed()),
        largest_table("largest", "Largest", mixed()),
        mean_table("means", "Means", {"by design": mixed()}),
        robustness_table("robustness", "Degraded images", {"clean": mixed(), "noise-high": mixed()}),
    ],
    ids=lambda table: table.name,
)
def test_another_system_does_not_stand_beside_the_paper(table: Table):
    assert not any("paper" in key for record in table.records() for key in record)


def test_units_stand_in_the_row_where_they_differ():
    table = sensor_table("sensors", "Each sensor", mixed())
    names = [row[0] for row in table.rows]
    assert names[:2] == ["zone_0 [N]", "knuckle_of_the_index [rad]"]
    assert names[-1] == "grip [N]"
    assert table.columns[1].unit == ""
    assert "grip is the sum of zone_1 and zone_2" in table.note
    assert cell_text(table.rows[4][1], table.columns[1]) == "–"  # newtons and radians have no mean
