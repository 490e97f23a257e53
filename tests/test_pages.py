"""Every page with numbers shows those on file."""

from types import ModuleType

import figures_accuracy
import figures_control
import figures_speed
import figures_stress
import figures_surface_contact
import figures_validation
import pytest
import tables
from _parts.pages import filled


@pytest.mark.parametrize(
    "maker",
    [
        figures_accuracy,
        figures_control,
        figures_speed,
        figures_stress,
        figures_surface_contact,
        figures_validation,
    ],
)
def test_pages_show_the_numbers_of_their_files(maker: ModuleType) -> None:
    page = maker.PAGE.read_text(encoding="utf-8")
    assert filled(page, maker.tables(maker.load())) == page


def test_tables_are_those_of_the_benchmarks_and_of_the_network() -> None:
    for path, found in tables.tables().items():
        page = path.read_text(encoding="utf-8")
        assert filled(page, found) == page


def test_a_page_without_a_place_is_refused() -> None:
    with pytest.raises(ValueError, match="no place for speed"):
        filled("<!-- size -->\n<!-- end -->", {"speed": "| 1 |"})
