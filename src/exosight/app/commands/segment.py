"""`exosight segment`: masks of the bodies in photographs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import cv2
import numpy as np
import tyro
from jaxtyping import Float

from exosight.app.commands.options import Json, MaybePath, Plot, SystemName
from exosight.app.console import check_json_target, progress, results_folder, say, show_or_write
from exosight.app.output import check_plot
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.files import read_file
from exosight.vision.pictures import LARGEST_FILE, decode_colour

if TYPE_CHECKING:
    from exosight.system.system import System

Colours = Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="R,G,B R,G,B …", help_behavior_hint="")]
DOUBTFUL = 0.9
"""Score below which a mask is to be looked at."""
SHOWN = 6
"""Pictures in a figure at most."""


def segment(
    pictures: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="PICTURES")]],
    out: Path,
    empty: MaybePath = None,
    system: SystemName = "index",
    colours: Colours = None,
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Find the bodies in photographs: a mask for each picture, as identify and estimate take it (--masks).

    A picture of the empty scene (--empty), by the same camera in the same light, says what is background;
    the bodies' colours say which is which. Without it, whatever has a body's colour counts as the body, which
    needs a background without them. Colour pictures are best: in gray ones shadows look like dark bodies.

    Every body of every picture gets a score, 0 to 1: the share of its pixels that fit its colour, times that
    in one piece, times that of its border on which the picture has an edge. Look at masks with low ones.

    Examples:
      exosight segment photos --colours 225,160,130 40,60,150 --out masks
      exosight segment photos --empty empty.png --system my.toml --out masks

    Args:
        pictures: a picture, or a folder of them
        out: folder to make, with a mask for each picture, under its name: 0 background, 1 the first tube of
            the system, 2 the second one …, 255 what is not known
        empty: picture of the scene without the device
        system: whose tubes they are: index, or a system file
        colours: red, green and blue of each tube's brightest place in the pictures, 0…255, in the system's
            order; by default the system's grays
        plot: draw pictures with what was found to a new file (PNG, PDF or SVG), six at most
        json: write the scores as JSON to a new file, or to stdout with "-", instead of a table
    """
    check_json_target(json)
    check_plot(plot)
    from exosight.exosuit.catalogue import nominal_system
    from exosight.rig.folder import PictureFolder, open_folder
    from exosight.rig.segmentation import segment as run

    described = nominal_system(system)
    wanted = _colours(colours, described)
    single = pictures.is_file()
    folder = PictureFolder(pictures.parent, (pictures.name,)) if single else open_folder(pictures)
    scene = None if empty is None else _read(empty)
    names = tuple(tube.name for tube in described.tubes)
    scores, drawn = [], []
    with results_folder(out) as place:
        assert place is not None
        with progress("segmenting", "pictures") as update:
            for k, name in enumerate(folder.names):
                picture = _read(folder.root / name)
                found = run(picture, wanted, scene, str(folder.root / name))
                file = (place / name).with_suffix(".png")
                file.parent.mkdir(parents=True, exist_ok=True)
                if file.exists():
                    raise InputError(f"{folder.root / name}: another picture has its name but for the ending")
                cv2.imwrite(str(file), found.mask)
                scores.append(found.scores)
                if k < SHOWN:
                    drawn.append((name, picture, found.mask))
                update(k + 1, len(folder.names))
    if plot is not None:
        from exosight.app.mask_figure import mask_figure
        from exosight.app.plots import write_plot

        write_plot(mask_figure(drawn, names), plot)
    columns = (Column("picture"), *(Column(name, digits=2) for name in names))
    rows = tuple((name, *each.tolist()) for name, each in zip(folder.names, scores, strict=True))
    table = Table("scores", "Scores of the masks", columns, rows, "0 to 1")
    show_or_write([table], {"scores": table.records()}, json)
    low = [name for name, each in zip(folder.names, scores, strict=True) if each.min() < DOUBTFUL]
    if low:
        count = f"{len(low)} of {len(scores)} masks have"
        say(f"{count} a score below {DOUBTFUL}, the first of {low[0]}; look at it")


def _read(path: Path) -> np.ndarray:
    return decode_colour(read_file(path, LARGEST_FILE, "expected a picture"), str(path))


def _colours(colours: tuple[str, ...] | None, system: "System") -> Float[np.ndarray, "bodies 3"]:
    if colours is None:
        return np.array([[255 * tube.shade] * 3 for tube in system.tubes])
    if len(colours) != len(system.tubes):
        names = ", ".join(tube.name for tube in system.tubes)
        raise InputError(f"--colours: expected one for each of {names}, got {len(colours)}")
    found = []
    for text in colours:
        parts = text.split(",")
        if len(parts) != 3 or not all(part.isdecimal() and int(part) < 256 for part in parts):
            raise InputError(
                f"--colours: expected red,green,blue of 0 to 255, like 225,160,130, got {text!r}"
            )
        found.append([float(part) for part in parts])
    return np.array(found)
