"""`exosight calibrate`: the camera of a system file, from the device at rest or from a board."""

from pathlib import Path
from typing import Annotated

import tomli_w
import tyro

from exosight.app.commands.options import Json, MaybePath, Name, Number, Pixels
from exosight.app.console import check_json_target, say
from exosight.app.output import check_new_file
from exosight.errors import InputError
from exosight.files import write_new_file

Squares = Annotated[tuple[int, int] | None, tyro.conf.arg(metavar="COLUMNS ROWS", help_behavior_hint="")]
Corner = Annotated[tuple[float, float, float] | None, tyro.conf.arg(metavar="X Y Z", help_behavior_hint="")]


def calibrate(
    pictures: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="PICTURES")]],
    system: Annotated[Path, tyro.conf.arg(metavar="FILE")],
    out: MaybePath = None,
    board: Squares = None,
    square: Number = None,
    marker: Number = None,
    dictionary: Name = None,
    plane: Name = None,
    corner: Corner = None,
    crop: Pixels = None,
    masks: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    json: Json = None,
) -> None:
    """Find the camera of a system file from pictures of the device at rest, or of a ChArUco board.

    The device at rest, without loads: one picture says where the camera is, as its outline there is known. So
    a camera that was bumped is noticed, and the file mended. A pinhole keeps its lens.

    A board (--board), held in front of the camera: the first camera of the file becomes a pinhole with the
    focal length, principal point and distortion that explain the pictures best. Where it is follows from one
    picture in which the board stands in the plane in which the device moves (--plane); without one, direction
    and scale at the centre stay as the file says.

    Shown are 95 % intervals, and how far what was seen lies from where the camera shows it.

    Examples:
      exosight calibrate picture.png --system my_rig.toml
      exosight calibrate picture.png --system my_rig.toml --out moved.toml
      exosight calibrate pics --board 8 6 --square 0.02 --system a.toml --out b.toml

    Args:
        pictures: a picture, or a folder of them: of the device at rest, or of the board from several sides,
            then five at least
        system: the system file
        out: system file to write; by default none
        board: columns and rows of squares of the board
        square: with --board, side of a square [m]
        marker: with --board, side of a marker [m]; by default three quarters of a square
        dictionary: with --board, ArUco dictionary of the markers, such as 5X5_100; by default 4X4_50
        plane: with --board, the picture in which the board stands upright in or along the x–z plane and
            faces the camera, its upper edge along x
        corner: with --plane, where the board's upper left corner is there: x, y and z in the world [m]; by
            default 0 0 0
        crop: with --board, part of the pictures that the file's camera shows [pixels]; its height follows
            from the camera's aspect ratio; by default all
        masks: of the device: the pictures are masks, as of exosight identify
        json: write all numbers as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    if out is not None:
        if out.suffix != ".toml":
            raise InputError(f"--out: expected a file *.toml, got {str(out)!r}")
        check_new_file(out)
    of_boards = {"square": square, "marker": marker, "dictionary": dictionary, "plane": plane}
    of_boards |= {"corner": corner, "crop": crop}
    if board is None:
        for name, value in of_boards.items():
            if value is not None:
                raise InputError(f"--{name}: an option of boards; give --board, their columns and rows")
    elif square is None:
        raise InputError("--square: expected the side of the board's squares [m], got none; measure it")
    elif masks:
        raise InputError("--masks: an option of pictures of the device; leave it out with --board")
    elif corner is not None and plane is None:
        raise InputError("--corner: it has an effect with --plane alone; name the picture")
    # Here, so that --help and wrong options answer at once.
    from exosight.app.camera_calibration import at_rest, board_of, from_board
    from exosight.rig.folder import PictureFolder, open_folder
    from exosight.system.file import read_system_file

    values = read_system_file(system)
    is_file = pictures.is_file()
    folder = PictureFolder(pictures.parent, (pictures.name,)) if is_file else open_folder(pictures)
    if board is None:
        found = at_rest(values, folder, masks, json)
    else:
        assert square is not None
        sides = square, 0.75 * square if marker is None else marker
        chosen = board_of(board, sides, dictionary or "4X4_50")
        found = from_board(values, folder, chosen, plane, corner or (0.0, 0.0, 0.0), crop, json)
    if out is not None:
        write_new_file(out, tomli_w.dumps(found).encode())
        say(f"wrote {out}; exosight system show {out}")
