"""`exosight bench`: how fast equilibria are solved here."""

from dataclasses import asdict
from typing import Annotated

from pydantic import Field

from exosight.app.commands.options import Json
from exosight.app.console import check_json_target, progress, show_or_write
from exosight.evaluation.tables import Column, Table

UNITS = {
    "seconds": "s",
    "equilibria_per_second": "1/s",
    "microseconds_per_iteration": "µs",
    "matrix_product_rate": "Gflop/s",
    "resolve_milliseconds": "ms",
    "first_call_seconds": "s",
    "cached_call_seconds": "s",
    "memory": "MiB",
}


def bench(
    per_scenario: Annotated[int, Field(ge=1, le=125)] = 10,
    json: Json = None,
) -> None:
    """Measure how many equilibria a second this machine solves, and how far its arithmetic would let it go.

    Exosuits of all eleven scenarios, each driven 0 → 4 N in 51 loads; --per-scenario 125 is the size of the
    paper's dataset. Run it alone: another load on the machine makes the numbers worthless.

    Examples:
      exosight bench
      exosight bench --per-scenario 125 --json bench.json

    Args:
        per_scenario: shapes of each of the eleven scenarios
        json: write the numbers as JSON to a new file, or to stdout with "-"
    """
    check_json_target(json)
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.app.bench import bench as run

    with progress("measuring", "steps") as update:
        found = asdict(run(per_scenario, update))
    rows = []
    for name, value in found.items():
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        rows.append((name.replace("_", " "), text, UNITS.get(name, "")))
    columns = (Column("quantity"), Column("value"), Column("unit"))
    show_or_write([Table("bench", "Equilibria of exosuit and finger", columns, tuple(rows))], found, json)
