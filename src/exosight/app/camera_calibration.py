"""`exosight calibrate`: what it finds of a camera, shown; from the device at rest, or from a board."""

from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from exosight.app.console import progress, say, show_or_write, waiting
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.rig.calibrated_camera import placed, with_camera, with_lens
from exosight.rig.charuco import Board, Calibration, View, calibrate, find_boards
from exosight.rig.folder import PictureFolder
from exosight.rig.identification.files import outline_of_system
from exosight.rig.identification.posterior import NORMAL_95
from exosight.rig.identification.registered import LARGEST_MISFIT, Registered, register
from exosight.system.build import build
from exosight.system.camera import Camera
from exosight.system.file import Values, describe
from exosight.validation import first_fault
from exosight.vision.pictures import Crop

NAMED = 5
"""Pictures that a note names at most."""


def at_rest(values: Values, folder: PictureFolder, masks: bool, json: str | None) -> Values:
    """The file with the camera where pictures of the device at rest show it."""
    nominal = build(describe(values))
    with progress("reading pictures", "pictures") as update:
        outlines = []
        for place, name in enumerate(folder.names):
            picture, path = folder.picture(place), str(folder.root / name)
            outlines.append(outline_of_system(picture, nominal, masks, path))
            update(place + 1, len(folder.names))
    with waiting("fitting the camera"):
        found = register(values, tuple(outlines))
    show_or_write([_changes(found)], _rest_numbers(found), json)
    millimetres = 1e3 * found.away * found.before.metres_per_pixel
    words = f"the device at rest lies {found.away:.2f} pixels ({millimetres:.2f} mm) from where the file says"
    if found.moved:
        say(f"the camera has moved: {words}; refined estimates allow for less, and networks may be off")
    else:
        say(f"the camera has not moved beyond what refined estimates allow for: {words}")
    if found.misfit > LARGEST_MISFIT:
        say(
            f"the outline fits to {found.misfit:.1f} pixels only; is the device at rest, and is it that of "
            "the file?"
        )
    return found.values


def _changes(found: Registered) -> Table:
    columns = (
        *(Column("entry"), Column("change"), Column("from"), Column("to"), Column("unit")),
        Column("moved"),
    )
    rows = tuple(
        (
            each.entry,
            each.by,
            each.by - each.half,
            each.by + each.half,
            each.unit,
            "yes" if each.clear else "",
        )
        for each in found.changes
    )
    note = (
        f"95 % intervals; the outline fits to {found.misfit:.2f} pixels; moved: beyond the interval and "
        "what refined estimates allow for"
    )
    return Table("camera", "What has changed of the camera", columns, rows, note)


def _rest_numbers(found: Registered) -> dict[str, Any]:
    return {
        "moved": found.moved,
        "changes": [vars(each) for each in found.changes],
        "device_displacement_pixels": found.away,
        "outline_misfit_pixels": found.misfit,
        "camera": _camera(found.after),
    }


def board_of(squares: tuple[int, int], sides: tuple[float, float], dictionary: str) -> Board:
    """The board of options; InputError for one that there is not.

    sides   of squares and of markers [m]
    """
    try:
        return Board(squares, *sides, dictionary)
    except ValidationError as error:
        raise InputError(f"board: {first_fault(error)}") from None


def from_board(
    values: Values,
    folder: PictureFolder,
    board: Board,
    plane: str | None,
    corner: tuple[float, float, float],
    crop: Crop | None,
    json: str | None,
) -> Values:
    """The file with the camera that shows a board as the pictures do."""
    name, camera = build(describe(values)).cameras[0]
    if plane is not None and plane not in folder.names:
        raise InputError(f"--plane: expected a picture in {folder.root}, got {plane!r}")
    with progress("looking for the board", "pictures") as update:
        views, size = find_boards(folder, board, update)
    seen = [view.name for view in views]
    _say_missing([file for file in folder.names if file not in seen])
    found = calibrate(views, board, size)
    camera = with_lens(camera, found, crop)
    if plane is not None:
        if plane not in seen:
            raise InputError(f"--plane: {plane} does not show the board; choose a picture that does")
        at = seen.index(plane)
        camera = placed(camera, found.rotations[at], found.translations[at], corner)
    show_or_write([_lens(found), _views(found, views)], _numbers(found, views, camera), json)
    return with_camera(values, name, camera)


def _say_missing(names: list[str]) -> None:
    if names:
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        say(f"left out, as they do not show the board: {', '.join(names[:NAMED])}{more}")


def _lens(found: Calibration) -> Table:
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
    shown = tuple((what, at, at - NORMAL_95 * sd, at + NORMAL_95 * sd, unit) for what, at, sd, unit in rows)
    return Table("lens", "The camera's lens", columns, shown, note)


def _views(found: Calibration, views: tuple[View, ...]) -> Table:
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


def _numbers(found: Calibration, views: tuple[View, ...], camera: Camera) -> dict[str, Any]:
    return {
        "focal_length_pixels": found.focal_length[0],
        "focal_length_deviation_pixels": found.focal_length[1],
        "principal_point_pixels": found.principal[0].tolist(),
        "principal_point_deviation_pixels": found.principal[1].tolist(),
        "radial_distortion": found.radial[0],
        "radial_distortion_deviation": found.radial[1],
        "reprojection_error_pixels": found.error,
        "views": _views(found, views).records(),
        "camera": _camera(camera),
    }


def _camera(camera: Camera) -> dict[str, Any]:
    return TypeAdapter(Camera).dump_python(camera, mode="json")
