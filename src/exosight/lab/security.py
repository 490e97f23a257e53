"""Who may ask, and how much: checks that stand before every request, and headers that go with every answer.

host      must be the one that is served: a page elsewhere whose name is made to point here (DNS rebinding)
          still sends its own
origin    of whatever sends must be this page
token     if there is one, in the address first, then in a cookie that scripts cannot read; connections on
          which it was shown have places of their own (`connections`)
body      no longer than allowed, and no slower
answers   nothing from elsewhere may run in the page, and nobody may frame it (content security policy)
"""

import asyncio
import secrets
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
"""Names of this machine that nobody else answers to."""

_COOKIE = "exosight_lab"
_SECONDS = 20.0  # for a body to arrive

_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class SecurityMiddleware:
    """Middleware that answers what may not pass itself.

    hosts   names that may be asked for; None: any, which only a token makes safe
    token   that every request must show; None: none is needed
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str] | None, token: str | None) -> None:
        self._app, self._hosts, self._token = app, hosts, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let pass, or refuse, one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        app = self._refusal(Request(scope)) or self._app
        await app(scope, receive, guarded)

    def _refusal(self, request: Request) -> Response | None:
        headers = request.headers
        if self._hosts is not None and _hostname(headers) not in self._hosts:
            return _refuse(
                421, "host: this address is not served here; open the one that exosight lab printed"
            )
        origin = headers.get("origin")
        if origin is not None and origin != f"{request.scope['scheme']}://{headers.get('host')}":
            return _refuse(403, "origin: requests from other pages are refused")
        if (
            headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none")
            and request.method != "GET"
        ):
            return _refuse(403, "origin: requests from other pages are refused")
        welcome = None
        if self._token is not None and not self._same(request.cookies.get(_COOKIE, "")):
            if not self._same(request.query_params.get("token", "")):
                return _refuse(401, "token: missing or wrong; open the address that exosight lab printed")
            welcome = RedirectResponse("/", status_code=303)
            welcome.set_cookie(_COOKIE, self._token, httponly=True, samesite="strict")
        authorise = request.scope.get("state", {}).get("authorise")
        if authorise is not None and not authorise():
            return _refuse(503, "lab: too many connections; close pages, or try again in some minutes")
        return welcome

    def _same(self, given: str) -> bool:
        return self._token is not None and secrets.compare_digest(given.encode(), self._token.encode())


def _hostname(headers: Headers) -> str | None:
    try:
        return urlsplit(f"//{headers.get('host', '')}").hostname
    except ValueError:  # an open bracket
        return None


def _refuse(status: int, sentence: str) -> Response:
    return JSONResponse({"error": sentence}, status)


async def read_body(request: Request, largest: int, kind: str | None = None) -> bytes:
    """The body of a request.

    largest   [bytes]
    kind      content type that it must have

    Raises HTTPException 413 if it is larger, 415 if it is of another kind, 408 if it does not come.
    """
    if kind is not None and request.headers.get("content-type", "").partition(";")[0].strip() != kind:
        raise HTTPException(415, f"request: expected the content type {kind}")
    too_large = HTTPException(413, f"request: expected at most {_size(largest)}; send less")
    if int(request.headers.get("content-length", 0)) > largest:
        raise too_large
    body = bytearray()
    try:
        async with asyncio.timeout(_SECONDS):
            async for part in request.stream():
                body += part
                if len(body) > largest:
                    raise too_large
    except TimeoutError:
        raise HTTPException(408, f"request: not there within {_SECONDS:g} s; send it again") from None
    return bytes(body)


def _size(count: int) -> str:
    return f"{count >> 20} MiB" if count >= 2**20 else f"{count >> 10} KiB"
