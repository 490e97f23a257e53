"""Figure and tables of docs/stress.md, from docs/results/stress*.json; the numbers, each a `--json`:

stress.json          exosight stress --gains --model src/exosight/models/light.onnx
stress_true.json     exosight stress --gains
stress_paper.json    exosight stress --gains 5 --episodes 100
stress_latency.json  as stress.json, with --latency 0.1 0.1 --dropped 0.1 0.1 --repeated 0 0 --bursts 0
                     --no-wrong-plant --no-wrong-camera --no-moving-user
stress_index_true.json   exosight stress --system index --controllers oracle adaptive guarded --gains
stress_index_image.json  as before, with --model index-control
stress_index_learned.json    exosight stress --system index --controllers adaptive learned --gains
                             --episodes 650
stress_index_unguarded.json  the same, with --controllers adaptive learned unguarded --episodes 200
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
    *("stress_index_true", "stress_index_image", "stress_index_learned", "stress_index_unguarded"),
)


def load() -> dict[str, Any]:
    """The measured numbers, by name."""
    return {name: json.loads((RESULTS / f"{name}.json").read_text()) for name in NAMES}


def tables(found: dict[str, Any]) -> dict[str, str]:
    """The page's tables, by name."""
    causes = found["stress"]["controllers"]["guarded"]["transitions"]
    index = {"true force": found["stress_index_true"], "image": found["stress_index_image"]}
    adaptive = {name: result["controllers"]["adaptive"] for name, result in index.items()}
    learned = found["stress_index_learned"]["controllers"]
    return {name: shown(stress_table(result)) for name, result in found.items()} | {
        "tracking": table_of(
            ["root mean square error from 1 s on, median of the episodes [mN]", *learned],
            [
                [kind, *(f"{1e3 * each['tracking_error'][kind]['median']:.1f}" for each in learned.values())]
                for kind in learned["adaptive"]["tracking_error"]
            ],
        ),
        "disturbances": table_of(
            ["disturbance", *adaptive],
            [
                [name, *(_of(each["attained_by_disturbance"][name]) for each in adaptive.values())]
                for name in adaptive["image"]["attained_by_disturbance"]
            ],
        ),
        "adaptive_causes": table_of(
            ["state entered, and cause", *adaptive],
            [
                [cause, *(str(each["transitions"].get(cause, 0)) for each in adaptive.values())]
                for cause in adaptive["image"]["transitions"]
            ],
        ),
        "causes": table_of(
            ["state entered, and cause", "count"],
            [[cause, str(count)] for cause, count in causes.items()],
        ),
    }


def _of(counts: dict[str, int]) -> str:
    return f"{counts['attained']} of {counts['attainable']}"


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
