"""`exosight study`: everything, from simulation to one report."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from exosight.app.console import out as stdout
from exosight.app.study import PRESETS, read_config, run_study


def study(
    out: Path,
    preset: Literal["quick", "paper"] = "quick",
    config: Path | None = None,
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Simulate, train, judge and close the loop; write one HTML report beside the paper's results.

    The folder gets the dataset, a folder for each network, the closed-loop trials, every table of the report
    as CSV and JSON, the report itself, and study.json, the configuration that makes all of it again.

    Example: exosight study --preset quick --out results/quick

    Args:
        out: folder of the study; it must not exist, unless --resume
        preset: quick: 110 shapes and the light network, some minutes; paper: 1375 shapes and both networks
        config: a study.json, instead of a preset
        resume: go on with the study that the folder holds; done stages are not repeated
    """
    chosen = PRESETS[preset] if config is None else read_config(config)
    report = run_study(chosen, out, ["exosight", *sys.argv[1:]], resume=resume)
    stdout.print(f"The report is {report.resolve()}")
