"""Equilibria a second: 110 exosuits of all eleven scenarios, each driven 0 → 4 N in 51 loads.

The same as `exosight bench`. Run alone: another load on the machine makes the numbers worthless.
"""

from dataclasses import asdict

from exosight.app.bench import bench

PER_SCENARIO = 10


def run() -> dict[str, str | int | float]:
    """Measure, and round for reading."""
    found = asdict(bench(PER_SCENARIO))
    return {
        name: float(f"{value:.4g}") if isinstance(value, float) else value for name, value in found.items()
    }


if __name__ == "__main__":
    for key, value in run().items():
        print(f"{key}: {value}")
