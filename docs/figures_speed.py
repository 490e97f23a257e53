"""How cost grows, and what evaluations cost in other ways: a figure and tables of docs/benchmarks.md.

`python docs/figures_speed.py` shows what docs/results holds of `benchmarks.scaling`, `.interpreters` and
`.own_terms`, which `make bench` measures anew.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _parts.pages import fill, machine, save, table_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from exosight.evaluation.figures.style import BLACK, BLUE, GREEN, PURPLE, VERMILION, new_figure, styled

HERE = Path(__file__).parent
PAGE, RESULTS, IMAGES = HERE / "benchmarks.md", HERE / "results", HERE / "images"
NAMES = ("scaling", "interpreters", "own_terms")

Lines = dict[str, tuple[Sequence[float], Sequence[float]]]
"""Sizes and costs by what costs."""

LOOKS = {
    "evaluation": (BLUE, "o"),
    "evaluation by XLA": (VERMILION, "s"),
    "equilibrium": (GREEN, "^"),
    "making the program": (PURPLE, "D"),
    "first call": (BLACK, "v"),
    "all equilibria, 1 thread": (BLUE, "o"),
}
AXES = {"dofs": "coordinates of a chain [-]", "contacts": "contact spheres [-]", "robots": "robots [-]"}


def load() -> dict[str, Any]:
    """The measured numbers, by name."""
    return {name: json.loads((RESULTS / f"{name}.json").read_text()) for name in NAMES}


def lines(scaling: dict[str, Any]) -> dict[str, Lines]:
    """What grows along each axis; CPU times [s]."""
    names = {
        "evaluation": ("evaluation by program [us]", 1e-6),
        "evaluation by XLA": ("evaluation by xla [us]", 1e-6),
        "equilibrium": ("equilibrium [us]", 1e-6),
        "making the program": ("making [s]", 1.0),
        "first call": ("first call [s]", 1.0),
    }
    found: dict[str, Lines] = {}
    for axis in ("dofs", "contacts"):
        found[axis] = {}
        for label, (key, unit) in names.items():
            rows = [row for row in scaling[axis] if key in row]
            if rows:
                found[axis][label] = [row["size"] for row in rows], [unit * row[key] for row in rows]
    found["robots"] = {}
    for threads in sorted({row["threads"] for row in scaling["robots"]}):
        rows = [row for row in scaling["robots"] if row["threads"] == threads]
        found["robots"][f"all equilibria, {threads} thread{'s' if threads > 1 else ''}"] = (
            [row["robots"] for row in rows],
            [1e-6 * row["equilibrium, wall [us]"] * row["robots"] * scaling["loads"] for row in rows],
        )
    return found


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> tuple[float, float, float]:
    """p of cost ∝ sizeᵖ, by least squares in logarithms, and the least and largest between neighbours."""
    x, y = np.log(sizes), np.log(costs)
    between = np.diff(y) / np.diff(x)
    return float(np.polyfit(x, y, 1)[0]), float(between.min()), float(between.max())


def grown(sizes: Sequence[float], costs: Sequence[float]) -> str:
    """The exponent, with the least and the largest between neighbours."""
    whole, least, most = exponent(sizes, costs)
    return f"{whole:.2f} ({least:.2f}–{most:.2f})"


@styled
def figure(scaling: dict[str, Any]) -> Figure:
    """Time against size in logarithms, one panel an axis, exponents in the legends."""
    drawn = new_figure(height=3.6)
    panels = drawn.subplots(1, 3)
    for ax, (axis, own) in zip(panels, lines(scaling).items(), strict=True):
        for label, (x, y) in own.items():
            colour, marker = LOOKS.get(label, (VERMILION, "s"))
            power = exponent(x, y)[0]
            text = f"{label}: {power:.1f}"
            ax.loglog(x, y, color=colour, marker=marker, markersize=4, label=text)
        _finish(ax, axis, next(x for x, _ in own.values()))
    panels[0].set_ylabel("CPU time [s]")
    panels[2].set_ylabel("time [s]")
    return drawn


def _finish(ax: Axes, axis: str, sizes: Sequence[float]) -> None:
    ax.set_xlabel(AXES[axis])
    ax.minorticks_off()
    if axis != "robots":
        ax.set_xticks(list(sizes), [f"{size:g}" for size in sizes])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.grid(axis="y")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), title="time of: exponent", title_fontsize=7.5)


def tables(found: dict[str, Any]) -> dict[str, str]:
    """Those of the page, by the name of their place."""
    scaling = found["scaling"]
    grows = [
        (axis_name, label, grown(*own))
        for axis, axis_name in (("dofs", "coordinates"), ("contacts", "contacts"), ("robots", "robots"))
        for label, own in lines(scaling)[axis].items()
        if len(own[0]) > 2
    ]
    return {
        "exponents": table_of(("size", "time of", "exponent (between neighbours)"), grows),
        "scaling_dofs": _sizes("coordinates", scaling["dofs"]),
        "scaling_contacts": _sizes("contacts", scaling["contacts"]),
        "scaling_robots": table_of(
            ("robots", "threads", "equilibrium, wall clock [µs]", "equilibrium, CPU [µs]"),
            [
                (
                    f"{row['robots']:,}",
                    str(row["threads"]),
                    _digits(row["equilibrium, wall [us]"]),
                    _digits(row["equilibrium, CPU [us]"]),
                )
                for row in scaling["robots"]
            ],
        ),
        "speed_machine": f"{machine(found['scaling'])}; CasADi {found['interpreters']['casadi']}.",
        "interpreters": _interpreters(found["interpreters"]["rows"]),
        "own_terms": _own_terms(found["own_terms"]["rows"]),
    }


def _digits(value: float) -> str:
    """Three of them."""
    return f"{value:.3g}" if value < 1000 else f"{float(f'{value:.3g}'):,.0f}"


def _sizes(name: str, rows: Sequence[dict[str, Any]]) -> str:
    keys = {
        "words": "words of code",
        "making [s]": "program made [s]",
        "first call [s]": "first call [s]",
        "memory [MiB]": "memory [MiB]",
        "evaluation by program [us]": "evaluation [µs]",
        "evaluation by xla [us]": "by XLA [µs]",
        "compiling by XLA [s]": "compiled by XLA [s]",
        "equilibrium [us]": "equilibrium [µs]",
        "evaluations an equilibrium": "evaluations an equilibrium",
    }
    keys = {key: title for key, title in keys.items() if any(key in row for row in rows)}
    cells = [(str(row["size"]), *(_digits(row[key]) if key in row else "–" for key in keys)) for row in rows]
    return table_of((name, *keys.values()), cells)


def _interpreters(rows: Sequence[dict[str, Any]]) -> str:
    cells = [
        (row["way"], _digits(row["evaluation [us]"]), f"{row['ratio']:.2f}", f"{row['difference']:.0e}")
        for row in rows
    ]
    return table_of(("way", "evaluation [µs]", "ratio", "difference from XLA"), cells)


def _own_terms(rows: Sequence[dict[str, Any]]) -> str:
    cells = [
        (
            row["term"],
            str(row["frames"]),
            *(_digits(row["evaluation [us]"][way]) for way in ("automatic", "by hand", "without")),
            f"{row['ratio']:.2f}",
            *(_digits(row["equilibrium [us]"][way]) for way in ("automatic", "by hand")),
            f"{row['ratio of equilibria']:.2f}",
            f"{row['difference']:.0e}",
        )
        for row in rows
    ]
    evaluation = ("evaluation, automatic [µs]", "by hand [µs]", "without the term [µs]", "ratio")
    equilibrium = ("equilibrium, automatic [µs]", "by hand [µs]", "ratio", "difference")
    return table_of(("term", "frames", *evaluation, *equilibrium), cells)


def main() -> None:
    """Draw, and put the tables into the page."""
    found = load()
    save(figure(found["scaling"]), IMAGES / "benchmarks_scaling.png")
    fill(PAGE, tables(found))


if __name__ == "__main__":
    main()
