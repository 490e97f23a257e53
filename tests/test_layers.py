"""Imports point one way: a folder of `src` knows only those above it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "exosight"
ORDER = (
    *("lie", "scalar_program", "mechanics", "system", "exosuit", "vision", "dataset", "rig", "learning"),
    *("evaluation", "control", "environment", "lab", "app"),
)
SHARED = {"arrays", "call_stack", "errors", "files", "hdf5", "validation"}
"""Modules that every folder may use."""


def imported(path: Path) -> Iterator[str]:
    """The folders of the package that a file imports from, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            inside = node.module == "exosight"
            names = [f"exosight.{alias.name}" for alias in node.names] if inside else [node.module]
        yield from (name.split(".")[1] for name in names if name.startswith("exosight."))


@pytest.mark.parametrize("place", range(len(ORDER)), ids=ORDER)
def test_a_folder_knows_only_those_above_it(place: int) -> None:
    folder = SOURCE / ORDER[place]
    for path in sorted(folder.rglob("*.py")) or [folder.with_suffix(".py")]:
        above = {*ORDER[: place + 1], *SHARED}
        # What is no folder is the package's own: its version.
        below = {name for name in imported(path) if name in ORDER} - above
        assert not below, f"{path.relative_to(SOURCE)} imports {', '.join(sorted(below))}"
