"""How long the shipped network takes for one picture on one thread: `python -m benchmarks.estimate`."""

import time

import numpy as np

from exosight.app.bench import cpu_name
from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator

READINGS, WARM_UP = 2000, 50


def run() -> dict[str, str | int | float]:
    """Median and 99th percentile of a whole reading: forces, intervals, contact, OOD score [ms]."""
    estimator = OnnxEstimator.load(DEFAULT_MODEL, threads=1)
    size = (READINGS, 1, *estimator.card.schema.image_size)
    images = np.random.default_rng(0).integers(0, 256, size, np.uint8)
    seconds = []
    for image in images:
        started = time.perf_counter()
        estimator.read(image)
        seconds.append(time.perf_counter() - started)
    milliseconds = 1e3 * np.array(seconds[WARM_UP:])
    return {
        "cpu": cpu_name(),
        "readings": READINGS,
        "milliseconds_median": round(float(np.median(milliseconds)), 3),
        "milliseconds_p99": round(float(np.percentile(milliseconds, 99)), 3),
    }


if __name__ == "__main__":
    for key, value in run().items():
        print(f"{key}: {value}")
