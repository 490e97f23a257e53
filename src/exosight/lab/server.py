"""The addresses of the lab. Every answer follows from its request alone; work is done in threads (`jobs`).

Starlette and Uvicorn: parsing HTTP from strangers is no place for code of one's own. A WebSocket would keep a
session, of which there are none: a page has at most one view on its way, so that none is ever out of date.
"""

import asyncio
import json
import secrets
import socket
import traceback
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from exosight.errors import ExosightError, InputError
from exosight.lab.connections import BACKLOG, IDLE, LimitedConnection
from exosight.lab.controls import about
from exosight.lab.jobs import JobQueue
from exosight.lab.run_stream import BUG, RunResponse
from exosight.lab.saving import VIEW_FILES, path_csv
from exosight.lab.security import LOOPBACK, SecurityMiddleware, read_body
from exosight.lab.settings import LoopSettings, PathSettings, Settings, View, read_settings
from exosight.lab.system import LabSystem
from exosight.lab.uploads import LARGEST_UPLOAD, as_png, estimate
from exosight.lab.views import answer, compute_view, path_answer, path_of

_LARGEST_SETTINGS = 64 * 2**10  # bytes
_UPLOADS = 8
_KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}


@dataclass
class _Work:
    """What the addresses share.

    light    views of which little is to be solved, which wait for nothing else
    heavy    other views, paths and pictures
    runs     of the closed loop
    uploads  pictures that are in memory, at most
    ready    once all is compiled
    """

    light: JobQueue = field(default_factory=lambda: JobQueue("views", threads=1))
    heavy: JobQueue = field(default_factory=lambda: JobQueue("lab", threads=2))
    runs: JobQueue = field(default_factory=lambda: JobQueue("closed loop", threads=1))
    uploads: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(_UPLOADS))
    ready: "asyncio.Future[None] | None" = None

    async def queue(self, kind: JobQueue) -> JobQueue:
        """A queue, once all is compiled; HTTPException 503 if it is full."""
        assert self.ready is not None
        await asyncio.shield(self.ready)
        kind.check()
        return kind

    def close(self) -> None:
        """Begin no other job."""
        for queue in (self.light, self.heavy, self.runs):
            queue.close()


