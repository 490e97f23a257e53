"""Requests to the lab's application: addresses, methods, headers, settings and pictures."""

import asyncio
import json
import random
from pathlib import Path
from typing import Any

from benchmarks.fuzz import some_bytes, some_values
from benchmarks.fuzz.pictures import Picture
from exosight.errors import InputError
from exosight.lab.security import LOOPBACK
from exosight.lab.server import application
from exosight.lab.system import open_system

_SETTINGS = {
    "view": {
        "design": {"young": 300.0},
        "drive": [[1.0], [2.4]],
        "camera": {"shift_x": 0.0, "roll": 0.1, "zoom": 1.0, "corruption": "none"},
    },
    "path": {"view": {"drive": [[2.4]]}},
    "trial": {"view": {}, "target": 0.3, "steps": 3},
    "save/readings.csv": {"drive": [[2.4]]},
}
_PATHS = (
    *(
        "/",
        "/main.js",
        "/api/about",
        "/api/none",
        "//",
        "/../x",
        "/%2e%2e/x",
        "/\x1b[31m",
        "/é",
        "/" + "x" * 5000,
        "",
    ),
    *(f"/api/{name}" for name in (*_SETTINGS, "estimate", "save/picture.png", "save/../x")),
)
_PLAIN = [(b"host", b"localhost"), (b"content-type", b"application/json")]
_HEADERS = (
    *(
        (b"host", value)
        for value in (b"", b"evil.example", b"127.0.0.1:99999", b"[::1", b"localhost:8080", b"\xff")
    ),
    *(
        (b"origin", value)
        for value in (b"null", b"http://evil.example", b"http://localhost", b"\xff\xfe", b"http://[")
    ),
    *((b"cookie", value) for value in (b"exosight_lab=secret", b"exosight_lab=", b"=;" * 3000, b"\xff=\xff")),
    *((b"content-type", value) for value in (b"", b"text/plain", b"application/json;charset=utf-7", b"\x1b")),
    *((b"content-length", value) for value in (b"0", b"99999999999")),
    *((b"x", b"y" * 60_000), (b"transfer-encoding", b"chunked"), (b"range", b"bytes=0-")),
)


class Page:
    """Requests: answered, or refused with a sentence; a few settings are solved, most are refused."""

    def __init__(self, folder: Path) -> None:
        lab = open_system()
        self._loop = asyncio.new_event_loop()
        self._open = application(lab, lab.start, LOOPBACK, None)
        self._guarded = application(lab, lab.start, None, "secret")
        for app in (self._open, self._guarded):
            self._loop.run_until_complete(app.router.lifespan_context(app).__aenter__())
        self._picture = Picture(folder)
        for kind, settings in (*_SETTINGS.items(), ("trial", {"view": {}, "target": 0.3})):  # compiles
            scope, _ = self._request(random.Random(0))
            scope |= {"path": f"/api/{kind}", "method": "POST", "headers": _PLAIN}
            self._loop.run_until_complete(_ask(self._open, scope, json.dumps(settings).encode()))

    def __call__(self, draw: random.Random) -> None:
        """One request."""
        guarded = draw.random() < 0.2
        scope, body = self._request(draw)
        if guarded and draw.random() < 0.5:
            scope["query_string"] = draw.choice(
                (b"token=secret", b"token=", b"token=%ff", b"token=a&token=secret")
            )
        status, text = self._loop.run_until_complete(
            _ask(self._guarded if guarded else self._open, scope, body)
        )
        assert status < 500, f"status {status}: {text[:300]!r}"
        if status >= 400:
            raise InputError(
                json.loads(text)["error"] if text.startswith(b"{") else text.decode() or "refused"
            )

    def _request(self, draw: random.Random) -> tuple[dict[str, Any], bytes]:
        kind = draw.choice(list(_SETTINGS))
        path, method, body = f"/api/{kind}", "POST", b""
        headers = [*_PLAIN]
        match draw.randrange(10):
            case 0 | 1:
                path, method = (
                    draw.choice(_PATHS),
                    draw.choice(("GET", "HEAD", "POST", "PUT", "OPTIONS", "TRACE", "X")),
                )
            case 2 | 3:
                path, body = "/api/estimate", self._picture.content(draw)
            case _:
                values = some_values(json.loads(json.dumps(_SETTINGS[kind])), draw)
                body = json.dumps(values).encode()
                if draw.random() < 0.2:
                    body = some_bytes(body, draw)
        for _ in range(draw.choice((0, 0, 0, 1, 3))):
            headers.append(draw.choice(_HEADERS))
        if draw.random() < 0.1:
            del headers[draw.randrange(len(headers))]
        scope = {
            "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method,
            "scheme": "http", "path": path, "raw_path": path.encode(), "query_string": b"",
            "root_path": "", "headers": headers,
            "client": ("127.0.0.1", 9), "server": ("127.0.0.1", 80), "extensions": {},
        }  # fmt: skip
        return scope, body


async def _ask(app: Any, scope: dict[str, Any], body: bytes) -> tuple[int, bytes]:
    """Status and text of the answer."""
    status, parts, asked = 0, [], False

    async def receive() -> dict[str, Any]:
        nonlocal asked
        if asked:
            await asyncio.sleep(3600)  # the client stays
        asked = True
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: dict[str, Any]) -> None:
        nonlocal status
        if message["type"] == "http.response.start":
            status = message["status"]
        else:
            parts.append(message.get("body", b""))

    await app(scope, receive, send)
    return status, b"".join(parts)
