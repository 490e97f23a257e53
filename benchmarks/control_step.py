"""One step of the loop in real time, stage by stage: `taskset -c 0 python -m benchmarks.control_step`.

The guarded controller follows a wave and lets go, 60 times a second, on a simulated exosuit that the shipped
network sees; with --adaptive, the adaptive one on `index`, seen by `index-control`. Nothing waits, so a step
takes what its stages take. Judged are the steps in which u moves: where it rests, there is nothing to solve.
"""

import argparse
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from exosight.app.bench import cpu_name
from exosight.app.pipeline import camera_of
from exosight.control import CONTROL_SHAPE, Adaptive, Guarded, OnnxEstimator, Scheduled
from exosight.control.estimator import DEFAULT_MODEL, NAMED_MODELS
from exosight.control.realtime import Clock, Step, run_live, timings
from exosight.control.simulated import SimulatedPlant
from exosight.control.simulated_device import SimulatedDevice
from exosight.control.tuning import tune
from exosight.cpu import cores
from exosight.exosuit.assembly import Exosuit
from exosight.exosuit.index import index
from exosight.exosuit.published import published

RATE = 60.0
"""[Hz]"""
SECONDS = 8
"""Of which the last is a release."""
NAMES = {"acquire": "render", "estimate": "estimate", "control": "law and guard", "actuate": "solve"}


def run(now: Callable[[], float] = perf_counter, adaptive: bool = False) -> dict[str, Any]:
    """Median and 99th percentile of each stage [ms], and the rate that they allow [Hz].

    now        clock to measure with [s]; `time.process_time` leaves out what other programs take
    adaptive   the adaptive controller on `index` instead of the guarded one
    """
    network = OnnxEstimator.load(NAMED_MODELS["index-control"] if adaptive else DEFAULT_MODEL)
    system = (index if adaptive else published)(Exosuit(CONTROL_SHAPE), camera_of(network.card))
    config = tune(system, period=1 / RATE)
    controller = Adaptive(config) if adaptive else Guarded(Scheduled(config))
    time = np.arange(round(SECONDS * RATE)) / RATE
    target = np.where(time < SECONDS - 1, 0.22 + 0.10 * np.sin(2 * np.pi * 0.5 * time), 0.0)
    at_once = Clock(now, sleep=lambda seconds: None)
    steps: list[Step] = []
    for record in (lambda step: None, steps.append):  # the first time, code is compiled
        device = SimulatedDevice(SimulatedPlant(system), config, at_once)
        run_live(device, network, controller, device, target.tolist(), record, at_once)
    moves = np.diff([step.command for step in steps], prepend=0.0) != 0
    seconds = np.array([step.seconds for step in steps])[moves]
    found: dict[str, Any] = {
        "name": "control step" + ", adaptive" * adaptive,
        "cpu": cpu_name(),
        "cores": cores(),
        "steps": len(seconds),
    }
    for timing in timings(seconds):
        name = NAMES.get(timing.stage, timing.stage)
        found[f"{name}, median [ms]"] = round(1e3 * timing.p50, 2)
        found[f"{name}, p99 [ms]"] = round(1e3 * timing.p99, 2)
    whole = seconds.sum(axis=1)
    found["median rate [Hz]"] = round(1 / float(np.median(whole)))
    found["rate that 99 % of the steps keep [Hz]"] = round(1 / float(np.quantile(whole, 0.99)))
    found["steps within 1/60 s [%]"] = round(100 * float(np.mean(whole <= 1 / RATE)), 1)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--adaptive", action="store_true")
    for key, value in run(adaptive=parser.parse_args().adaptive).items():
        print(f"{key}: {value}")
