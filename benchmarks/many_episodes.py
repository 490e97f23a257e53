"""Safety of the controllers in very many episodes: the stress suite on tabulated plants, which are looked up
instead of solved, with the true force as sensor.

    python -m benchmarks.many_episodes OUT.json --episodes 100000 --suite 2

The systems of 64 episodes (seed 7003) are solved once over command and user
(`exosight.control.stress.tabulated`); each episode gets one of them. Every thousand episodes OUT.json is
written anew, and a run that was stopped goes on where it was. First 40 episodes are run with the solver as
well, and the difference of the forces is told.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from exosight.control import GuardConfig, guarded_of
from exosight.control.guarded import GuardedName
from exosight.control.stress import StressConfig
from exosight.control.stress.config import guard_of
from exosight.control.stress.episodes import Episode, draw_episode, joint_springs
from exosight.control.stress.frames import true_sensor
from exosight.control.stress.measures import RELEASE_SECONDS, Measured, measure_episode
from exosight.control.stress.plants import StressPlants, stress_plants
from exosight.control.stress.suite import Solve, Traces, run_episodes, solved
from exosight.control.stress.tabulated import ForceTable, solve_table
from exosight.exosuit.catalogue import find_system
from exosight.files import replace_file

SEED, SYSTEMS, BLOCK, COMPARED = 7003, 64, 1000, 40
NAMES = ("adaptive", "guarded")
COUNTS = (
    "late",
    "unrecovered",
    "commands_outside",
    "outside_contact_limit",
    "given_up",
    "constant",
    "settled",
)


def episodes(config: StressConfig, numbers: Sequence[int], plants: StressPlants) -> list[Episode]:
    """Of these numbers."""
    return [draw_episode(config, SEED, number, plants) for number in numbers]


def run(
    drawn: Sequence[Episode], name: GuardedName, plants: StressPlants, guard: GuardConfig, solve: Solve
) -> tuple[Traces, list[Measured]]:
    """One controller on these episodes."""
    controllers = [guarded_of(name, plants.limits, guard) for _ in drawn]
    traces = run_episodes(drawn, controllers, true_sensor, plants.limits, solve=solve)
    return traces, [measure_episode(e, traces, i, plants.limits) for i, e in enumerate(drawn)]


def compared(config: StressConfig, plants: StressPlants, table: ForceTable) -> dict[str, float]:
    """How far tabulated and solved plants are apart under the commands of the guarded controller."""
    drawn = episodes(config, range(COMPARED), plants)
    traces, _ = run(drawn, "guarded", plants, guard_of(config), table.plants)

    class Same:
        """Asks for the commands of the first run."""

        def __init__(self, commands: np.ndarray) -> None:
            self.log, self._commands, self._step = [], commands, 0

        def reset(self) -> None:
            self._step = 0

        def step(self, target: float, measurement: object) -> float:
            self._step += 1
            return float(self._commands[self._step])

    again = run_episodes(drawn, [Same(u) for u in traces.command], true_sensor, plants.limits, solve=solved)
    pressing = again.true > 0.02
    error = (traces.true - again.true)[pressing]
    return {
        "episodes": COMPARED,
        "rms_error_N": float(np.sqrt(np.mean(error**2))),
        "largest_error_N": float(np.abs(error).max()),
        "mean_force_N": float(again.true[pressing].mean()),
    }


def counted(measured: Sequence[Measured]) -> dict[str, int]:
    """What is counted of these episodes."""
    constant = [m for m in measured if m.kind in ("constant", "snap")]
    return {
        "late": sum(not m.release_seconds <= RELEASE_SECONDS for m in measured),
        "unrecovered": sum(not m.recovered for m in measured),
        "commands_outside": sum(m.commands_outside for m in measured),
        "outside_contact_limit": sum(m.seconds_outside > 0 for m in measured),
        "given_up": sum(m.given_up for m in measured),
        "constant": len(constant),
        "settled": sum(np.isfinite(m.settling_steps) for m in constant),
    }


def violations(measured: Sequence[Measured], first: int) -> list[dict[str, Any]]:
    """The episodes that broke a rule, with all that was measured on them."""
    return [
        {"episode": first + i, **asdict(m)}
        for i, m in enumerate(measured)
        if m.commands_outside or m.seconds_outside > 0 or not m.release_seconds <= RELEASE_SECONDS
    ]


def main() -> None:
    """Run, and write after every block."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int, default=100_000)
    parser.add_argument("--suite", type=int, choices=(1, 2), default=2)
    parser.add_argument("--controllers", nargs="+", choices=NAMES, default=NAMES)
    asked = parser.parse_args()
    config = StressConfig(suite=asked.suite)
    plants = stress_plants(find_system("index"))
    systems = [plants.other(SEED, number) for number in range(SYSTEMS)]
    table = solve_table(systems, plants.limits, joint_springs(plants.nominal)[1])
    plants = replace(plants, other=lambda seed, number: systems[number % SYSTEMS])
    if asked.out.exists():
        found = json.loads(asked.out.read_text())
    else:
        found = {
            "config": TypeAdapter(StressConfig).dump_python(config.complete(), mode="json"),
            "seed": SEED,
            "systems": SYSTEMS,
            "play_per_friction": table.play,
            "compared": compared(config, plants, table),
            "controllers": {
                name: {"episodes": 0, "cpu_s": 0.0, **dict.fromkeys(COUNTS, 0), "violations": []}
                for name in asked.controllers
            },
        }
        print(found["compared"], flush=True)
    for first in range(0, asked.episodes, BLOCK):
        for name, own in found["controllers"].items():
            if own["episodes"] > first:
                continue
            begin = time.process_time()
            numbers = range(first, min(first + BLOCK, asked.episodes))
            _, measured = run(episodes(config, numbers, plants), name, plants, guard_of(config), table.plants)
            own["episodes"] += len(measured)
            own["cpu_s"] = round(own["cpu_s"] + time.process_time() - begin, 1)
            for key, count in counted(measured).items():
                own[key] += int(count)
            own["violations"] += violations(measured, first)
            replace_file(asked.out, json.dumps(found, indent=1).encode())
        print(
            {
                name: {k: v for k, v in own.items() if k != "violations"}
                for name, own in found["controllers"].items()
            },
            flush=True,
        )


if __name__ == "__main__":
    main()
