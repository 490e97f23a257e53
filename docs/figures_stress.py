"""Figure and tables of docs/stress.md, from docs/results/stress*.json; the numbers, each a `--json`:

stress.json          exosight stress --gains --model src/exosight/models/light.onnx
stress_true.json     exosight stress --gains
stress_paper.json    exosight stress --gains 5 --episodes 100
stress_latency.json  as stress.json, with --latency 0.1 0.1 --dropped 0.1 0.1 --repeated 0 0 --bursts 0
                     --no-wrong-plant --no-wrong-camera --no-moving-user
On the device index, with --system index --gains and, where the name ends in image, --model index-control:

stress_index_true.json, stress_index_image.json    --controllers oracle delayed-oracle adaptive guarded
stress_index2_true.json, stress_index2_image.json  the same, --suite 2
stress_index_latency.json  --controllers oracle adaptive --model index-control --latency 0.1 0.1
                           --dropped 0.1 0.1 --repeated 0 0 --bursts 0 --no-wrong-plant --no-wrong-camera
                           --no-moving-user
stress_index_learned.json, stress_index_learned_image.json  --controllers oracle adaptive learned
stress_index_unguarded.json  --controllers adaptive learned unguarded --episodes 200

many_episodes.json  python -m benchmarks.many_episodes docs/results/many_episodes.json --suite 1
"""

import json
from pathlib import Path
from typing import Any

from _parts.pages import fill, save, shown, table_of
from matplotlib.figure import Figure

from exosight.app.control_figures import stress_figure
from exosight.app.stress import stress_table

HERE = Path(__file__).parent
PAGE, RESULTS, IMAGE = HERE / "stress.md", HERE / "results", HERE / "images" / "stress.png"
NAMES = (
    *("stress", "stress_true", "stress_paper", "stress_latency"),
    *("stress_index_true", "stress_index_image", "stress_index2_true", "stress_index2_image"),
    *("stress_index_latency", "stress_index_learned", "stress_index_learned_image", "stress_index_unguarded"),
)


def load() -> dict[str, Any]:
    """The measured numbers, by name."""
    return {name: json.loads((RESULTS / f"{name}.json").read_text()) for name in NAMES}


def tables(found: dict[str, Any]) -> dict[str, str]:
    """The page's tables, by name."""
    causes = found["stress"]["controllers"]["guarded"]["transitions"]
    learned = found["stress_index_learned"]["controllers"]
    first, second = (
        {sensor: found[f"{suite}_{sensor}"]["controllers"] for sensor in ("true", "image")}
        for suite in ("stress_index", "stress_index2")
    )
    return {name: shown(stress_table(result)) for name, result in found.items()} | {
        "disturbances": _by_disturbance(first),
        "disturbances2": _by_disturbance(second),
        "hold_error": _hold_errors(first),
        "hold_error2": _hold_errors(second),
        "adaptive_causes": _transitions(first),
        "adaptive_causes2": _transitions(second),
        "many_episodes": _many(json.loads((RESULTS / "many_episodes.json").read_text())),
        "tracking": table_of(
            ["root mean square error from 1 s on, median of the episodes [mN]", *learned],
            [
                [kind, *(f"{1e3 * each['tracking_error'][kind]['median']:.1f}" for each in learned.values())]
                for kind in learned["adaptive"]["tracking_error"]
            ],
        ),
        "causes": table_of(
            ["state entered, and cause", "count"],
            [[cause, str(count)] for cause, count in causes.items()],
        ),
    }


def _adaptive(results: dict[str, Any]) -> dict[str, Any]:
    return {
        "adaptive, true force": results["true"]["adaptive"],
        "adaptive, image": results["image"]["adaptive"],
    }


def _bounded(results: dict[str, Any]) -> dict[str, Any]:
    return {"delayed oracle": results["true"]["delayed-oracle"]} | _adaptive(results)


def _by_disturbance(results: dict[str, Any]) -> str:
    columns = _bounded(results)
    counts = {name: each["attained_by_disturbance"] for name, each in columns.items()}
    return table_of(
        ["disturbance", *columns],
        [
            [cause, *(f"{own[cause]['attained']} of {own[cause]['attainable']}" for own in counts.values())]
            for cause in counts["delayed oracle"]
        ],
    )


def _hold_errors(results: dict[str, Any]) -> str:
    columns = {"oracle": results["true"]["oracle"]} | _bounded(results)
    return table_of(
        ["mean error from 1 s on [mN]", *columns],
        [
            [user, *(f"{1e3 * each['hold_error'][user]:.1f}" for each in columns.values())]
            for user in ("user at rest", "user moves")
        ],
    )


def _transitions(results: dict[str, Any]) -> str:
    counts = {name: each["transitions"] for name, each in _adaptive(results).items()}
    causes = dict.fromkeys(cause for each in counts.values() for cause in each)
    return table_of(
        ["state entered, and cause", *counts],
        [[cause, *(str(each.get(cause, 0)) for each in counts.values())] for cause in causes],
    )


def _many(found: dict[str, Any]) -> str:
    counts = {
        "released late (> 1 s)": "late",
        "not recovered": "unrecovered",
        "commands beyond limits": "commands_outside",
        "beyond a contact limit": "outside_contact_limit",
        "aborted by the guard": "given_up",
        "targets settled": "settled",
        "of targets": "constant",
    }
    return table_of(
        ["controller", "episodes", *counts],
        [
            [name, f"{each['episodes']:,}".replace(",", " "), *(str(each[key]) for key in counts.values())]
            for name, each in found["controllers"].items()
        ],
    )


def picture(found: dict[str, Any]) -> Figure:
    """Distributions over the episodes, guarded controller and the paper's law."""
    runs = {
        "guarded, image": found["stress"]["controllers"]["guarded"],
        "guarded, true force": found["stress_true"]["controllers"]["guarded"],
        "paper's law, K_P = 5, true force": found["stress_paper"]["controllers"]["K_P = 5"],
    }
    return stress_figure({"about": found["stress"]["about"], "controllers": runs})


def main() -> None:
    """Draw the figure and fill in the page."""
    found = load()
    save(picture(found), IMAGE)
    fill(PAGE, tables(found))


if __name__ == "__main__":
    main()
