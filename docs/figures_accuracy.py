"""Tables and figures of docs/accuracy.md, from docs/results/accuracy/*.json; the numbers:

DATA is `exosight generate --per-scenario 125`; each NAME.json but the last is
`exosight evaluate --model results/NAME/model.onnx --data DATA --json docs/results/accuracy/NAME.json`, after

shape              nothing: --model src/exosight/models/light.onnx
frame              exosight train --data DATA --out results/frame --protocol frame --recipe clean --epochs 80
paper              … --protocol frame --network paper --epochs 2
without_FAMILY     … --extra-data SEED1 SEED2 SEED3 --epochs 2 --protocol family --held-out FAMILY
seed_N             … --epochs 9 --seed N --split-seed N
long_N             … --extra-data SEED1 SEED2 SEED3 --epochs 6 --seed N --split-seed N
shifts             python -m benchmarks.shifts DATA
adapted_NAME       see benchmarks/adapted.py
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _parts.pages import fill, save, table_of
from matplotlib.figure import Figure

from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
from exosight.evaluation.figures.style import BLACK, BLUE, GREEN, ORANGE, VERMILION, new_figure, styled
from exosight.evaluation.published import CONTACTS_PUBLISHED
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.published import published
from exosight.exosuit.shapes import FAMILIES, ExosuitShape, Linear
from exosight.exosuit.simulation import simulate
from exosight.vision.scene import picture as seen

CONTACTS = tuple(contact.name for contact in CONTACTS_PUBLISHED)

HERE = Path(__file__).parent
PAGE, RESULTS = HERE / "accuracy.md", HERE / "results" / "accuracy"
IMAGE, SHARES = HERE / "images" / "accuracy.png", HERE / "images" / "shares.png"
SHARES_SHAPE = ExosuitShape(Linear(0.01, 0.0087), 0.109)
"""One of the test exosuits with the largest error of C7."""
CASES = ("clean", "noise, low", "noise, medium", "noise, high", "contrast, low", "contrast, high")
IMAGES = ("clean", "noise 0.001", "noise 0.01", "noise 0.1", "low contrast", "high contrast")
PROTOCOLS = {
    "shape": "by shape, shipped network",
    "frame": "by frame, clean images, 80 epochs",
    **{f"without_{family}": f"family {family.replace('_', '-')} held out" for family in FAMILIES},
}
SHORT, LONG = (tuple(f"{kind}_{seed}" for seed in range(3)) for kind in ("seed", "long"))
DEGRADED = {
    "shape": "shipped (trained with noise and contrast), by shape",
    "frame": "light, clean images only, by frame",
    "paper": "paper's network, clean images only, 2 epochs, by frame",
}

HELD_OUT = {
    "adapted_stiffness": {
        "shipped": "stiffer exosuits, 1.6 to 2 times: shipped network",
        "held_out": "fine-tuned on 0.5 to 1.6 times",
    },
    "adapted_cameras": {
        "shipped": "nearer cameras, by 5 to 8 %: shipped network",
        "held_out": "fine-tuned on cameras 8 % farther to 5 % nearer",
    },
}
ADAPTED = {
    "adapted_other": {
        "shipped": "another set-up: shipped network",
        "adapted": "fine-tuned, 4 epochs",
        "anew": "from random weights, 4 epochs",
    },
    "adapted_many": {
        "shipped": "many cameras: shipped network",
        "adapted": "fine-tuned, 8 epochs",
    },
}

Found = Mapping[str, Any]


def load() -> dict[str, Any]:
    """Every file of numbers, by name."""
    return {path.stem: json.loads(path.read_text()) for path in sorted(RESULTS.glob("*.json"))}


def tables(found: Found) -> dict[str, str]:
    """The page's tables, by name."""
    return {
        "protocols": _protocols(found),
        "contacts": _contacts(found),
        "seeds": _seeds(found, SHORT),
        "longer": _seeds(found, LONG),
        "degraded": _degraded(found),
        "details": _details(found["shape"]),
        "baselines": _baselines(found["shape"]),
        "coverage": _coverage(found["shape"]),
        "shifts": _shifts(found["shifts"]),
        "held_out": _networks(found, HELD_OUT),
        "adapted": _networks(found, ADAPTED),
    }


