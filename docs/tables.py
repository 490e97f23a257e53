"""Tables of pages about speed, MATLAB and photographs, and the README's words on cost.

From docs/results and the shipped network.
"""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import onnx
from _parts.pages import fill, machine, table_of

from exosight.app.commands import bench
from exosight.control.estimator import DEFAULT_MODEL

HERE = Path(__file__).parent
BENCH = HERE / "results" / "bench.json"
PHOTOGRAPHS = HERE / "results" / "photographs.json"
RELIABILITY = HERE / "results" / "reliability.json"

TITLES = {
    "equilibria": "Equilibria of the exosuit on a finger",
    "renderer": "Rendering",
    "dataset": "A dataset of the paper's size",
    "estimate": "Inference of the shipped network, one thread",
    "control_step": "One step of the real-time loop",
    "environment": "The Gymnasium environment",
    "lab": "The lab: time from slider event to displayed result",
}
NO_RESULTS = "No results for this version yet; run `make bench` on an idle machine.\n"
UNITS = {
    **bench.UNITS,
    "milliseconds_median": "ms",
    "milliseconds_p99": "ms",
    "frames_per_second": "1/s",
}


def bench_tables(found: dict[str, Any] | None) -> str:
    """One table per benchmark; None: no results for this version."""
    if found is None:
        return NO_RESULTS
    lines: list[str] = []
    for name, title in TITLES.items():
        if name not in found:
            continue
        rows = [
            (
                key.replace("_", " "),
                f"{value:.4g}" if isinstance(value, float) else str(value),
                UNITS.get(key, ""),
            )
            for key, value in found[name].items()
        ]
        lines += [f"## {title}", "", table_of(("quantity", "value", "unit"), rows), ""]
    return "\n".join(lines)


def loop_table(found: dict[str, Any] | None) -> str:
    """The parts of a step of the real-time loop; None: no results for this version."""
    if found is None:
        return NO_RESULTS
    own = found["control_step"]
    parts = ("render", "estimate", "law and guard", "solve", "whole step")
    rows = [(part, *(f"{own[f'{part}, {which} [ms]']:.1f}" for which in ("median", "p99"))) for part in parts]
    return f"{machine(own)}.\n\n{table_of(('[ms]', 'median', '99 %'), rows)}"


def environment_table(found: dict[str, Any] | None) -> str:
    """Steps of the environment a second; None: no results for this version."""
    if found is None:
        return NO_RESULTS
    own = found["environment"]
    head = ("steps a second", "wall-clock, small", "any", "of one core's time, small", "any")
    columns = [
        f"{size} actions, steps a {of}" for of in ("second", "CPU second") for size in ("small", "any")
    ]
    rows = [
        (title, *(f"{own[f'{kind}, {column}']}" for column in columns))
        for kind, title in (("state", "`state`"), ("mixed", "`mixed`, with images"))
    ]
    return f"{machine(own)}.\n\n{table_of(head, rows)}"


def cost(found: dict[str, Any] | None) -> str:
    """What the README says of speed; None: no results for this version."""
    if found is None:
        return NO_RESULTS
    own, data, step = found["equilibria"], found["dataset"], found["control_step"]
    names = ("published", "index", "index-friction")
    rate = [f"{own[f'{name}: equilibria per second']:,.0f}" for name in names]
    converged = 100 * min(own[f"{name}: converged"] for name in names)
    return f"""**Cost** on {own["cores"]} cores ({own["cpu"]}; [all of it](docs/benchmarks.md)):
{own["shapes"]} exosuits of all eleven scenarios × 51 loads with 25 degrees of freedom
at {rate[0]} stable equilibria a second, with surfaces and self-contact (`index`) {rate[1]},
with friction {rate[2]}, {converged:.4g} % converged;
a single pose again in {own["resolve_milliseconds"]:.1f} ms;
the first one in a process {own["first_call_seconds"]:.1f} s,
{own["cached_call_seconds"]:.1f} s once its program is on the disk;
the paper's whole dataset simulated, rendered and stored in {data["seconds to make"]:.0f} s
({data["MB on disk"]:.0f} MB); one step of the loop (render, estimate, decide, solve) in
{step["whole step, median [ms]"]:.1f} ms, 99 % within {step["whole step, p99 [ms]"]:.1f} ms as snaps
take longer."""


