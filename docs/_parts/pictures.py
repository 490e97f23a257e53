"""Figures of a tutorial: each Matplotlib figure that a piece has put into a variable is shown below it."""

from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

_DPI = 130


def scraper(block: tuple, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save the new figures and return what shows them; Sphinx-Gallery calls this after each piece."""
    names, shown = block_vars["example_globals"], block_vars.setdefault("figures_shown", set())
    paths = []
    for figure in names.values():
        if isinstance(figure, Figure) and id(figure) not in shown:
            shown.add(id(figure))
            paths.append(next(block_vars["image_path_iterator"]))
            figure.savefig(paths[-1], dpi=_DPI, metadata={"Software": None})
    return figure_rst(paths, gallery_conf["src_dir"])
