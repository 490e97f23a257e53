"""`exosight import`: a dataset from pictures and readings of one's own."""

from pathlib import Path
from typing import Annotated

import tyro

from exosight.app.commands.options import Json, MaybePath
from exosight.app.console import check_json_target, progress, say, write_json
from exosight.rig.importing import ImportConfig, prepare, store

DEFAULT = ImportConfig()


def import_(
    source: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="PICTURES")]],
    out: Path,
    table: MaybePath = None,
    times: MaybePath = None,
    config: Annotated[ImportConfig, tyro.conf.arg(name="")] = DEFAULT,
    drop_incomplete: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    json: Json = None,
) -> None:
    """Make a dataset of pictures of a real system and a table of what its instruments read.

    Pictures are a folder of files, a video, a .mat file, a LeRobot dataset, or recordings of ROS (rosbag,
    rosbag2, MCAP), of which a folder may hold several. Readings are a CSV file whose headings have units,
    like "thumb [N]", the variables of the .mat file, the features of the LeRobot dataset, or what the
    recordings hold: wrenches, pressures, joints and numbers; known units are converted to SI. The dataset is
    one like any other: exosight train, evaluate and export take it, and live, replay, estimate and the lab
    take the network. It is divided by sequences, so that a network is tested on recordings that it has not
    seen.

    Pictures are stored as gray values. Stopped at any moment, the same command with --resume goes on.

    Examples:
      exosight import pictures --table forces.csv --out results/rig
      exosight import run.mp4 --table forces.csv --tolerance 0.02 --out results/rig
      exosight import data.mat --order HWN --unit N --out results/rig
      exosight import bags --images /camera/image_raw --out results/rig
      exosight import lerobot --sensors "ft_fz [N]" --out results/rig

    Args:
        source: folder of pictures, video, .mat file, LeRobot dataset, recording of ROS, or folder of such
            recordings
        out: folder to make; it must not exist, unless --resume
        table: readings (CSV), a row a picture, or with times; by default the one CSV file in the folder, or
            what the .mat file, the dataset or the recordings hold
        times: when each picture was taken (CSV with the columns picture and time)
        config: what is made of them
        drop_incomplete: leave out pictures that have no row, an empty cell in it, or cannot be read
        resume: go on with the dataset that the folder holds; what is whole is not made again
        json: write what was imported as JSON to a new file, or to stdout with "-"
    """
    check_json_target(json)
    with prepare(source, config, table, times, drop=drop_incomplete) as found:
        for note in found.notes:
            say(note)
        with progress("importing", "pictures") as update:
            manifest = store(found, out, update, resume=resume, drop=drop_incomplete)
    for note in found.pictures.notes:
        say(note)
    say(f"wrote {manifest.frames} frames of {len(manifest.designs)} sequences to {out}")
    for cause, count in manifest.dropped.items():
        if count:
            say(f"  left out, {cause.replace('_', ' ')}: {count}")
    if json is not None:
        write_json(
            {
                "folder": str(out),
                "frames": manifest.frames,
                "sequences": len(manifest.designs),
                "sensors": {sensor.name: sensor.unit for sensor in manifest.schema.sensors},
                "commands": {channel.name: channel.unit for channel in manifest.schema.channels},
                "dropped": manifest.dropped,
                "notes": [*found.notes, *found.pictures.notes],
            },
            json,
        )
