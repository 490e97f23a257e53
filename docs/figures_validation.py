"""Figures and tables of docs/validation.md, from the numbers in docs/results.

`make figures` computes convergence anew and then runs this; `make compare` times the other programs first.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _parts.pages import fill, machine, save, table_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator

from exosight.evaluation.figures.style import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    VERMILION,
    legend_above,
    new_figure,
    styled,
)

HERE = Path(__file__).parent
PAGE, RESULTS, IMAGES = HERE / "validation.md", HERE / "results", HERE / "images"
NAMES = ("balance", "belt", "convergence", "neighbours", "processor", "rigid", "sorosim")

PROBLEMS = {
    "cantilever": "error of the tip / length [-]",
    "contact": "error of the contact force [-]",
    "motion in a plane": "error of coordinates [-]",
    "motion in space": "error of coordinates [-]",
    "motion in space, slender": "error of coordinates [-]",
}
LOOKS = {"exosight": (BLUE, "o"), "PyElastica": (VERMILION, "s"), "SoRoMoX": (GREEN, "^")}

SOROSIM = {
    "cantilever[sorosim_cantilever_nodal": "cantilever, nodal quadratic",
    "cantilever[sorosim_cantilever_legendre": "cantilever, Legendre",
    "tapered_rod": "tapered rod, actuation line on its surface",
    "spatial_cantilever": "six strains, dead and follower wrench",
    "hinged_chain": "hinged chain",
    "contact": "rod on a chain, contact",
    "released_cantilever": "released cantilever, 1 s",
}
"""Prefix of a test's name, and its label on the page."""


def load() -> dict[str, Any]:
    """The measured numbers, by name."""
    return {name: json.loads((RESULTS / f"{name}.json").read_text()) for name in NAMES}


@styled
def convergence(found: dict[str, Any]) -> Figure:
    """Error against basis and steps, Newton's residuals, and iterations per equilibrium."""
    figure = new_figure(height=5.0)
    (basis, steps), (newton, histogram) = figure.subplots(2, 2)
    looks = zip((BLUE, VERMILION, GREEN, BLACK), "os^D", strict=True)
    for (name, line), (colour, marker) in zip(found["basis"].items(), looks, strict=True):
        basis.loglog(
            line["coordinates"], line["error"], color=colour, marker=marker, markersize=4, label=name
        )
    basis.set(xlabel="coordinates [-]", ylabel="error of the tip / length [-]", title="Strain basis")
    basis.set_xticks([1, 2, 4, 8, 16, 24], ["1", "2", "4", "8", "16", "24"])
    looks = zip((BLUE, VERMILION, GREEN), "os^", strict=True)
    for (name, line), (colour, marker) in zip(found["steps"].items(), looks, strict=True):
        steps.loglog(line["steps"], line["error"], color=colour, marker=marker, markersize=4, label=name)
    guide = np.array([6.0, 192.0])
    steps.loglog(guide, 1e-3 * (guide / 6) ** -4, "--", color=GRAY, label="fourth order")
    steps.set(
        xlabel="Magnus steps [-]",
        ylabel="error of the tip / length [-]",
        title="Magnus steps between quadrature points",
    )
    steps.set_xticks([6, 12, 24, 48, 96, 192], ["6", "12", "24", "48", "96", "192"])
    looks = zip((BLUE, VERMILION), "os", strict=True)
    for (name, line), (colour, marker) in zip(found["newton"].items(), looks, strict=True):
        count = np.arange(1, len(line) + 1)
        newton.semilogy(count, line, color=colour, marker=marker, markersize=4, label=name)
    newton.set(xlabel="Newton iteration [-]", ylabel="residual [-]", title="Newton's method")
    _histogram(histogram, found["iterations"])
    for ax in (basis, steps, newton):
        ax.legend()
    for ax in (basis, steps, newton):
        ax.minorticks_off()
        ax.grid(axis="y")
    return figure


