"""`exosight generate`: a dataset from simulation."""

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from exosight.app.commands.options import Json
from exosight.app.console import check_json_target, progress, say, write_json
from exosight.dataset.config import GenerateConfig

DEFAULT = GenerateConfig()

RARE = 0.01
"""A zone that is touched in a smaller share of the frames is named."""

MaybeAddress = Annotated[str | None, tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="")]


def generate(
    out: Path,
    config: Annotated[GenerateConfig, tyro.conf.arg(name="")] = DEFAULT,
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    workers: Annotated[int, Field(ge=1, le=1024)] = 1,
    scheduler: MaybeAddress = None,
    json: Json = None,
) -> None:
    """Simulate, render and store designs of a system, each driven from rest along a load path and back.

    Of the published system these are exosuits of all eleven scenarios, driven 0 → 4 → 0 N: the paper's
    dataset is --per-scenario 125 (1375 shapes, 68,750 frames). Of a system file (--system FILE) they are
    --designs that differ in what the file's vary tables say; with several channels each is driven over
    waypoints of its own.

    The folder also holds all that makes it again (manifest.json) and a card (README.md); frames left out are
    counted by cause, and zones that are hardly ever touched are named. Stopped at any moment, the same
    command with --resume goes on; it also mends damaged files.

    Light and pictures are the nominal ones unless --lighting and --appearance let them vary, and so are the
    published system's fingers and exosuits unless --plant does; what was drawn is kept with each frame
    (docs/variation.md).

    Examples:
      exosight generate --out results/data --per-scenario 10
      exosight generate --out results/varied --plant.young 0.5 2 --lighting.lamp 0.5
      exosight generate --out results/thumb --system thumb.toml --designs 100

    Args:
        out: folder to make; it must not exist, unless --resume
        config: what the dataset is made of
        resume: go on with the dataset that the folder holds; what is whole is not made again
        workers: processes on this machine; one uses up to eight cores. More need the extra 'cluster'
        scheduler: a running Dask cluster to work on, such as tcp://node:8786, instead of workers
        json: write the counts as JSON to a new file, or to stdout with "-"
    """
    check_json_target(json)
    # Here, so that --help and wrong options answer at once: JAX takes a second to import.
    from exosight.dataset import read_sensors
    from exosight.dataset.generation import generate as run
    from exosight.evaluation.details import touching_shares

    with progress("simulating", "designs") as update:
        manifest = run(config, out, update, resume=resume, workers=workers, scheduler=scheduler)
    say(f"wrote {manifest.frames} frames of {len(manifest.designs)} designs to {out}")
    for cause, count in manifest.dropped.items():
        say(f"  dropped, {cause.replace('_', ' ')}: {count}")
    touching = touching_shares(manifest.schema, read_sensors(out))
    rare = [name for name, share in touching.items() if share < RARE]
    if rare:
        say(
            f"  touched in less than {100 * RARE:g} % of the frames: {', '.join(rare)}; a network cannot "
            "learn what hardly happens: change the system, its zones or the ranges of its channels"
        )
    if json is not None:
        counts = {"frames": manifest.frames, "designs": len(manifest.designs), "dropped": manifest.dropped}
        counts["touching"] = touching
        write_json({"folder": str(out), **counts}, json)
