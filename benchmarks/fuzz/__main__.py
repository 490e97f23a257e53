"""A million mutated inputs: `python -m benchmarks.fuzz [--inputs N] [--door NAME] [--seed S] [--start I]`.

Each kind of input is tried in a process of its own, two at a time. An input that takes more than 20 s, or
that ends its process, is noted by its number, and the process begun anew behind it. A run of all kinds writes
docs/results/fuzz.json; one of a kind prints the tracebacks of what it found.
"""

import argparse
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.fuzz import DOORS
from benchmarks.fuzz.processes import run

RESULT = Path(__file__).parents[2] / "docs" / "results" / "fuzz.json"


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--door", choices=DOORS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--start", type=int, default=0)
    chosen = parser.parse_args()
    names = [chosen.door] if chosen.door else list(DOORS)
    total = sum(DOORS[name][1] for name in names)
    with ThreadPoolExecutor(2) as pool:
        jobs = {
            name: pool.submit(run, name, chosen.inputs * DOORS[name][1] // total, chosen.seed, chosen.start)
            for name in names
        }
        found = {name: job.result() for name, job in jobs.items()}
    for name, values in found.items():
        numbers = values.pop("numbers")
        print(f"{name}: {values}")
        for number, text in numbers["tracebacks"][:5]:
            print(f"  --start {number} --inputs 1\n{text}")
        print(
            *(f"  {kind}: {numbers[kind][:20]}\n" for kind in ("hangs", "crashes") if numbers[kind]),
            sep="",
            end="",
        )
    if not chosen.door:
        RESULT.write_text(json.dumps({"seed": chosen.seed, **found}, indent=1) + "\n")
    sys.exit(
        any(
            values[kind] for values in found.values() for kind in ("tracebacks", "hangs over 20 s", "crashes")
        )
    )


if __name__ == "__main__":
    main()
