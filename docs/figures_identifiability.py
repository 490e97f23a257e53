"""Figure and table of docs/identifiability.md, by simulation: a minute or two on two cores."""

from pathlib import Path

import numpy as np
from _parts.pages import fill, save, table_of

from exosight.evaluation.figures import identifiability_map
from exosight.evaluation.published_identifiability import (
    MATERIAL_KNOWN,
    MATERIAL_VARIES,
    resolved,
    sensitivity,
)
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.shapes import TABLE_I, ExosuitShape, Linear, Sine

HERE = Path(__file__).parent
PAGE, IMAGE = HERE / "identifiability.md", HERE / "images" / "identifiability.png"

SHAPES = {
    "taper of 5.8 to 4 mm, 100 mm long (published)": TABLE_I,
    "taper of 9.5 to 5.5 mm, 95 mm long": ExosuitShape(Linear(r0=0.0095, r1=0.0055), length=0.095),
    "waves about 7 mm, 105 mm long": ExosuitShape(Sine(r0=0.007, a=-9.0), length=0.105),
}
LOADS = np.arange(0.1, 4.01, 0.1)


def row(name: str, found: np.ndarray, forces: np.ndarray) -> list[str]:
    """Medians over the actuations with one and with two loaded contacts, and of F_net."""
    pressing = (forces > 0).sum(axis=1)
    cells = [
        np.nanmedian(found[pressing == count, :7]) if (pressing == count).any() else np.nan
        for count in (1, 2)
    ]
    cells.append(np.nanmedian(found[:, 7]))
    return [name, *("–" if np.isnan(c) else f"{1000 * c:.2f}" for c in cells)]


def main() -> None:
    """Simulate, draw, and put the table between the page's marks."""
    cases, rows = {}, []
    for name, shape in SHAPES.items():
        of = sensitivity(Exosuit(shape), LOADS)
        for words, prior in (("material known", MATERIAL_KNOWN), ("material known to 10 %", MATERIAL_VARIES)):
            found = resolved(of, prior)
            cases[f"{name}; {words}"] = found
            rows.append(row(f"{name}; {words}", found, of.forces))
    save(identifiability_map(LOADS, cases), IMAGE, dpi=110)
    heads = ("exosuit", "one loaded contact [mN]", "two loaded contacts [mN]", "F_net [mN]")
    fill(PAGE, {"resolved": table_of(heads, rows)})


if __name__ == "__main__":
    main()