def onnx_table(path: Path) -> str:
    """Versions, inputs, outputs and operators of a network's file."""
    model = onnx.load(path)
    graph = model.graph

    def size(value: Any) -> str:
        return ", ".join(each.dim_param or str(each.dim_value) for each in value.type.tensor_type.shape.dim)

    def tensors(values: Any) -> str:
        return ", ".join(f"`{value.name}` ({size(value)})" for value in values)

    operators = Counter(node.op_type for node in graph.node)
    versions = ", ".join(f"{each.domain or 'ai.onnx'} {each.version}" for each in model.opset_import)
    rows = {
        "intermediate representation": str(model.ir_version),
        "operator set": versions,
        "input": tensors(graph.input),
        "outputs": tensors(graph.output),
        "operators": ", ".join(f"{name} {count}" for name, count in sorted(operators.items())),
    }
    return table_of((f"`{path.name}`", ""), list(rows.items()))


def photograph_table(found: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Every network on every kind of picture."""
    head = (
        "network",
        "pictures",
        "F_net r",
        "F_net RMSE [mN]",
        "zones r",
        "C7 r",
        "inside [%]",
        "large errors [%]",
        "flagged [%]",
    )
    rows = [
        (
            *(
                f"`{network}`",
                kind,
                f"{of['r_net']:.3f}",
                f"{1e3 * of['rmse_net']:.0f}",
                f"{of['r_zones']:.3f}",
                f"{of['r_last']:.2f}".replace("-0.00", "0.00"),
            ),
            *(f"{100 * of[name]:.0f}" for name in ("held", "large", "flagged")),
            *(
                "–" if of[name] is None else f"{of[name]:.2f}"
                for name in ("auroc_probability", "auroc_width", "auroc")
            ),
        )
        for network, kinds in found.items()
        for kind, of in kinds.items()
    ]
    return table_of((*head, "AUROC: probability", "interval", "OOD score"), rows)


def trust_table(found: dict[str, dict[str, Any]]) -> str:
    """How well each sign of a large error tells where it is."""
    head = ("network", "images", "large errors [%]", "AUROC: probability", "interval", "OOD score")
    rows = [
        (
            *(f"`{network}`", kind, f"{100 * of[kind]['large']:.0f}"),
            *(f"{of[kind][f'auroc_{name}']:.2f}" for name in ("probability", "width", "ood")),
        )
        for network, of in found.items()
        for kind in ("disturbed", "photo-like")
        if kind in of
    ]
    return table_of(head, rows)


def calibration_of_trust_table(found: dict[str, dict[str, Any]]) -> str:
    """The share of large errors among frames of about the same probability of one."""
    columns = [
        (network, kind) for network, of in found.items() for kind in ("disturbed", "photo-like") if kind in of
    ]
    edges = sorted(
        {(b["from"], b["to"]) for network, kind in columns for b in found[network][kind]["calibration"]}
    )
    head = ("probability", *(f"`{network}`, {kind} [%]" for network, kind in columns))
    rows = []
    for low, high in edges:
        cells = []
        for network, kind in columns:
            own = [b for b in found[network][kind]["calibration"] if b["from"] == low]
            cells.append(f"{100 * own[0]['large']:.0f} of {own[0]['frames']}" if own else "–")
        rows.append((f"{100 * low:.0f} to {100 * high:.0f} %", *cells))
    return table_of(head, rows)


def cause_table(found: dict[str, Any]) -> str:
    """What unusual images of one network are put down to, in percent of them."""
    rows = []
    for name, of in found["sets"].items():
        shares = of.get("causes")
        cells = ["–"] * 6 if shares is None else [f"{100 * share:.0f}" for share in shares.values()]
        rows.append((name, *(f"{100 * of[key]:.0f}" for key in ("large", "flagged", "ood")), *cells))
    names = next(of["causes"] for of in found["sets"].values() if "causes" in of)
    return table_of(("images", "large errors", "flagged", "OOD score above 1", *names), rows)


def tables() -> dict[Path, dict[str, str]]:
    """The tables of each page, by the name of their place."""
    found = json.loads(BENCH.read_text()) if BENCH.exists() else None
    reliability = json.loads(RELIABILITY.read_text())
    return {
        HERE.parent / "README.md": {"cost": cost(found)},
        HERE / "benchmarks.md": {"bench": bench_tables(found)},
        HERE / "realtime.md": {"loop": loop_table(found)},
        HERE / "gymnasium.md": {"environment": environment_table(found)},
        HERE / "matlab.md": {"onnx": onnx_table(DEFAULT_MODEL)},
        HERE / "photographs.md": {
            "photographs": photograph_table(json.loads(PHOTOGRAPHS.read_text())),
            "trust": trust_table(reliability),
            "calibration": calibration_of_trust_table(reliability),
            "causes": cause_table(reliability["index"]),
        },
    }


def main() -> None:
    """Put them into the pages."""
    for page, found in tables().items():
        fill(page, found)


if __name__ == "__main__":
    main()
