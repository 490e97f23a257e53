"""Docstrings are plain text with aligned tables of shapes and units; Sphinx reads reStructuredText.

Paragraphs stay paragraphs, and whatever is aligned or indented is shown as it stands.
"""

import re
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx


def to_restructured(text: str) -> str:
    """The docstring as reStructuredText that shows the same.

    text   without the indentation that it has in the source
    """
    return "\n\n".join(_block(paragraph) for paragraph in re.split(r"\n\s*\n", text.strip("\n")))


def _block(paragraph: str) -> str:
    lines = paragraph.splitlines()
    if any(re.search(r"^\s|\S {2,}\S", line) for line in lines):
        return "::\n\n" + "\n".join(f"    {line}" for line in lines)
    parts = re.split(r"`+([^`]*)`+", paragraph.strip())
    # Every second part stood in backticks. "\ " ends markup without showing anything.
    return "".join(
        rf"\ ``{part}``\ " if odd else re.sub(r"([\\*|_<>])", r"\\\1", part)
        for part, odd in zip(parts, (i % 2 for i in range(len(parts))), strict=True)
        if part
    )


def _process(app: Sphinx, what: str, name: str, object_: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [*to_restructured("\n".join(lines)).splitlines(), ""]


def _unlink(app: Sphinx, tree: nodes.document) -> None:
    """Take the links out of signatures: a type `range` would lead to a field of that name, of any class."""
    for link in list(tree.findall(pending_xref)):
        if link.get("refdomain") == "py":
            link.replace_self(link.children)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("autodoc-process-docstring", _process)
    app.connect("doctree-read", _unlink)
    return {"parallel_read_safe": True}
