"""`exosight identify`: the model of a rig from pictures at known loads."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro
from jaxtyping import Float

from exosight.app.commands.options import NO_OPTIONS, ExosuitOptions, Json, SystemName
from exosight.app.console import check_json_target, progress, say, show_or_write
from exosight.app.output import check_new_file
from exosight.errors import InputError
from exosight.evaluation.tables import Cell, Column, Table
from exosight.exosuit.shapes import TABLE_I
from exosight.files import write_new_file

if TYPE_CHECKING:
    from exosight.rig.identification.result import Identification
    from exosight.system.file import Values

INDEX = "index"

Gain = Annotated[str | None, tyro.conf.arg(metavar='"X N/UNIT"', help_behavior_hint="")]


def identify(
    pictures: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FOLDER")]],
    loads: Path,
    out: Path,
    exosuit: Annotated[ExosuitOptions, tyro.conf.arg(name="")] = NO_OPTIONS,
    system: SystemName = INDEX,
    gain: Gain = None,
    masks: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    json: Json = None,
) -> None:
    """Find modulus, joints, links, mount, load gain and camera of a rig from pictures at known loads.

    The pictures show the device at rest at each load, the first one approached from no load, in the order of
    the table's rows. Outlines are found in them, and the model's parameters changed until its outlines agree,
    by least squares with priors. Shown are all parameters with 95 % intervals, what the pictures do not tell,
    and at which load a further picture would tell most. The fitted system is written as a system file, which
    every command takes (--system FILE); its vary tables hold the intervals that remain.

    The table is a CSV file with a row a picture: a column "u [N]" for each channel, readings of sensors such
    as "F_net [N]" where there are any, and perhaps a column `picture` with the names of the files.

    Examples:
      exosight identify pictures --loads loads.csv --out my_rig.toml
      exosight identify pictures --loads p.csv --gain "0.05 N/kPa" --out my_rig.toml
      exosight identify masks --masks --loads u.csv --system arm.toml --out rig.toml

    Args:
        pictures: folder of pictures, gray ones as exosight renders them, or masks
        loads: the table
        out: system file to write
        exosuit: the exosuit
        system: what to start from: index, or a system file, of which the sizes of rods and all radii hold
        gain: of loads in a unit of your own: about what one of it does; it is identified. The gains of a
            system file are identified too
        masks: the pictures are masks: 0 background, 1 the first tube of the system (of index the finger), 2
            the second one …, 255 what is not known
        json: write all numbers as JSON to a new file, or to stdout with "-", instead of tables
    """
    check_json_target(json)
    if out.suffix != ".toml":
        raise InputError(f"--out: expected a file *.toml, got {str(out)!r}")
    check_new_file(out)
    from exosight.rig.identification.files import open_pictures, read_measurements
    from exosight.rig.identification.result import identify as run
    from exosight.rig.table import read_table
    from exosight.system.build import build
    from exosight.system.file import describe

    table, folder = read_table(loads), open_pictures(pictures)
    if system == INDEX:
        first = folder.picture(0)
        preset = _index_values(exosuit, first.shape)
        values = preset if gain is None else _with_gain(preset, gain)
    else:
        exosuit.refuse("the system file says it all")
        preset = values = _file_values(system, gain)
    nominal = build(describe(values))
    with progress("reading pictures", "pictures") as update:
        measured = read_measurements(folder, table, nominal, masks, update)
    count = len(measured.outlines)
    with progress("fitting", "pictures") as update:
        found = run(values, measured, known_gains=False, done=lambda k: update(k, count))
    fitted = found.named(_name(out.stem))
    found = replace(found, values=fitted if gain is None else _as_driven(fitted, preset, measured.commands))
    write_new_file(out, found.toml.encode())
    show_or_write([_table(found)], _numbers(found), json)
    for sentence in _remarks(found, nominal.schema.channels[0].unit):
        say(sentence)
    say(f"wrote {out}; exosight system show {out}")


def _index_values(exosuit: ExosuitOptions, shape: tuple[int, ...]) -> "Values":
    """The file of the preset with this exosuit, its camera in the size of the pictures."""
    from exosight.exosuit.index_file import index_values
    from exosight.exosuit.published import NOMINAL_CAMERA
    from exosight.system.camera import resized

    return index_values(exosuit.exosuit(TABLE_I, INDEX), resized(NOMINAL_CAMERA, shape[1], shape[0]))


def _file_values(system: str, gain: str | None) -> "Values":
    if gain is not None:
        raise InputError("--gain: a system file states its gain; change it there")
    if not system.endswith(".toml"):
        raise InputError(
            f"system: expected {INDEX} or a system file *.toml, got {system!r}; systems with friction "
            "or contacts of spheres, as published has, are not identified"
        )
    from exosight.system.file import read_system_file

    return read_system_file(Path(system))


def _with_gain(values: "Values", gain: str) -> "Values":
    """The file of the preset with commands in another unit."""
    from exosight.system.units import split_quantity

    try:
        number, unit = split_quantity(gain, "0.05 N/kPa")
    except ValueError as error:
        raise InputError(f"--gain: {error}") from None
    force, _, own = unit.partition("/")
    if force != "N" or not own or number <= 0:
        raise InputError(f'--gain: expected newtons a unit of the loads, like "0.05 N/kPa", got {gain!r}')
    # Ten times as wide: the gain may be found to be smaller.
    return _scaled(values, number, own, 10.0)


def _as_driven(values: "Values", preset: "Values", commands: Float[np.ndarray, "pictures 1"]) -> "Values":
    """The fitted file of the preset, driven as far as the preset is in newtons, or as the pictures show."""
    from exosight.system.units import split_quantity

    (table,) = values["actuators"].values()
    gain, unit = split_quantity(table["gain"], "0.05 N/kPa")
    own = unit.partition("/")[2]
    driven = _scaled(preset, gain, own, 1.0, float(np.abs(commands).max()))
    return {**values, "actuators": driven["actuators"]}


def _scaled(preset: "Values", gain: float, own: str, times: float, least: float = 0.0) -> "Values":
    """The file of the preset with commands in a unit of which one does `gain` newtons.

    times, least   how many times as wide range and drive become, and how wide at least [own]
    """
    from exosight.system.units import split_quantity

    ((name, table),) = preset["actuators"].items()

    def scaled(text: str) -> str:
        number = times * split_quantity(text, "4 N")[0] / gain
        return f"{float(np.copysign(max(abs(number), least), number))!r} {own}"

    limits = {"range": [scaled(text) for text in table["range"]], "drive": scaled(table["drive"])}
    return {**preset, "actuators": {name: {**table, **limits, "gain": f"{gain!r} N/{own}"}}}


def _name(name: str) -> str:
    """A name that systems may have."""
    from pydantic import TypeAdapter, ValidationError

    from exosight.validation import Name

    try:
        TypeAdapter(Name).validate_python(name)
    except ValidationError:
        return "my_rig"
    return name


def _table(found: "Identification") -> Table:
    columns = (
        Column("entry"),
        Column("value"),
        Column("from"),
        Column("to"),
        Column("unit"),
        Column("of the prior", "%", digits=1),
    )
    rows: list[tuple[Cell, ...]] = [
        (each.entry, each.value, each.low, each.high, each.unit, 100 * each.share) for each in found.estimates
    ]
    known = found.posterior
    note = (
        f"95 % intervals, and their width in that of the prior; outlines fit to {known.noise:.2f} pixels, "
        f"{known.crowding:.1f} neighbouring points count as one"
    )
    return Table("estimates", "Parameters of the rig", columns, tuple(rows), note)


def _remarks(found: "Identification", unit: str) -> list[str]:
    """What stays open, which picture next, and what is doubtful."""
    said = []
    for direction in found.open:
        change = ", ".join(
            f"{entry} ×{by:.3g}" if by > 0 and _is_size(found, entry) else f"{entry} {by:+.3g}"
            for entry, by in direction.change.items()
        )
        said.append(
            f"the data do not tell this from no change ({100 * direction.share:.0f} % of the prior): {change}"
        )
    if np.isfinite(found.gains).any():
        best = int(np.nanargmax(found.gains))
        command = " ".join(f"{value:.3g}" for value in found.commands[best])
        said.append(f"a further picture would tell most at {command} {unit}: {found.gains[best]:.2f} nats")
    if not found.rested:
        said.append("the search did not come to rest; the estimates are the best found")
    if found.elsewhere:
        numbers = ", ".join(str(k + 1) for k in found.elsewhere)
        said.append(
            f"pictures {numbers} show another pose than the one that the loads lead to from rest; are rows "
            "missing, or in another order?"
        )
    return said


def _is_size(found: "Identification", entry: str) -> bool:
    return next(each.low > 0 for each in found.estimates if each.entry == entry)


def _numbers(found: "Identification") -> dict[str, Any]:
    gains = [None if np.isnan(gain) else float(gain) for gain in found.gains]
    return {
        "estimates": [vars(each) for each in found.estimates],
        "open": [vars(each) for each in found.open],
        "next": [
            {"command": command, "information_nats": gain}
            for command, gain in zip(found.commands.tolist(), gains, strict=True)
        ],
        "outline_noise_pixels": found.posterior.noise,
        "points_per_independent_one": found.posterior.crowding,
        "rested": found.rested,
        "other_pose": list(found.elsewhere),
    }
