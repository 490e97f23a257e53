"""`exosight study`: everything, from simulation to one report."""

from pathlib import Path
from typing import Annotated

import tyro

from exosight.app.commands.options import MaybePath
from exosight.app.console import out as stdout
from exosight.app.study_config import CONFIG, PRESETS, PresetName, StudyConfig, read_config
from exosight.errors import InputError


def study(
    out: Path,
    preset: Annotated[PresetName | None, tyro.conf.arg(help_behavior_hint="")] = None,
    config: MaybePath = None,
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Simulate, train, evaluate and close the loop; write one HTML report beside the paper's results.

    The folder gets the dataset, a folder for each network, the closed-loop trials, every table of the report
    as CSV and JSON, the report itself, and study.json, the configuration that makes all of it again.

    Example:
      exosight study --preset quick --out results/quick

    Args:
        out: folder of the study; it must not exist, unless --resume
        preset: quick (default): 110 shapes, light network, minutes; paper: 1375 shapes, both networks, hours
        config: a study.json, instead of a preset
        resume: go on with the study that the folder holds; done stages are not repeated
    """
    # Here, so that --help and wrong options answer at once: JAX and Matplotlib take seconds to import.
    from exosight.app.study import run_study

    report = run_study(_chosen(out, preset, config, resume), out, resume=resume)
    stdout.print(f"The report is {report.resolve()}", markup=False, soft_wrap=True)


def _chosen(out: Path, preset: PresetName | None, config: Path | None, resume: bool) -> StudyConfig:
    if preset is not None and config is not None:
        raise InputError("--preset and --config: expected one of the two, got both; leave one out")
    if config is not None:
        return read_config(config)
    if preset is None and resume and (out / CONFIG).exists():
        return read_config(out / CONFIG)
    return PRESETS[preset or "quick"]
