"""`exosight lab`: a local page of sliders."""

import threading
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from exosight.app.commands.options import MaybePath, SystemName
from exosight.app.console import say, waiting
from exosight.app.output import new_folder
from exosight.errors import InputError
from exosight.lab.settings import CameraSettings, Finite, View

if TYPE_CHECKING:
    from exosight.lab.system import LabSystem

NOMINAL_CAMERA = CameraSettings()


def lab(
    camera: Annotated[CameraSettings, tyro.conf.arg(name="")] = NOMINAL_CAMERA,
    system: SystemName = "index",
    model: MaybePath = None,
    vary: tuple[str, ...] = (),
    drive: tuple[Finite, ...] = (),
    host: str = "127.0.0.1",
    port: Annotated[int, Field(ge=0, le=65535)] = 8765,
    browser: bool = True,
    out: MaybePath = None,
) -> None:
    """Open a page on which sliders move a system, its picture and its readings, and a closed loop runs.

    Needs the extra 'lab', but no network: the page is served by this machine, to this machine. Bound to any
    other host it demands a token, which is part of the address that is printed.

    Examples:
      exosight lab
      exosight lab --vary family=sine "r0=8 mm" a=-5 --drive 4 2.4
      exosight lab --system thumb.toml --vary "rods.sleeve.young=250 kPa"
      exosight lab --drive 2.4 --out results/view

    Args:
        camera: what its camera does
        system: name of a preset, or a system file (*.toml)
        model: network that reads the pictures; by default the package's own for the system
        vary: values of the design, as NAME=VALUE: of a system file the entries that vary; of a preset the
            family of its shape, its parameters (r0, r1, a, b_0 …), length, young, gap, finger_length,
            finger_radius and joint_stiffness, with friction also friction
        drive: commands driven to one after the other, from rest, one a channel for each stop [the channels'
            units]; the last stop is seen. By default 60 % of the first channel's peak
        host: name or address to listen on
        port: to listen on; 0 takes any that is free
        browser: open the page in the browser
        out: write picture, pose, readings, path and settings of the view to a new folder instead, and end
    """
    shown, view = _opened(system, model, camera, vary, drive)
    if out is not None:
        from exosight.lab.saving import write_view

        with new_folder(out) as folder, waiting("solving; the first time on a machine compiles"):
            write_view(view, shown, folder)
        say(f"wrote {out}")
        return
    try:
        from exosight.lab.server import access, address_of, application, listen, server_of
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        raise InputError("lab needs Starlette and Uvicorn; run pip install 'exosight[lab]'") from None
    hosts, token = access(host)
    with listen(host, port) as listener:
        address = address_of(host, listener, token)
        say(f"exosight lab at {address} (Ctrl-C ends it)")
        if browser:
            threading.Timer(0.5, webbrowser.open, (address,)).start()
        server_of(application(shown, view, hosts, token)).run(sockets=[listener])


def _opened(
    system: str, model: Path | None, camera: CameraSettings, vary: tuple[str, ...], drive: tuple[float, ...]
) -> "tuple[LabSystem, View]":
    """The system, and the view that its page opens with; InputError for options that do not fit it."""
    from exosight.lab.system import open_system, stops_of

    shown = open_system(system, model)
    stops = stops_of(drive, len(shown.grids)) if drive else shown.start.drive
    view = View(shown.controls.parse(vary), stops, camera)
    shown.check(view)
    return shown, view
