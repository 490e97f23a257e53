"""`exosight export`: datasets and simulated paths for other programs."""

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
    poses: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Write a dataset or a simulated path in a format that other programs read.

    The ending of --out decides: .mat (MATLAB, Octave), .npz (NumPy), and for a dataset a folder with
    frames.csv and images/*.png, for a path .csv. What the arrays mean: docs/matlab.md, docs/conventions.md.

    Examples:
      exosight export --data results/data --out results/data.mat
      exosight export --data results/data --out results/tables
      exosight export --path path.json --out path.csv

    Args:
        out: file or folder to make; it must not exist
        data: folder of a dataset, from `exosight generate`
        path: file from `exosight simulate --json`, with the poses if it was made with --poses
        poses: of a dataset: add the centreline and the radii of every body in every frame [m]
    """
    from exosight.dataset.export import check_format, export_dataset, export_path

    if (data is None) == (path is None):
        raise InputError("expected one of --data and --path; see exosight export --help")
    if path is not None:
        if poses:
            raise InputError("--poses: it goes with --data; a path has them from exosight simulate --poses")
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