def _histogram(ax: Axes, found: dict[str, Any], most: int = 16) -> None:
    """Share of equilibria by Newton steps, all above `most` in the last bar."""
    counts = np.array(found["counts"], dtype=float)
    shares = 100 * np.append(counts[1:most], counts[most:].sum()) / counts.sum()
    ax.bar(np.arange(1, most + 1), shares, color=BLUE, width=0.8)
    ax.axvline(found["median"], color=VERMILION, label=f"median {found['median']:.0f}")
    ax.axvline(found["mean"], color=BLACK, linestyle="--", label=f"mean {found['mean']:.1f}")
    ax.set(
        xlabel="Newton iterations per equilibrium [-]",
        ylabel="share of equilibria [%]",
        title="The paper's path 0 → 4 → 0 N",
    )
    ax.set_xticks([1, 4, 8, 12, 16], ["1", "4", "8", "12", "≥ 16"])
    ax.legend()


@styled
def neighbours(rows: Sequence[dict[str, Any]]) -> Figure:
    """Error against time, one panel per problem: lower and further left is better."""
    figure = new_figure(height=4.6)
    panels = figure.subplots(2, 3)
    lines = {}
    for ax, (problem, label) in zip(panels.flat, PROBLEMS.items(), strict=False):
        for program, (colour, marker) in LOOKS.items():
            own = [r for r in rows if (r["problem"], r["program"]) == (problem, program)]
            if own:
                aside = [r for r in own if "off" in r["setting"]]
                own = [r for r in own if r not in aside]
                xy = np.array([(r["seconds"], r["error"]) for r in own])
                (lines[program],) = ax.loglog(*xy.T, color=colour, marker=marker, markersize=4)
                for row in aside:
                    ax.loglog(
                        row["seconds"], row["error"], marker, color=colour, fillstyle="none", markersize=4
                    )
        ax.set(title=problem, xlabel="time [s]", ylabel=label)
        ax.margins(0.15)
        low, high = ax.get_xlim()
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 50 * low else (1,)))
        ax.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        ax.grid(which="major")
        ax.minorticks_off()
    panels[1, 2].set_axis_off()
    panels[1, 2].text(
        0.0,
        0.75,
        "Each point is one setting of one program:\nelements, tolerance or step, see the table.\n"
        "Lower and further left is better.\n\nMotions: the reference is SoRoMoX\nwith a finer step.\n\n"
        "Open square: sphere off the middle\nof an element.",
        va="top",
        transform=panels[1, 2].transAxes,
    )
    legend_above(figure, list(lines.values()), list(lines))
    return figure


def tables(found: dict[str, Any]) -> dict[str, str]:
    """The page's tables, by name."""
    lines = found["convergence"]
    return {
        "elastica": table_of(
            ["α = P L²/EI", "x/L", "z/L", *(f"error, {n} elements" for n in lines["elastica"]["error"])],
            [
                [f"{load:g}", f"{x:.8f}", f"{z:.8f}", *(_power(e) for e in errors)]
                for load, (x, z), *errors in zip(
                    lines["elastica"]["loads"],
                    lines["elastica"]["tip"],
                    *lines["elastica"]["error"].values(),
                    strict=True,
                )
            ],
        ),
        "processor": table_of(["comparison of the two datasets", ""], _processor(found["processor"])),
        "sorosim": table_of(["case", "tolerance", "largest difference"], _sorosim(found["sorosim"])),
        "basis": table_of(
            ["basis", "coordinates", "error of the tip / length", "order in the elements"],
            [
                [name, _list(line["coordinates"]), _powers(line["error"]), _orders(line, "elements")]
                for name, line in lines["basis"].items()
            ],
        ),
        "steps": table_of(
            ["case", "steps", "tip error / length", "order"],
            [
                [name, _list(line["steps"]), _powers(line["error"]), _orders(line, "steps")]
                for name, line in lines["steps"].items()
            ],
        ),
        "newton": table_of(
            ["residual of", "after each iteration"],
            [[name, _powers(line)] for name, line in lines["newton"].items()],
        ),
        "iterations": _iterations(lines["iterations"]),
        "balance": table_of(
            [
                "what dissipates, step [N]",
                "work [mJ]",
                "lost in snaps [mJ]",
                "otherwise [mJ]",
                "snaps",
                *(f"exosuit {i + 1}" for i in range(found["balance"]["shapes"])),
            ],
            [
                [
                    name,
                    *(
                        f"{line[key]:.4f}"
                        for key in ("work [mJ]", "lost in snaps [mJ]", "lost otherwise [mJ]")
                    ),
                    str(line["snaps"]),
                    *map(_power, line["difference of each path, relative"]),
                ]
                for name, line in _balances(found["balance"])
            ],
        ),
        **{
            f"{name}{part}": text
            for name in ("neighbours", "belt", "rigid")
            for part, text in _compared(found[name]).items()
        },
    }


