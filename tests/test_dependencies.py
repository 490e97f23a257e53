"""docs/licences.md lists all that exosight asks for, at the versions of the lock file."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")


@pytest.fixture
def dependencies(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    monkeypatch.delitem(sys.modules, "dependencies", raising=False)
    import dependencies

    return dependencies


def rows() -> dict[str, list[str]]:
    """name: version, licence, MiB, needed by."""
    cells = [
        line.strip("| ").split(" | ") for line in PAGE.partition("## Licences")[2].splitlines() if "|" in line
    ]
    return {row[0].strip("*"): row[1:] for row in cells[2:]}


def test_every_direct_dependency_states_its_licence(dependencies) -> None:
    listed = rows()
    for extra, names in dependencies.direct().items():
        assert re.search(rf"^\| {extra} \|", PAGE, flags=re.MULTILINE), extra
        for name in names:
            assert name in listed, f"{name} of {extra}; run python tools/dependencies.py"
            assert listed[name][1] not in ("", "not stated"), name


def test_versions_are_those_of_the_lock_file(dependencies) -> None:
    pins = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line
    )
    locked = {dependencies.canonicalize_name(name): version for name, version in pins.items()}
    for name, row in rows().items():
        assert locked.get(name) == row[0], name


def test_the_page_is_made_from_metadata(dependencies) -> None:
    needed = dependencies.closure(["h5py"])
    assert needed == {"h5py", "numpy"}
    page = dependencies.page({"core": ["h5py"]}, {"core": needed})
    assert "| **h5py** |" in page
    assert "| numpy |" in page
    assert dependencies.licence(dependencies.distribution("h5py"))
    assert dependencies.size(dependencies.distribution("h5py")) > 1e6
