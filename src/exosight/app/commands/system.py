"""`exosight system`: descriptions of systems, listed, shown, started and checked."""

from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

import tyro

from exosight.app.commands.options import Json, Plot
from exosight.app.console import check_json_target, say, show_or_write, waiting
from exosight.app.output import check_new_file, check_plot
from exosight.errors import InputError
from exosight.evaluation.tables import Column, Table
from exosight.files import write_new_file

Action = Annotated[
    Literal["list", "show", "new", "check"], tyro.conf.Positional, tyro.conf.arg(help_behavior_hint="")
]
Which = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME|FILE", help_behavior_hint="")]


def system(action: Action, name: Which = None, plot: Plot = None, json: Json = None) -> None:
    """List, show, start or check descriptions of systems: bodies, contacts, actuators, sensors, cameras.

    A system is a preset of this package or a file of your own; the format: docs/systems.md.

    Examples:
      exosight system list
      exosight system show published
      exosight system new my.toml
      exosight system check my.toml
      exosight system show my.toml --plot my.png

    Args:
        action: list the presets; show a system part by part; write a new file to start from; check
            a file and say in one sentence what is wrong in it and where
        name: the preset or file; for new, the file to write
        plot: of show: draw the unloaded system and its camera images, to a new file (PNG, PDF or SVG)
        json: of list and show: write what is shown as JSON to a new file, or to stdout with "-"
    """
    if (name is None) != (action == "list"):
        raise InputError(f"system {action}: expected {'no name' if name else 'a preset or a file after it'}")
    for option, value, actions in (("--plot", plot, ("show",)), ("--json", json, ("list", "show"))):
        if value is not None and action not in actions:
            raise InputError(f"{option}: it has no effect with {action}; see exosight system --help")
    check_json_target(json)
    if action == "list":
        _list(json)
    elif action == "new":
        _new(Path(name or ""))
    elif action == "check":
        _check(name or "")
    else:
        _show(name or "", plot, json)


def _list(json: str | None) -> None:
    from exosight.exosuit.catalogue import PRESETS

    columns = (Column("name"), Column("description"))
    presets = {name: about for name, (_, about) in PRESETS.items()}
    table = Table("presets", "Systems of this package", columns, tuple(presets.items()))
    show_or_write([table], {"presets": presets}, json)
    if json is None:
        say("a system of your own: exosight system new FILE.toml")


def _new(path: Path) -> None:
    if path.suffix != ".toml":
        raise InputError(f"system new: expected a file *.toml, got {str(path)!r}")
    check_new_file(path)
    write_new_file(path, (files("exosight.system") / "template.toml").read_bytes())
    say(f"wrote {path}; change it, then exosight system check {path}")


def _check(name: str) -> None:
    from exosight.exosuit.catalogue import find_system

    schema = find_system(name).schema
    parts = (
        _count(len(schema.channels), "channel"),
        _count(len(schema.sensors), "sensor"),
        f"{len(schema.outputs)} of them estimated from images",
        _count(len(schema.cameras), "camera"),
    )
    print(f"ok: {schema.system}: {', '.join(parts)}")


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _show(name: str, plot: Path | None, json: str | None) -> None:
    from exosight.app.system_tables import system_tables
    from exosight.exosuit.catalogue import find_system, nominal_system
    from exosight.system.designs import FileDesigns
    from exosight.system.schema import schema_to_dict

    check_plot(plot)
    designs = find_system(name)
    varied = designs.varied if isinstance(designs, FileDesigns) else ()
    nominal = nominal_system(name)
    tables = system_tables(nominal, varied)
    if plot is not None:
        from exosight.app.plots import write_plot
        from exosight.app.system_figure import system_figure

        with waiting("drawing"):
            figure = system_figure(nominal)
        write_plot(figure, plot)
    parts = {table.name: table.records() for table in tables}
    show_or_write(tables, {"schema": schema_to_dict(nominal.schema), "parts": parts}, json)
