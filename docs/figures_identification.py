"""Figure and tables of docs/identification.md, of what its benchmarks found."""

import json
from collections.abc import Callable
from typing import Any

import figures_control as control
import numpy as np
from _parts.pages import fill, save, table_of
from jaxtyping import Float
from matplotlib.figure import Figure

from exosight.evaluation.figures.style import BLUE, GRAY, GREEN, VERMILION, new_figure, styled

HERE = control.HERE
PAGE, IMAGE = HERE / "identification.md", control.IMAGES / "identification.png"
RESULT = HERE / "results" / "identification.json"
TILTED = HERE / "results" / "identification_tilted.json"
REFINED = HERE / "results" / "refined.json"
NETWORK = HERE / "results" / "rig_network.json"
LEAST, TOUCH = 0.01, 0.001
"""Forces [N] that a zone must reach to have a correlation, and above which there is contact."""
NORMAL_95 = 1.96
SCORES = {"network": "OOD score", "refined": "disagreement score"}
PANELS = (
    ("Young's modulus [kPa]", 1e-3, ("rods.exosuit.young",)),
    ("joint stiffness [mN m/rad]", 1e3, tuple(f"links.finger_{i}.joint.stiffness" for i in range(3))),
    ("length of a link [mm]", 1e3, tuple(f"links.finger_{i}.length" for i in range(3))),
    ("roll of the camera [deg]", 180 / np.pi, ("cameras.camera.roll",)),
)
COLOURS = (BLUE, VERMILION, GREEN)
MARKERS = "os^"

Row = dict[str, Any]


def load() -> list[Row]:
    """Every case of every rig."""
    return json.loads(RESULT.read_text(encoding="utf-8"))["rows"]


def estimates(rows: list[Row], entry: str) -> Float[np.ndarray, "4 rigs"]:
    """True, found, low and high value of a parameter."""
    return np.array([row["true, found, low, high"][entry] for row in rows]).T


@styled
def picture(rows: list[Row]) -> Figure:
    """Found over true values with 95 % intervals, loads in newtons."""
    rows = [row for row in rows if row["case"] == "loads in newtons"]
    figure = new_figure(height=5.6, width=6.4)
    for axes, (name, scale, entries) in zip(figure.subplots(2, 2).flat, PANELS, strict=True):
        ends: list[float] = []
        for number, entry in enumerate(entries):
            true, found, low, high = scale * estimates(rows, entry)
            axes.errorbar(
                true,
                found,
                (found - low, high - found),
                fmt=MARKERS[number],
                color=COLOURS[number],
                markersize=3,
                linewidth=0.8,
                label=("proximal", "middle", "distal")[number] if len(entries) > 1 else None,
            )
            ends += [true.min(), true.max()]
        axes.axline((min(ends), min(ends)), slope=1, color=GRAY, linewidth=0.6, zorder=0)
        axes.set_title(name)
        axes.set_xlabel("true")
        axes.set_ylabel("found, 95 % interval")
        if len(entries) > 1:
            axes.legend()
    return figure


def table(rows: list[Row]) -> str:
    """Coverage and errors, case by case."""
    names = list(dict.fromkeys(row["case"] for row in rows))
    cases = {name: [row for row in rows if row["case"] == name] for name in names}

    def of(what: Callable[[Row], Any], digits: int = 2) -> list[str]:
        cells = []
        for chosen in cases.values():
            values = np.abs(np.concatenate([np.atleast_1d(what(row)) for row in chosen]))
            three = np.median(values), np.percentile(values, 95), values.max()
            cells.append(", ".join(f"{value:.{digits}f}" for value in three))
        return cells

    lines = [
        [
            "parameters within their 95 % interval [%]",
            *(f"{100 * inside(chosen):.1f}" for chosen in cases.values()),
        ],
        ["error of joint stiffness over modulus [%]", *of(lambda row: row["ratios [%]"])],
        [
            "rigs on which it is below 5 % for every joint",
            *(f"{sum(max(row['ratios [%]']) < 5 for row in chosen)}" for chosen in cases.values()),
        ],
        ["deviation of the distal joint by noise alone [%]", *of(distal_by_noise)],
        ["error of the camera's scale [%]", *of(lambda row: row["camera"]["scale [%]"], 3)],
        ["its position [% of the image]", *of(lambda row: row["camera"]["shift [% of the width]"])],
        ["its roll [deg]", *of(lambda row: row["camera"]["roll [deg]"], 3)],
        *(
            [
                ["its direction, pan and tilt [deg]", *of(lambda row: row["camera"]["direction [deg]"], 3)],
                ["deviation of pan and tilt by noise alone [deg]", *of(aside_by_noise, 3)],
            ]
            if all(row["camera"].get("direction [deg]") for row in rows)
            else []
        ),
        ["error of F_net at loads between the pictures' [%]", *of(lambda row: row["force [%]"])],
        ["time of one core [s]", *of(lambda row: row["CPU seconds"], 0)],
    ]
    return table_of(("median, 95th percentile, largest", *names), lines)


def distal_by_noise(row: Row) -> float:
    """Standard deviation of the stiffness of the joint that is told least [%]."""
    entry = "links.finger_2.joint.stiffness"
    return 100 * row["deviation by noise alone"][entry] / row["true, found, low, high"][entry][0]