def application(lab: LabSystem, start: View, hosts: frozenset[str] | None, token: str | None) -> Starlette:
    """The lab as an ASGI application.

    lab     the system that it shows
    start   the view that pages open with
    hosts   names under which it may be asked; None: any
    token   that requests must show; None: none
    """
    work = _Work()

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        work.ready = work.light.submit(_warm_up, lab, start)
        yield
        work.close()

    async def page(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in _assets():
            raise HTTPException(404, "address: there is nothing here; open /")
        return Response(_assets()[name], media_type=_KINDS[name.rpartition(".")[2]])

    async def describe(_: Request) -> Response:
        return _json(about(lab, start))

    async def view(request: Request) -> Response:
        settings = await _settings(request, View, lab)
        queue = await work.queue(work.light if lab.is_light(settings) else work.heavy)
        return _json(await queue.do(request, _answer, settings, lab))

    async def path(request: Request) -> Response:
        return _json(await _path(request, await _settings(request, PathSettings, lab)))

    async def _path(request: Request, settings: PathSettings) -> dict[str, Any]:
        queue = await work.queue(work.heavy)
        cached, asked = await queue.do(request, lab.cached, settings.view), path_of(settings, lab)
        for drive in asked.parts():  # other requests come in between
            await queue.do(request, cached.at, drive)
        return await queue.do(request, path_answer, settings, asked, cached, lab)

    async def save(request: Request) -> Response:
        name = request.path_params["name"]
        if name == "path.csv":
            found = await _path(request, await _settings(request, PathSettings, lab))
            return _file(path_csv(found, lab).encode(), name)
        if name not in VIEW_FILES:
            raise HTTPException(404, f"save: expected {', '.join(VIEW_FILES)} or path.csv")
        settings = await _settings(request, View, lab)
        queue = await work.queue(work.light if lab.is_light(settings) else work.heavy)
        seen = await queue.do(request, compute_view, settings, lab)
        return _file(VIEW_FILES[name](seen, lab), name)

    async def picture(request: Request) -> Response:
        queue = await work.queue(work.heavy)
        async with work.uploads:
            data = await read_body(request, LARGEST_UPLOAD)
            return _json(await queue.do(request, estimate, data, lab.network))

    async def converted(request: Request) -> Response:
        queue = await work.queue(work.light)
        async with work.uploads:
            data = await read_body(request, LARGEST_UPLOAD)
            return Response(await queue.do(request, as_png, data), media_type="image/png")

    async def trial(request: Request) -> Response:
        settings = await _settings(request, LoopSettings, lab)
        return RunResponse(settings, lab, await work.queue(work.runs))

    app = Starlette(
        routes=[
            Route("/", page),
            Route("/api/about", describe),
            Route("/api/view", view, methods=["POST"]),
            Route("/api/path", path, methods=["POST"]),
            Route("/api/save/{name}", save, methods=["POST"]),
            Route("/api/estimate", picture, methods=["POST"]),
            Route("/api/png", converted, methods=["POST"]),
            Route("/api/trial", trial, methods=["POST"]),
            Route("/{name}", page),
        ],
        middleware=[Middleware(SecurityMiddleware, hosts=hosts, token=token)],
        exception_handlers={
            ExosightError: _wrong,
            HTTPException: _refused,
            ClientDisconnect: _gone,
            Exception: _bug,
        },
        lifespan=lifespan,
    )
    app.router.redirect_slashes = False
    return app


def _warm_up(lab: LabSystem, start: View) -> None:
    """Compile all that a view needs."""
    compute_view(start, lab)
    settings = PathSettings(start)
    path_answer(settings, path_of(settings, lab), lab.cached(start), lab)


async def _settings(request: Request, kind: type[Settings], lab: LabSystem) -> Settings:
    settings = read_settings(kind, await read_body(request, _LARGEST_SETTINGS, "application/json"))
    lab.check(settings)
    return settings


def _answer(settings: View, lab: LabSystem) -> dict[str, Any]:
    return answer(settings, compute_view(settings, lab), lab)


async def _wrong(_: Request, error: Exception) -> Response:
    return JSONResponse({"error": str(error)}, 400)


async def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    words = {404: "address: there is nothing here; open /", 405: "method: not one that this address knows"}
    detail = error.detail if ":" in error.detail else words.get(error.status_code, error.detail)
    return JSONResponse({"error": detail}, error.status_code, headers=error.headers)


async def _gone(_: Request, error: Exception) -> Response:
    return Response(status_code=499)  # nobody reads it


async def _bug(_: Request, error: Exception) -> Response:
    traceback.print_exception(error)
    return JSONResponse({"error": BUG}, 500)


def _json(values: Any) -> Response:
    return Response(json.dumps(values, allow_nan=False), media_type="application/json")


def _file(content: bytes, name: str) -> Response:
    headers = {"content-disposition": f'attachment; filename="exosight-{name}"'}
    return Response(content, media_type="application/octet-stream", headers=headers)


@cache
def _assets() -> dict[str, bytes]:
    """The page's files by name: nothing else can be asked for, however it is spelled."""
    folder = files("exosight.lab") / "page"
    return {
        file.name: file.read_bytes() for file in folder.iterdir() if file.name.rpartition(".")[2] in _KINDS
    }


def listen(host: str, port: int) -> socket.socket:
    """A socket that is listened on; port 0 takes any that is free.

    Raises InputError if the host is none of this machine's, or the port is taken.
    """
    listener = None
    try:
        family, *_, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        # Where the protocol is not named, asyncio leaves small parts to Nagle, which takes 40 ms an answer.
        listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)  # from here on, as the address is printed before the server has started
    except OSError as error:
        if listener is not None:
            listener.close()
        raise InputError(
            f"lab: {host}, port {port}: {error.strerror}; choose another --port or --host"
        ) from error
    return listener


def address_of(host: str, listener: socket.socket, token: str | None) -> str:
    """Where the page is to be opened."""
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{listener.getsockname()[1]}/" + (f"?token={token}" if token else "")


def access(host: str) -> tuple[frozenset[str] | None, str | None]:
    """Names under which a host may be asked, and the token that it demands; none on this machine alone."""
    if host in LOOPBACK:
        return LOOPBACK, None
    everywhere = host in ("", "0.0.0.0", "::")
    return None if everywhere else LOOPBACK | {host.lower()}, secrets.token_urlsafe(24)


def server_of(app: Starlette) -> uvicorn.Server:
    """Uvicorn, quiet and within limits; `run(sockets=[…])` serves until stopped, then cancels requests."""
    return uvicorn.Server(
        uvicorn.Config(
            app,
            http=LimitedConnection,
            ws="none",
            lifespan="on",
            log_level="critical",  # `_bug` prints what else it would; that requests are cancelled is no error
            access_log=False,
            server_header=False,
            backlog=BACKLOG,
            timeout_keep_alive=IDLE,
            timeout_graceful_shutdown=0,
        )
    )
