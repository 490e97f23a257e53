"""`exosight lab`: a local page of sliders."""

import threading
import webbrowser
from typing import Annotated

import tyro
from pydantic import Field

from exosight.app.commands.options import MaybePath
from exosight.app.console import say, waiting
from exosight.app.output import new_folder
from exosight.errors import InputError
from exosight.lab.settings import View, shape_of

DEFAULT = View()


def lab(
    view: Annotated[View, tyro.conf.arg(name="")] = DEFAULT,
    host: str = "127.0.0.1",
    port: Annotated[int, Field(ge=0, le=65535)] = 8765,
    browser: bool = True,
    out: MaybePath = None,
) -> None:
    """Open a page on which sliders move an exosuit, its picture and its forces, and a closed loop runs.

    Needs the extra 'lab', but no network: the page is served by this machine, to this machine. Bound to any
    other host it demands a token, which is part of the address that is printed.

    Examples:
      exosight lab
      exosight lab --family sine --parameters 0.008 -5 --drive 4 2.4
      exosight lab --drive 2.4 --out results/view

    Args:
        view: what the page opens with
        host: name or address to listen on
        port: to listen on; 0 takes any that is free
        browser: open the page in the browser
        out: write picture, forces, path and settings of the view to a new folder instead, and end
    """
    shape_of(view)
    if out is not None:
        from exosight.lab.saving import write_view

        with new_folder(out) as folder, waiting("solving; the first time on a machine compiles"):
            write_view(view, folder)
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
        try:
            server_of(application(view, hosts, token)).run(sockets=[listener])
        except KeyboardInterrupt:
            say("lab ended")