def aside_by_noise(row: Row) -> Float[np.ndarray, "2"]:
    """Standard deviations of pan and tilt [deg]."""
    return np.rad2deg([row["deviation by noise alone"][f"cameras.camera.{name}"] for name in ("pan", "tilt")])


def inside(rows: list[Row]) -> float:
    """Share of all parameters of all rigs whose interval holds the true value."""
    return float(
        np.mean(
            [
                low <= true <= high
                for row in rows
                for true, _, low, high in row["true, found, low, high"].values()
            ]
        )
    )


def refined_table(rows: list[Row]) -> str:
    """The network alone and refined, on rigs as the model, others, and both together."""
    names = list(dict.fromkeys(row["set"] for row in rows))
    sets = {**{name: [row for row in rows if row["set"] == name] for name in names}, "all": rows}
    cells: dict[str, list[str]] = {}
    for chosen in sets.values():
        true, deviation = (np.array([row[key] for row in chosen]) for key in ("true", "deviation"))
        net, pressed = true.sum(axis=1), true.max(axis=0) > LEAST
        for key in ("network", "refined"):
            found = np.array([row[key] for row in chosen])
            r = [np.corrcoef(true[:, i], found[:, i])[0, 1] for i in np.flatnonzero(pressed)]
            both = (true > TOUCH) | (found > TOUCH)
            within = (np.abs(found - true) <= NORMAL_95 * deviation)[both].mean()
            error = found.sum(axis=1) - net
            within_net = np.abs(error) <= NORMAL_95 * np.array([row["net deviation"] for row in chosen])
            score = np.array([row[SCORES[key]] for row in chosen])
            for name, value in (
                ("r, mean over zones", f"{np.mean(r):.3f}"),
                ("r of F_net", f"{np.corrcoef(net, found.sum(axis=1))[0, 1]:.3f}"),
                ("RMSE of a zone [mN]", f"{1e3 * np.sqrt(np.mean((found - true) ** 2)):.1f}"),
                ("RMSE of F_net [mN]", f"{1e3 * np.sqrt(np.mean(error**2)):.1f}"),
                ("zones within 1.96 deviations [%]", f"{100 * within:.0f}" if key == "refined" else "–"),
                ("F_net within [%]", f"{100 * within_net.mean():.0f}" if key == "refined" else "–"),
                ("flagged: OOD score, disagreement [%]", f"{100 * (score > 1).mean():.0f}"),
            ):
                cells.setdefault(name, []).append(value)
    heads = [f"{name}: {key}" for name in sets for key in ("network", "refined")]
    return table_of(("", *heads), [[name, *values] for name, values in cells.items()])


def network_table(rows: list[Row]) -> str:
    """The shipped network and one of the identified rig, on rigs of each joint stiffness and all together."""
    stiffnesses = list(dict.fromkeys(row["joints"] for row in rows))
    sets = {
        f"joints × {joints:g}": [row for row in rows if row["joints"] == joints] for joints in stiffnesses
    }
    cells: dict[str, list[str]] = {}
    for chosen in (*sets.values(), rows):
        true = np.array([row["true"] for row in chosen])
        net, pressed = true.sum(axis=1), true.max(axis=0) > LEAST
        for key in ("before", "after"):
            found, low, high = (np.array([row[key][of] for row in chosen]) for of in ("force", "low", "high"))
            r = [np.corrcoef(true[:, i], found[:, i])[0, 1] for i in np.flatnonzero(pressed)]
            both = (true > TOUCH) | (found > TOUCH)
            error = found.sum(axis=1) - net
            score = np.array([row[key]["OOD score"] for row in chosen])
            for name, value in (
                ("r, mean over zones", f"{np.mean(r):.3f}"),
                ("r of F_net", f"{np.corrcoef(net, found.sum(axis=1))[0, 1]:.3f}"),
                ("RMSE of a zone [mN]", f"{1e3 * np.sqrt(np.mean((found - true) ** 2)):.1f}"),
                ("RMSE of F_net [mN]", f"{1e3 * np.sqrt(np.mean(error**2)):.1f}"),
                ("F_net estimated over true", f"{np.dot(found.sum(axis=1), net) / np.dot(net, net):.2f}"),
                (
                    "zones within 90 % intervals [%]",
                    f"{100 * ((low <= true) & (true <= high))[both].mean():.0f}",
                ),
                ("flagged by the OOD score [%]", f"{100 * (score > 1).mean():.0f}"),
            ):
                cells.setdefault(name, []).append(value)
    heads = [f"{name}: {key}" for name in (*sets, "all") for key in ("shipped", "own")]
    lines = [[name, *values] for name, values in cells.items()]
    return table_of(("", *heads), lines)


def main() -> None:
    """Draw, and write the tables into the page."""
    rows = load()
    save(picture(rows), IMAGE)
    refined = json.loads(REFINED.read_text(encoding="utf-8"))["rows"]
    network = json.loads(NETWORK.read_text(encoding="utf-8"))["rows"]
    tables = {"rigs": table(rows), "network": network_table(network), "refined": refined_table(refined)}
    if TILTED.exists():
        tables["tilted"] = table(json.loads(TILTED.read_text(encoding="utf-8"))["rows"])
    fill(PAGE, tables)


if __name__ == "__main__":
    main()