def _networks(found: Found, asked: Mapping[str, Mapping[str, str]]) -> str:
    """Networks on images of another set-up."""
    rows = {
        words: found[name][network] for name, labels in asked.items() for network, words in labels.items()
    }
    return _shifts(rows, "images and network")


def of_contacts(result: Found, column: str) -> np.ndarray:
    """One quantity of C1…C7."""
    return np.array([row[column] for row in result["contacts"] if row["contact"] in CONTACTS], float)


def _protocols(found: Found) -> str:
    rows = []
    for name, words in PROTOCOLS.items():
        result = found[name]
        r = of_contacts(result, "r exosight")
        rows.append(
            [
                words,
                result["frames"].split()[0],
                f"{np.nanmean(r):.4f}",
                f"{np.nanmin(r):.3f}",
                f"{np.nanmean(of_contacts(result, 'RMS% exosight [%]')):.2f}",
                f"{1e3 * np.nanmean(of_contacts(result, 'RMSE exosight [N]')):.1f}",
            ]
        )
    # The means as printed in the paper; means of its rounded contacts differ in the last digit.
    paper = found["shape"]["robustness"][0]
    lowest = np.nanmin(of_contacts(found["shape"], "r paper"))
    means = (f"{paper['RMS% paper [%]']:.2f}", f"{1e3 * paper['RMSE paper [N]']:.0f}")
    rows.append(["paper, by frame", "–", f"{paper['r paper']:.2f}", f"{lowest:.2f}", *means])
    heads = ("split and network", "test frames", "r, mean", "r, lowest", "RMS% of range", "RMSE [mN]")
    return table_of(heads, rows)


def _contacts(found: Found) -> str:
    rows = [[words, *_digits(of_contacts(found[name], "r exosight"), 4)] for name, words in PROTOCOLS.items()]
    rows.append(["paper", *_digits(of_contacts(found["shape"], "r paper"), 2)])
    return table_of(("r", *CONTACTS), rows)


def _seeds(found: Found, runs_of: Sequence[str]) -> str:
    rows = []
    for words, column, factor, digits in (
        ("r", "r exosight", 1.0, 3),
        ("RMS% of range", "RMS% exosight [%]", 1.0, 2),
        ("RMSE [mN]", "RMSE exosight [N]", 1e3, 1),
    ):
        runs = factor * np.array([of_contacts(found[name], column) for name in runs_of])
        runs = np.column_stack([runs, runs.mean(axis=1)])
        both = zip(runs.mean(axis=0), runs.std(axis=0, ddof=1), strict=True)
        rows.append([words, *(f"{mean:.{digits}f} ± {spread:.{digits}f}" for mean, spread in both)])
    return table_of(("mean ± SD of three runs", *CONTACTS, "mean"), rows)


def _degraded(found: Found) -> str:
    def means(name: str, column: str) -> list[str]:
        cases = {row["images"]: row for row in found[name]["robustness"]}
        return _digits([cases[case][column] for case in CASES], 3)

    rows = [[words, *means(name, "r exosight")] for name, words in DEGRADED.items()]
    rows.append(["paper", *means("shape", "r paper")])
    return table_of(("mean r", *IMAGES), rows)


def _details(result: Found) -> str:
    columns = list(result["details"][0])
    rows = [
        [row["contact"], *(_number(row[column], column) for column in columns[1:])]
        for row in result["details"]
    ]
    return table_of([column.replace("[N]", "[mN]") for column in columns], rows)


def _number(value: float, column: str) -> str:
    return f"{1e3 * value:.1f}" if column.endswith("[N]") else f"{value:.4f}"


def _baselines(result: Found) -> str:
    columns = ("r exosight", "RMS% exosight [%]")
    rows = [
        [row["estimator"], *("–" if row[c] is None else f"{row[c]:.3f}" for c in columns)]
        for row in result["baselines"]
    ]
    return table_of(("estimator", "r, mean", "RMS% of range"), rows)


