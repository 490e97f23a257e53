"""The pages of the API reference: one a package, each module of it by its docstrings, in docs/api."""

from pathlib import Path

from sphinx.application import Sphinx

import exosight

_SOURCE = Path(exosight.__file__).parent
_START = """API
===

Every public name, from its docstring. Import a name from where it stands, or from the package itself where
it offers the name.

.. toctree::
   :titlesonly:

"""


def pages() -> dict[str, str]:
    """Name of each page and its reStructuredText."""
    folders = [_SOURCE, *sorted(path.parent for path in _SOURCE.rglob("*/__init__.py"))]
    found = {_name(folder): _page(folder) for folder in folders}
    return found | {"index": _START + "".join(f"   {name}\n" for name in found)}


def _name(path: Path) -> str:
    return ".".join(path.relative_to(_SOURCE.parent).with_suffix("").parts)


def _page(folder: Path) -> str:
    # A package's own members are those of its modules, under a shorter name: shown once, where they are.
    text = [_heading(_name(folder), "="), f".. automodule:: {_name(folder)}\n"]
    for path in sorted(folder.glob("*.py")):
        if not path.stem.startswith("_"):
            text += [_heading(path.stem, "-"), f".. automodule:: {_name(path)}\n   :members:\n"]
    return "\n".join(text)


def _heading(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}\n"


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    wanted = pages()
    for old in folder.glob("*.rst"):
        if old.stem not in wanted:
            old.unlink()
    for name, text in wanted.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text() != text:  # what has not changed is not read again
            path.write_text(text)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True}
