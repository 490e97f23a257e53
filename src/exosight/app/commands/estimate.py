"""`exosight estimate`: contact forces from pictures."""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from exosight.app.commands.options import Json, MaybePath
from exosight.app.console import check_json_target, say, show, write_json
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table


def estimate(
    images: tyro.conf.Positional[Annotated[tuple[Path, ...], tyro.conf.arg(metavar="IMAGE …")]],
    model: MaybePath = None,
    level: float = 0.9,
    json: Json = None,
) -> None:
    """Read the contact forces on C1 to C7 off pictures, with intervals, and say whether to trust them.

    A picture is made gray and brought to the size that the network takes. It should show the plant as the
    network's camera does: side view, finger to the right, on a bright background.

    Example:
      exosight estimate image.png
      exosight estimate frames/*.png --json -

    Args:
        images: picture files (PNG, JPEG, TIFF)
        model: exported network, from `exosight train`; the one that comes with the package if left out
        level: share of true forces that the intervals are to hold: 0.5, 0.8, 0.9, 0.95 or 0.99
        json: write the estimates as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    from exosight.control.estimator import DEFAULT_MODEL, OnnxEstimator
    from exosight.vision.pictures import read_gray

    if not images:
        raise InputError("estimate: expected at least one picture, got none; see exosight estimate --help")
    estimator = OnnxEstimator.load(model or DEFAULT_MODEL, alone=True)
    card = estimator.card
    found = []
    for path in images:
        picture = read_gray(path, card.image_width, card.image_height)
        read = estimator.read(picture[None], level)
        rows = [
            {"contact": name, "force_N": force, "low_N": low, "high_N": high, "contact_probability": chance}
            for name, force, low, high, chance in zip(
                card.contacts,
                *(np.round(x[0].astype(float), 6).tolist() for x in (read.forces, read.low, read.high)),
                np.round(read.contact[0].astype(float), 4).tolist(),
                strict=True,
            )
        ]
        ood_score = round(float(read.ood_score[0]), 3)
        net = round(float(read.forces.sum()), 6)
        found.append({"image": str(path), "F_net_N": net, "ood_score": ood_score, "contacts": rows})
        if json is None:
            cells = tuple(tuple(row.values()) for row in rows)
            note = f"F_net {net:.3f} N"
            show(Table("forces", f"{path}, {100 * level:g} % intervals", _COLUMNS, cells, note))
            if ood_score > 1:
                say(
                    f"do not trust these: the picture is unlike those learned from (score {ood_score:g}, "
                    "trusted up to 1)"
                )
    if json is not None:
        write_json({"level": level, "estimates": found}, json)


_COLUMNS = (
    Column("contact"),
    Column("force", "N", digits=3),
    Column("from", "N", digits=3),
    Column("to", "N", digits=3),
    Column("contact probability", digits=2),
)