def _coverage(result: Found) -> str:
    own = [row for row in result["intervals"] if row["promised [%]"] == 90.0]
    rows = [
        [f"{frames} [%]", *_digits([row[f"inside {frames} [%]"] for row in own], 1)]
        for frames in ("estimate above zero", "all frames")
    ]
    return table_of(("coverage of 90 % intervals", *(row["contact"] for row in own)), rows)


def _shifts(result: Found, first: str = "change") -> str:
    rows = [
        [
            name,
            f"{row['r']:.3f}",
            f"{row['rms_percent']:.1f}",
            f"{1e3 * row['net_rmse']:.0f}",
            f"{row['inside_percent']:.0f}",
            f"{row['flagged_percent']:.0f}",
            "–" if row["net_rmse_trusted"] is None else f"{1e3 * row['net_rmse_trusted']:.0f}",
        ]
        for name, row in result.items()
    ]
    heads = (
        first,
        "r, mean",
        "RMS% of range",
        "RMSE of F_net [mN]",
        "coverage of 90 % intervals [%]",
        "flagged as OOD [%]",
        "RMSE of F_net, not flagged [mN]",
    )
    return table_of(heads, rows)


def _digits(values: Iterable[float], digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]


@styled
def picture(found: Found) -> Figure:
    """r of each contact, by protocol, beside the paper's."""
    figure = new_figure(height=3.4, width=7.2)
    axes = figure.subplots()
    lines: Sequence[tuple[str, np.ndarray, str, str]] = (
        ("by shape, shipped", of_contacts(found["shape"], "r exosight"), BLUE, "o"),
        ("by frame, clean images", of_contacts(found["frame"], "r exosight"), GREEN, "s"),
        (
            "family held out, lowest of five",
            np.nanmin([of_contacts(found[f"without_{f}"], "r exosight") for f in FAMILIES], axis=0),
            ORANGE,
            "^",
        ),
        ("paper, by frame", of_contacts(found["shape"], "r paper"), VERMILION, "x"),
    )
    for i, (name, values, colour, marker) in enumerate(lines):
        axes.plot(
            np.arange(7) + 0.1 * (i - 1.5),
            values,
            marker,
            color=colour,
            label=name,
            linestyle="none",
            markersize=6,
        )
    axes.axhline(1.0, color=BLACK, linewidth=0.6)
    axes.set_xticks(range(7), CONTACTS)
    axes.set_ylim(0.45, 1.02)
    axes.set_ylabel("Pearson r, true and estimated force")
    axes.legend(loc="lower left", ncols=2)
    return figure


@styled
def shares() -> Figure:
    """C6, C7 and their sum while u rises, one exosuit: true, and estimated by the shipped network."""
    u = np.arange(0.0, 3.001, 0.05)
    exosuit = Exosuit(SHARES_SHAPE)
    found = simulate(exosuit, u)
    true = 1e3 * found.reading(*CONTACTS)
    read = 1e3 * OnnxEstimator.load(DEFAULT_MODEL).estimate(seen(published(exosuit), found.observation.axes))
    figure = new_figure(height=2.6, width=7.2)
    panels = figure.subplots(1, 3, sharey=True)
    for axes, name, places in zip(panels, ("C6", "C7", "C6 + C7"), ([5], [6], [5, 6]), strict=True):
        axes.plot(u, true[:, places].sum(axis=1), color=BLUE, label="true")
        axes.plot(u, read[:, places].sum(axis=1), ".", color=VERMILION, markersize=4, label="estimated")
        axes.set_title(name)
        axes.set_xlabel("u [N]")
    panels[0].set_ylabel("force [mN]")
    panels[0].legend(loc="upper left")
    return figure


def main() -> None:
    """Draw the figures and fill in the page."""
    found = load()
    save(picture(found), IMAGE)
    save(shares(), SHARES)
    fill(PAGE, tables(found))


if __name__ == "__main__":
    main()
