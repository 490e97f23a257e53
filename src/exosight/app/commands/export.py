"""`exosight export`: datasets, simulated paths and recordings for other programs."""

from pathlib import Path
from typing import Annotated

import tyro

from exosight.app.commands.options import MaybePath
from exosight.app.console import progress, say
from exosight.app.output import check_new_file, new_folder
from exosight.errors import InputError


def export(
    out: Path,
    data: MaybePath = None,
    path: MaybePath = None,
    recording: MaybePath = None,
    poses: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Write a dataset, a simulated path or a recorded run in a format that other programs read.

    The ending of --out decides: .mat (MATLAB, Octave), .npz (NumPy), and for a dataset a folder with
    frames.csv and images/*.png, for a path .csv. What the arrays mean: docs/matlab.md, docs/conventions.md.
    A recording becomes .mcap, messages of ROS 2 that Foxglove, PlotJuggler and ROS read (docs/realtime.md).

    Examples:
      exosight export --data results/data --out results/data.mat
      exosight export --data results/data --out results/tables
      exosight export --path path.json --out path.csv
      exosight export --recording run.h5 --out run.mcap

    Args:
        out: file or folder to make; it must not exist
        data: folder of a dataset, from `exosight generate`
        path: file from `exosight simulate --json`, with the poses if it was made with --poses
        recording: file from `exosight live --record`
        poses: of a dataset: add the centreline and the radii of every body in every frame [m]
    """
    from exosight.dataset.export import check_format, export_dataset, export_path

    if sum(each is not None for each in (data, path, recording)) != 1:
        raise InputError("expected one of --data, --path and --recording; see exosight export --help")
    if poses and data is None:
        raise InputError("--poses: it goes with --data; a path has them from exosight simulate --poses")
    if recording is not None:
        from exosight.control.mcap import ENDING, export_recording
        from exosight.control.recording import read_recording

        check_format(out, (ENDING,))
        check_new_file(out)
        recorded = read_recording(recording)
        with progress("writing", "steps") as update:
            export_recording(recorded, out, update)
        say(f"wrote {len(recorded)} steps to {out}")
        return
    if path is not None:
        check_format(out, (".mat", ".npz", ".csv"))
        check_new_file(out)
        say(f"wrote {export_path(path, out)} loads to {out}")
        return
    assert data is not None
    check_format(out, (".mat", ".npz", ""))
    if out.suffix:
        check_new_file(out)
        frames = export_dataset(data, out, with_poses=poses)
    else:
        with new_folder(out) as folder, progress("writing", "pictures") as update:
            frames = export_dataset(data, folder, update, poses)
    say(f"wrote {frames} frames to {out}")
