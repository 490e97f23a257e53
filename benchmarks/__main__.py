"""All benchmarks, one after the other: `python -m benchmarks`, on an otherwise idle machine.

Prints what was measured and writes it to docs/results/bench.json, from which docs/benchmarks.md is made. The
lab's needs Chromium, and is left out where there is none.
"""

import json
import os
from pathlib import Path

from benchmarks import control_step, dataset, environment, equilibria, estimate, lab, renderer

RESULT = Path(__file__).parents[1] / "docs" / "results" / "bench.json"


def main() -> None:
    """Run, print, write."""
    found = {"load_before": round(os.getloadavg()[0], 2), "cores": os.cpu_count()}
    for benchmark in (equilibria, renderer, dataset, estimate, control_step, environment, lab):
        if benchmark is lab and lab.CHROMIUM is None:
            print("lab: left out, no Chromium was found")
            continue
        measured = benchmark.run()
        for key, value in measured.items():
            print(f"{key}: {value}")
        print(flush=True)
        measured.pop("name", None)
        found[benchmark.__name__.rpartition(".")[2]] = measured
    RESULT.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
