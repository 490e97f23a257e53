"""Figures and tables of docs/surface_contact.md: `index` beside `published`; some minutes on one core.

`python docs/figures_surface_contact.py` simulates and draws; with `--draw` it draws what docs/results holds.
Accuracy and data, also those of the model cards, are those of, with DATA from `exosight generate
--system index --per-scenario 125` and FRICTION from the same with `--system index-friction`,

index_data.json               what `generate` tells with --json
accuracy/index.json           exosight evaluate --data DATA --json docs/results/accuracy/index.json
accuracy/index_without_FAMILY.json
                              the same with --model of `exosight train --data DATA --extra-data SEED1 … SEED5
                              --protocol family --held-out FAMILY --epochs 4`, DATA of further seeds
accuracy/index_quick.json     the same with data and network of `exosight train --data SEED30
                              --extra-data SEED31 --epochs 5`
accuracy/index_friction.json  the same with FRICTION, index_friction.json and --model
                              src/exosight/models/index-friction.onnx
"""

import json
import sys
from typing import Any

import figures_accuracy as accuracy
import figures_control as control
import numpy as np
from _parts.pages import fill, save, table_of
from matplotlib.figure import Figure

from exosight.control import CONTROL_SHAPE
from exosight.evaluation.figures.style import BLUE, GRAY, GREEN, VERMILION, new_figure, styled
from exosight.evaluation.published import FRAMES_KEPT, FRAMES_SIMULATED
from exosight.exosuit.catalogue import nominal_system
from exosight.exosuit.index import index
from exosight.mechanics import drive
from exosight.system.observation import observe
from exosight.system.system import stack_systems

HERE = control.HERE
PAGE, RESULT, IMAGES = HERE / "surface_contact.md", HERE / "results" / "surface_contact.json", control.IMAGES
COLOURS = {"published": VERMILION, "index": BLUE, "index-friction": GREEN}
LOADS = np.concatenate([np.arange(0, 81), np.arange(79, -1, -1)]) / 20
"""u [N], up and down."""
WITHOUT = "index_without_"
SETTLING = (control.LAW, control.LAW_IMAGE, control.OURS, control.OURS_IMAGE)


def measure() -> dict[str, Any]:
    """F_net over u of the controller's exosuit on each system, and the runs of its loop on `index`."""
    return {"u": LOADS.tolist(), "F_net": {name: _path(name) for name in COLOURS}, **control.measure(index)}


def _path(name: str) -> list[float]:
    system = nominal_system(name, CONTROL_SHAPE)
    found = drive([system.robot], LOADS[:, None])
    assert np.all(found.converged), name
    stacked = stack_systems([system])
    seen = observe(stacked, found.q, found.history)
    return np.asarray(seen.readings)[0, :, system.schema.index("F_net")].round(5).tolist()


def load() -> dict[str, Any]:
    """The stored results."""
    both = {
        name: json.loads((RESULT.parent / f"{name}.json").read_text()) for name in ("index_data", "bench")
    }
    return {**json.loads(RESULT.read_text()), "accuracy": accuracy.load(), **both}


@styled
def paths(found: dict[str, Any]) -> Figure:
    """F_net over u, up and down, on each system."""
    figure = new_figure(height=2.8, width=7.2)
    peak = len(found["u"]) // 2
    for axes, (name, force) in zip(
        figure.subplots(1, 3, sharex=True, sharey=True), found["F_net"].items(), strict=True
    ):
        axes.plot(found["u"][: peak + 1], force[: peak + 1], color=COLOURS[name], label="u rising")
        axes.plot(found["u"][peak:], force[peak:], "--", color=COLOURS[name], label="u falling")
        for target in (0.25, 0.30, 0.35):
            axes.axhline(target, color=GRAY, linewidth=0.6, linestyle=":")
        axes.set_title(name)
        axes.set_xlabel("u [N]")
        axes.legend(loc="upper left")
    figure.axes[0].set_ylabel("F_net [N]")
    return figure


def tables(found: dict[str, Any]) -> dict[str, str]:
    """The page's tables, by name."""
    networks = {"published": found["accuracy"]["shape"], "index": found["accuracy"]["index"]}
    contacts = [
        [f"{words}, {name}", *(f"{factor * x:.{digits}f}" for x in accuracy.of_contacts(result, column))]
        for words, column, factor, digits in (
            ("r", "r exosight", 1.0, 4),
            ("RMSE [mN]", "RMSE exosight [N]", 1e3, 1),
        )
        for name, result in networks.items()
    ]
    noise = [
        [name, *(f"{row['r exosight']:.4f}" for row in result["robustness"])]
        for name, result in networks.items()
    ]
    families = [
        [
            name.removeprefix(WITHOUT).replace("_", "-"),
            result["frames"].split()[0],
            f"{np.mean(accuracy.of_contacts(result, 'r exosight')):.4f}",
            *(f"{r:.4f}" for r in accuracy.of_contacts(result, "r exosight")),
            f"{1e3 * _of_net_force(result):.1f}",
        ]
        for name, result in found["accuracy"].items()
        if name.startswith(WITHOUT)
    ]
    bench, own_data = found["bench"]["dataset"], found["index_data"]
    kept = {
        "published": (bench["frames simulated"], bench["frames kept, rendered and stored"]),
        "index": (own_data["frames"] + sum(own_data["dropped"].values()), own_data["frames"]),
        "paper": (FRAMES_SIMULATED, FRAMES_KEPT),
    }
    data = [
        [name, f"{simulated}", f"{left}", f"{100 * left / simulated:.1f}"]
        for name, (simulated, left) in kept.items()
    ]
    own = control.load()["constant"]
    loop = [
        [
            f"{controller}: {name}",
            *(control.settled(runs[controller][target]) for target in control.PAPER),
            " / ".join(f"{runs[controller][target]['overshoot_percent']:.0f}" for target in control.PAPER),
            " / ".join(control.percent(runs[controller][target]) for target in control.PAPER),
        ]
        for controller in SETTLING
        for name, runs in (("published", own), ("index", found["constant"]))
    ]
    return {
        "data": table_of(("system", "frames simulated", "kept", "kept [%]"), data),
        "contacts": table_of(("unseen exosuits", *accuracy.CONTACTS), contacts),
        "families": table_of(
            ("family held out", "test frames", "r, mean", *accuracy.CONTACTS, "RMSE of F_net [mN]"), families
        ),
        "noise": table_of(("mean r", *accuracy.IMAGES), noise),
        "loop": table_of(
            ("controller and system", *control.PAPER, "overshoot [%]", "steady-state error [%]"), loop
        ),
    }


def _of_net_force(result: dict[str, Any]) -> float:
    return next(row["RMSE exosight [N]"] for row in result["contacts"] if row["contact"] == "F_net")


def main() -> None:
    """Simulate, unless `--draw` is given; write figures and page."""
    if "--draw" not in sys.argv[1:]:
        RESULT.write_text(json.dumps(measure()) + "\n")
    found = load()
    save(paths(found), IMAGES / "surface_contact.png")
    save(control.constant(found["constant"]), IMAGES / "surface_contact_loop.png")
    fill(PAGE, tables(found))


if __name__ == "__main__":
    main()
