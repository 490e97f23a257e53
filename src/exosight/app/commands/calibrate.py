"""`exosight calibrate`: the camera of a system file, from pictures of a board."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tomli_w
import tyro
from pydantic import ValidationError

from exosight.app.commands.options import Json, Name, Number, Pixels
from exosight.app.console import check_json_target, progress, say, show_or_write
from exosight.app.output import check_new_file
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.files import write_new_file
from exosight.validation import first_fault

if TYPE_CHECKING:
    from exosight.rig.charuco import Calibration, View
    from exosight.system.camera import Camera

Squares = Annotated[tuple[int, int], tyro.conf.arg(metavar="COLUMNS ROWS")]
Metres = Annotated[float, tyro.conf.arg(metavar="M")]
Corner = Annotated[tuple[float, float, float], tyro.conf.arg(metavar="X Y Z")]
NAMED = 5
"""Pictures that a note names at most."""


def calibrate(
    pictures: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FOLDER")]],
    board: Squares,
    square: Metres,
    system: Annotated[Path, tyro.conf.arg(metavar="FILE")],
    out: Path,
    marker: Number = None,
    dictionary: str = "4X4_50",
    plane: Name = None,
    corner: Corner = (0.0, 0.0, 0.0),
    crop: Pixels = None,
    json: Json = None,
) -> None:
    """Calibrate the camera of a system file from pictures of a ChArUco board, held in front of it.

    The first camera of the file becomes a pinhole with the focal length, principal point and distortion that
    explain the pictures best. Where it is follows from one picture in which the board stands in the plane in
    which the device moves (--plane); without one, direction and scale at the centre stay as the file says.
    The board may be cut off by the picture, but at least eight of its inner corners must be in it.

    Shown are these with 95 % intervals, and the distances between corners and where the camera expects
    them: some tenths of a pixel are usual; a larger one is of a bent board, blur, or a lens that bends more
    than one coefficient says.

    Examples:
      exosight calibrate pics --board 8 6 --square 0.02 --system a.toml --out b.toml

    Args:
        pictures: folder of pictures of the board from several sides, five at least; all of one size
        board: columns and rows of squares of the board
        square: side of a square [m]
        system: the system file
        out: system file to write
        marker: side of a marker [m]; by default three quarters of a square
        dictionary: ArUco dictionary of the markers, such as 4X4_50, 5X5_100 or 6X6_250
        plane: the picture in which the board stands upright in or along the x–z plane and faces the camera,
            its upper edge along x
        corner: with --plane, where the board's upper left corner is there: x, y and z in the world [m]
        crop: part of the pictures that the file's camera shows [pixels]; its height follows from the
            camera's aspect ratio; by default all
        json: write all numbers as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    if out.suffix != ".toml":
        raise InputError(f"--out: expected a file *.toml, got {str(out)!r}")
    check_new_file(out)
    from exosight.rig.calibrated_camera import placed, with_camera, with_lens
    from exosight.rig.charuco import Board, find_boards
    from exosight.rig.charuco import calibrate as run
    from exosight.rig.folder import open_folder
    from exosight.system.build import build
    from exosight.system.file import describe, read_system_file

    values = read_system_file(system)
    name, camera = build(describe(values)).cameras[0]
    try:
        chosen = Board(board, square, 0.75 * square if marker is None else marker, dictionary)
    except ValidationError as error:
        raise InputError(f"board: {first_fault(error)}") from None
    folder = open_folder(pictures)
    if plane is not None and plane not in folder.names:
        raise InputError(f"--plane: expected a picture in {pictures}, got {plane!r}")
    with progress("looking for the board", "pictures") as update:
        views, size = find_boards(folder, chosen, update)
    seen = [view.name for view in views]
    _say_missing([file for file in folder.names if file not in seen])
    found = run(views, chosen, size)
    camera = with_lens(camera, found, crop)
    if plane is not None:
        if plane not in seen:
            raise InputError(f"--plane: {plane} does not show the board; choose a picture that does")
        at = seen.index(plane)
        camera = placed(camera, found.rotations[at], found.translations[at], corner)
    write_new_file(out, tomli_w.dumps(with_camera(values, name, camera)).encode())
    show_or_write([_lens(found), _views(found, views)], _numbers(found, views, camera), json)
    say(f"wrote {out}; exosight system show {out}")


def _say_missing(names: list[str]) -> None:
    if names:
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        say(f"left out, as they do not show the board: {', '.join(names[:NAMED])}{more}")


def _lens(found: "Calibration") -> Table:
    columns = (Column("lens"), Column("value"), Column("from"), Column("to"), Column("unit"))
    (focal, own), (radial, bent) = found.focal_length, found.radial
    rows = [("focal length", focal, own, "pixels")]
    middles, errors = found.principal
    for side, middle, error in zip(("column", "row"), middles.tolist(), errors.tolist(), strict=True):
        rows.append((f"principal point, {side}", middle, error, "pixels"))
    rows.append(("distortion k₁", radial, bent, ""))
    width, height = found.size
    view = 2 * np.degrees(np.arctan(np.array(found.size) / 2 / focal))
    note = (
        f"95 % intervals; pictures of {width}×{height} pixels, which show {view[0]:.1f}° × {view[1]:.1f}°; "
        f"corners lie {found.error:.2f} pixels (RMS) from where the camera expects them"
    )
    shown = tuple((what, at, at - 1.96 * sd, at + 1.96 * sd, unit) for what, at, sd, unit in rows)
    return Table("lens", "The camera's lens", columns, shown, note)


def _views(found: "Calibration", views: "tuple[View, ...]") -> Table:
    columns = (
        *(Column("picture"), Column("corners")),
        *(Column("distance", "mm", digits=1), Column("tilt", "deg", digits=1)),
        Column("error", "pixels", digits=2),
    )
    rows = zip(
        [view.name for view in views],
        [len(view.ids) for view in views],
        (1e3 * found.translations[:, 2]).tolist(),
        np.degrees(found.tilts).tolist(),
        found.errors.tolist(),
        strict=True,
    )
    return Table("views", "Where the board was", columns, tuple(rows))


def _numbers(found: "Calibration", views: "tuple[View, ...]", camera: "Camera") -> dict[str, Any]:
    from pydantic import TypeAdapter

    from exosight.system.camera import Camera

    return {
        "focal_length_pixels": found.focal_length[0],
        "focal_length_deviation_pixels": found.focal_length[1],
        "principal_point_pixels": found.principal[0].tolist(),
        "principal_point_deviation_pixels": found.principal[1].tolist(),
        "radial_distortion": found.radial[0],
        "radial_distortion_deviation": found.radial[1],
        "reprojection_error_pixels": found.error,
        "views": _views(found, views).records(),
        "camera": TypeAdapter(Camera).dump_python(camera, mode="json"),
    }
