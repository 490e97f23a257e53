import base64
import csv
import json
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure
from schemas import published_schema

from exosight.app.report import (
    Listing,
    Picture,
    Points,
    Report,
    Section,
    render_report,
    write_report,
    write_tables,
)
from exosight.errors import DataError, InputError
from exosight.evaluation.metrics import Spread
from exosight.evaluation.tables import Column, Table

HOSTILE = '</title><script>alert("1")</script><img src=x onerror=alert(2)> & "quoted" {{ 7 * 7 }}'
VOID = {"meta", "img", "link", "br", "hr", "input"}


class Page(HTMLParser):
    """Collects elements, and fails on tags that are closed in another order than they were opened."""

    def __init__(self, html: str):
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attrs for name, attrs in self.elements if name == tag]


def figure() -> Figure:
    drawn = Figure(figsize=(3, 2))
    drawn.subplots().plot([0, 1], [0, 1])
    return drawn


def table(name: str = "contacts", cell: str = "C1") -> Table:
    columns = (
        Column("contact"),
        Column("exosight", "N", "RMSE", 3),
        Column("paper", "N", "RMSE", 2),
        Column("n"),
    )
    rows = ((cell, 0.0123, 0.02, 50), ("mean", Spread(0.5, math.nan, 1), None, math.nan))
    return Table(name, "Each contact", columns, rows, "A note.")


def report(*blocks, title: str = "A report") -> Report:
    blocks = blocks or (
        "A paragraph.",
        Points(("one", "two")),
        table(),
        Picture(figure(), "A caption.", "A line that rises."),
        Listing("The command.", "exosight study --preset quick"),
    )
    return Report(title, "What this is.", (Section("First", blocks), Section("Second", ("End.",))), "seed 0")


def test_page_is_well_formed_and_says_everything():
    page = Page(render_report(report()))
    for words in ("A report", "What this is.", "A paragraph.", "two", "A caption.", "A note.", "seed 0"):
        assert words in page.text
    assert page.all("html")[0]["lang"] == "en"
    assert len(page.all("h1")) == 1
    assert len(page.all("h2")) == 2
    assert any(meta.get("name") == "viewport" for meta in page.all("meta"))


def test_contents_lead_to_the_sections():
    page = Page(render_report(report()))
    targets = [a["href"] for a in page.all("a")]
    assert targets == [f"#{section['id']}" for section in page.all("section")]
    assert len(set(targets)) == 2


def test_page_loads_nothing():
    html = render_report(report())
    page = Page(html)
    for tag, attrs in page.elements:
        assert tag not in {"script", "link", "iframe", "object", "embed", "base", "form"}
        assert not any(name.startswith("on") for name in attrs)
        for name in ("src", "srcset", "href", "action", "data", "poster", "background"):
            if name in attrs:
                assert str(attrs[name]).startswith(("#", "data:image/svg+xml;base64,"))
    assert not re.search(r"url\(|@import|https?://", html)
    (policy,) = (meta["content"] for meta in page.all("meta") if "http-equiv" in meta)
    assert str(policy).startswith("default-src 'none'")


def test_figures_inside_load_nothing_either():
    page = Page(render_report(report()))
    for image in page.all("img"):
        svg = base64.b64decode(str(image["src"]).partition(",")[2]).decode()
        assert svg.startswith("<?xml")
        # Names of XML vocabularies are no addresses that anything fetches.
        fetched = re.sub(r'xmlns(:\w+)?="[^"]*"|<!DOCTYPE[^>]*>', "", svg)
        assert "http" not in fetched
        assert "<script" not in svg


def test_hostile_text_stays_text():
    blocks = (
        HOSTILE,
        Points((HOSTILE,)),
        Table("t", HOSTILE, (Column(HOSTILE, HOSTILE, HOSTILE), Column("b")), ((HOSTILE, HOSTILE),), HOSTILE),
        Picture(figure(), HOSTILE, HOSTILE),
        Listing(HOSTILE, HOSTILE),
    )
    html = render_report(
        Report(HOSTILE, HOSTILE, (Section(HOSTILE, blocks),), HOSTILE),
    )
    page = Page(html)
    assert page.all("script") == []
    (image,) = page.all("img")
    assert image["alt"] == HOSTILE
    assert set(image) == {"src", "alt", "style"}
    # Title, summary, contents, heading, footer, and in the blocks 1 + 1 + 7 + 1 + 2.
    assert page.text.count(HOSTILE) == 6 + 12
    assert "49" not in page.text


