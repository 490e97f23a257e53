"""All benchmarks, one after the other: `python -m benchmarks`, on an otherwise idle machine.

Prints what was measured and writes it to docs/results/bench.json, from which docs/benchmarks.md is made. The
lab's needs Chromium, and is left out where there is none. With names, those alone are measured, as in
`python -m benchmarks equilibria`, and the others' numbers stay.
"""

import json
import os
import sys
from pathlib import Path

from benchmarks import control_step, dataset, environment, equilibria, estimate, lab, renderer

RESULT = Path(__file__).parents[1] / "docs" / "results" / "bench.json"


ALL = {
    each.__name__.rpartition(".")[2]: each
    for each in (equilibria, renderer, dataset, estimate, control_step, environment, lab)
}


def main(*names: str) -> None:
    """Run, print, write."""
    found = json.loads(RESULT.read_text()) if names else {}
    for name in names or ALL:
        if name == "lab" and lab.CHROMIUM is None:
            print("lab: left out, no Chromium was found")
            continue
        measured = {"load before": round(os.getloadavg()[0], 2)} | ALL[name].run()
        for key, value in measured.items():
            print(f"{key}: {value}")
        print(flush=True)
        measured.pop("name", None)
        found[name] = measured
    RESULT.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
