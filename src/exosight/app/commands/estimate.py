"""`exosight estimate`: forces and other sensors from pictures."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from exosight.app.commands.options import PUBLISHED, Json, MaybePath, Pixels, Plot, SystemName
from exosight.app.console import check_json_target, say, show, write_json
from exosight.app.output import check_plot
from exosight.errors import DataError, ExosightError, InputError
from exosight.evaluation.naming import common_unit, forces_only, kind, row_name, sums
from exosight.evaluation.tables import Column, Table

INDEX = "index"
"""Whose network reads pictures of a system file, if no other is named."""

if TYPE_CHECKING:
    from exosight.control.estimator import Reading
    from exosight.system.schema import Schema


def estimate(
    images: tyro.conf.Positional[Annotated[tuple[Path, ...], tyro.conf.arg(metavar="IMAGE …")]],
    system: SystemName = PUBLISHED,
    model: MaybePath = None,
    level: float = 0.9,
    crop: Pixels = None,
    loads: MaybePath = None,
    masks: MaybePath = None,
    plot: Plot = None,
    json: Json = None,
) -> None:
    """Estimate contact forces, and other sensors of a system, from pictures, with intervals and OOD scores.

    A picture is made gray and brought to the size that the network takes. It should show the system as
    the network's camera does; for the shipped network: side view, finger to the right, bright background.
    A picture that cannot be read is named with the reason, the others are estimated, and the exit status is
    2.

    With the model of a rig (exosight identify) and the loads of the pictures, a few Gauss-Newton steps on
    each picture's outline find pose and forces as well. Both are shown, and whether they agree.

    Examples:
      exosight estimate image.png
      exosight estimate frames/*.png --json -
      exosight estimate photo_640x480.png --crop 80 0 480
      exosight estimate frames/*.png --system my_rig.toml --loads loads.csv

    Args:
        images: picture files (PNG, JPEG, TIFF)
        system: preset whose network reads the pictures, if no other is named; with --loads a system file
        model: exported network, from `exosight train`; the package's own for the system if left out
        level: share of true values that the intervals are to hold: 0.5, 0.8, 0.9, 0.95 or 0.99
        crop: part of each picture that the network gets [pixels]; its height follows from the network's
            aspect ratio; default: of the camera that it learned from the part that was imported, of others
            all of it
        loads: table (CSV) with the load of each picture, as exosight identify takes it
        masks: folder with a mask of each picture, of its name, as exosight identify takes them; default:
            outlines are found in the pictures
        plot: draw the estimates with their intervals over the pictures, to a new file (PNG, PDF or SVG)
        json: write the estimates as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    check_plot(plot)
    from exosight.control.estimator import SHIPPED_MODELS, OnnxEstimator, model_path
    from exosight.control.trust import as_json, trust
    from exosight.vision.pictures import read_gray

    if not images:
        raise InputError("estimate: expected at least one picture, got none; see exosight estimate --help")
    refines = system.endswith(".toml")
    if refines != (loads is not None) or (masks is not None and loads is None):
        raise InputError("estimate: expected --loads together with a system file, --system my_rig.toml")
    if system not in SHIPPED_MODELS and not refines:
        raise InputError(
            f"system: expected {', '.join(SHIPPED_MODELS)}, got {system!r}; for another give --model alone"
        )
    estimator = OnnxEstimator.load(model_path(model, INDEX if refines else system), alone=True)
    schema = estimator.card.schema
    height, width = estimator.card.schema.image_size
    refinement = None
    if loads is not None:
        from exosight.app.refining import Refinement

        refinement = Refinement(system, loads, masks, images, schema, sums(schema))
    found, failures, readings = [], [], []
    for path in images:
        try:
            picture = read_gray(path, width, height, crop or estimator.crop)
        except ExosightError as error:
            failures.append({"image": str(path), "reason": str(error)})
            if len(images) > 1:
                say(f"not read: {error}")
            continue
        read = estimator.read(picture[None], level)
        readings.append(read)
        rows, totals = _rows(schema, read), _totals(schema, read)
        judged = trust(estimator.card, read)
        named = {f"{name}_{schema.sensor(name).unit}": total for name, total in totals.items()}
        found.append({"image": str(path), **named, **as_json(read, judged), f"{kind(schema)}s": rows})
        beside = None
        if refinement is not None:
            try:
                beside = refinement.read(path, read, level)
            except ExosightError as error:
                failures.append({"image": str(path), "reason": str(error)})
                if len(images) > 1:
                    say(f"not refined: {error}")
            else:
                found[-1]["refined"] = beside.as_json(schema)
        if json is None:
            caption = f"{path}, {100 * level:g} % intervals"
            show(_table(schema, caption, rows, totals))
            say(judged.words)
            if beside is not None:
                values = dict(zip(schema.outputs, read.forces[0].tolist(), strict=True)) | totals
                show(beside.table(schema, values, f"{path}, network and model"))
                if beside.agreement.score > 1:
                    say(
                        "do not trust these: network and model disagree (disagreement score "
                        f"{beside.agreement.score:.2f}, agree up to 1)"
                    )
    if plot is not None and readings:
        from exosight.app.plots import plot_estimates, write_plot

        write_plot(plot_estimates(schema, readings), plot)
    if json is not None:
        write_json({"level": level, "estimates": found, "failures": failures}, json)
    if len(images) == 1 and failures:
        raise DataError(failures[0]["reason"])
    if failures:
        raise DataError(
            f"{len(failures)} of {len(images)} pictures could not be read or refined; each is named above"
        )


def _rows(schema: "Schema", read: "Reading") -> list[dict[str, str | float | None]]:
    """One an estimated sensor; keys name quantity and unit."""
    values, low, high, contact = (
        np.round(x[0].astype(float), digits).tolist()
        for x, digits in ((read.forces, 6), (read.low, 6), (read.high, 6), (read.contact, 4))
    )
    rows: list[dict[str, str | float | None]] = []
    for i, sensor in enumerate(schema.estimated):
        unit, is_force = sensor.unit, not sensor.signed
        rows.append(
            {
                kind(schema): sensor.name,
                f"{'force' if is_force else 'value'}_{unit}": values[i],
                f"low_{unit}": low[i],
                f"high_{unit}": high[i],
                **({"contact_probability": contact[i]} if is_force else {}),
            }
        )
    return rows


def _totals(schema: "Schema", read: "Reading") -> dict[str, float]:
    """The sums of estimated sensors, such as the net force, by name."""
    return {name: round(float(read.forces[0] @ schema.weights(name)), 6) for name in sums(schema)}


def _table(
    schema: "Schema", caption: str, rows: list[dict[str, str | float | None]], totals: dict[str, float]
) -> Table:
    unit = common_unit(schema)
    touching = [Column("contact probability", digits=2)] * any(not s.signed for s in schema.estimated)
    columns = (
        Column(kind(schema)),
        Column("force" if forces_only(schema) else "value", unit, digits=3),
        Column("from", unit, digits=3),
        Column("to", unit, digits=3),
        *touching,
    )
    cells = []
    for name, row in zip(schema.outputs, rows, strict=True):
        values = list(row.values())[1:]
        cells.append((row_name(schema, name), *values, *[None] * (len(columns) - 1 - len(values))))
    note = ", ".join(f"{name} {total:.3f} {schema.sensor(name).unit}" for name, total in totals.items())
    return Table("estimates", caption, columns, tuple(cells), note)