def _balances(found: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Rows by name: each kind in its steps."""
    names = {"friction": "friction", "creep": "creep", "both": "friction and creep"}
    return [
        (f"{name}, {line['step [N]']:g}", line) for key, name in names.items() for line in found["kinds"][key]
    ]


def _compared(found: dict[str, Any]) -> dict[str, str]:
    """Table of a comparison of programs, and what it ran on."""
    own = found["machine"]
    return {
        "": table_of(
            ["problem", "program", "setting", "error", "time [s]", "processor time [s]", "first call [s]"],
            [
                [
                    *(row[key] for key in ("problem", "program", "setting")),
                    _power(row["error"]),
                    *(f"{row[key]:.2g}" for key in ("seconds", "processor_seconds", "first_seconds")),
                ]
                for row in found["rows"]
            ],
        ),
        "_machine": f"{machine(own)}. {', '.join(f'{k} {v}' for k, v in own['versions'].items())}.",
    }


def _power(value: float) -> str:
    return f"{value:.1e}"


def _powers(values: Sequence[float]) -> str:
    return ", ".join(map(_power, values))


def _list(values: Sequence[int]) -> str:
    return ", ".join(map(str, values))


def _orders(line: dict[str, list], along: str) -> str:
    """Orders between neighbours, −d log error / d log count; none for polynomials of one piece."""
    if along not in line:
        return "exponential"
    slopes = -np.diff(np.log(line["error"])) / np.diff(np.log(line[along]))
    return ", ".join(f"{slope:.1f}" for slope in slopes)


def _sorosim(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """The largest difference of each case and tolerance; those of points along the rod, 1e-15, left out."""
    largest: dict[tuple[str, float], float] = {}
    for row in rows:
        name = next(label for start, label in SOROSIM.items() if row["test"].startswith(f"test_{start}"))
        if row["tolerance"] > 1e-15:
            key = name, row["tolerance"]
            largest[key] = max(largest.get(key, 0.0), row["difference"])
    return [[name, _power(allowed), _power(value)] for (name, allowed), value in largest.items()]


def _processor(found: dict[str, Any]) -> list[list[str]]:
    """The comparison written by benchmarks/processor.py, with the frames that each dataset keeps."""
    kept = " and ".join(str(frames) for frames in found["frames"])
    same = "the same" if found["same shape, u and direction"] else "different"
    return [
        ["frames kept", f"{kept}: {same}"],
        ["images that differ", str(found["pictures that differ"])],
        ["largest difference of a force [N]", _power(found["largest difference of a force [N]"])],
        ["largest difference of a coordinate [-]", _power(found["largest difference of a coordinate"])],
        ["files with the same checksum", f"{found['chunks of the same checksum']} of {found['chunks']}"],
        ["same identity", "yes" if found["same identity"] else "no"],
    ]


def _iterations(found: dict[str, Any]) -> str:
    return (
        f"{found['shapes']} shapes of all eleven scenarios × {found['loads']} loads: median "
        f"{found['median']:.0f}, mean {found['mean']:.1f} iterations per equilibrium, "
        f"{100 * found['converged']:.3g} % converged."
    )


def main() -> None:
    """Draw the figures and fill in the page."""
    found = load()
    figures = {
        "validation_convergence": convergence(found["convergence"]),
        "validation_neighbours": neighbours(found["neighbours"]["rows"]),
    }
    for name, figure in figures.items():
        save(figure, IMAGES / f"{name}.png", dpi=200)
    fill(PAGE, tables(found))


if __name__ == "__main__":
    main()