def test_every_picture_has_alt_text_and_every_figure_a_caption():
    page = Page(render_report(report()))
    assert all(image["alt"] for image in page.all("img"))
    captions = len(page.all("figcaption")) + len(page.all("caption"))
    assert captions == len(page.all("figure")) == 3


def test_table_headers_name_their_scope_and_span_their_group():
    page = Page(render_report(report(table())))
    heads = page.all("th")
    assert all(head.get("scope") in {"col", "colgroup", "row"} for head in heads)
    assert [head["colspan"] for head in heads if head["scope"] == "colgroup"] == ["2"]
    assert len([head for head in heads if head["scope"] == "row"]) == 2
    assert "[N]" in page.text
    for text in ("0.012", "0.02", "50", "0.500", "–"):
        assert text in page.text
    assert "nan" not in page.text.lower()


def test_table_without_groups_has_one_row_of_headers():
    plain = Table("t", "Plain", (Column("a"), Column("b", "N")), (("x", 1.0),))
    page = Page(render_report(report(plain)))
    assert not any("rowspan" in head for head in page.all("th"))
    assert len(page.all("tr")) == 2


def test_page_follows_the_readers_colours_and_screen():
    html = render_report(report())
    assert "prefers-color-scheme: dark" in html
    assert "max-width: 40rem" in html


def test_same_report_gives_the_same_page():
    assert render_report(report()) == render_report(report())


def test_written_report_is_never_overwritten(tmp_path):
    path = tmp_path / "report.html"
    write_report(report(), path)
    before = path.read_bytes()
    assert before.decode() == render_report(report())
    with pytest.raises(DataError, match=r"report\.html"):
        write_report(report(title="Another"), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]


def test_report_into_a_missing_folder_is_refused_by_name(tmp_path):
    with pytest.raises(DataError, match="nowhere"):
        write_report(report(), tmp_path / "nowhere" / "report.html")


def test_tables_are_written_as_csv_and_json_with_all_digits(tmp_path):
    paths = write_tables(report(), tmp_path / "tables")
    assert [path.name for path in paths] == ["contacts.csv", "contacts.json"]
    rows = list(csv.DictReader(paths[0].read_text().splitlines()))
    assert rows[0]["RMSE exosight [N]"] == "0.0123"
    assert rows[1]["n"] == ""

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    content = json.loads(paths[1].read_text(), parse_constant=refuse)
    assert content["note"] == "A note."
    assert content["rows"][1]["n"] is None
    assert content["rows"][1]["RMSE exosight [N]"] == 0.5
    assert content["rows"][1]["RMSE exosight SD [N]"] is None


def test_table_without_rows_keeps_its_headings(tmp_path):
    empty = Table("empty", "Nothing", (Column("a"), Column("b", "N")), ())
    write_tables(report(empty), tmp_path)
    assert (tmp_path / "empty.csv").read_text() == "a,b [N]\n"


def test_tables_are_never_overwritten_nor_half_written(tmp_path):
    (tmp_path / "second.json").write_text("mine")
    with pytest.raises(DataError, match=r"second\.json"):
        write_tables(report(table("first"), table("second")), tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["second.json"]
    assert (tmp_path / "second.json").read_text() == "mine"


def test_tables_of_one_name_are_refused(tmp_path):
    with pytest.raises(InputError, match="contacts more than once"):
        write_tables(report(table(), table()), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_cloud_of_points_does_not_blow_up_the_page():
    from exosight.evaluation.figures import predicted_against_true, rainclouds

    true = np.random.default_rng(0).gamma(1.0, 0.2, (20_000, 7))
    blocks = [
        Picture(draw(published_schema(), true, true + 0.01), "c", "a")
        for draw in (predicted_against_true, rainclouds)
    ]
    # As vectors, the points alone would take over 5 MB.
    assert len(render_report(report(*blocks))) < 1_000_000
