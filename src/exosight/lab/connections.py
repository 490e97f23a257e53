"""How many connections the lab keeps, and for how long; HTTP itself is for Uvicorn and h11 to parse.

A connection is authorised once a request on it has passed all checks (`security`). Until then it has
`DEADLINE`, and where there are too many such, the oldest is closed: they never take the place of one that is
authorised. On an authorised one `DEADLINE` holds for the head of every request, and for the rest of a body
when it is answered already; while a request is worked on, and between requests, there is time.

Uvicorn alone limits the time between requests, and the number of all connections, which anybody can exhaust;
Hypercorn limits the time for a head as well, but tells nobody apart either.
"""

import asyncio
import json
import sys
from typing import Any

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, H11Protocol
from uvicorn.server import ServerState

DEADLINE = 5.0
"""For an authorised request to come, and for the head of each [s]."""
AUTHORISED = 256
"""Authorised connections at a time; a browser opens up to six a page."""
OTHERS = 384
"""Others at a time; with the authorised ones, fewer than the 1024 files that a process may usually open."""
OTHERS_OF_ADDRESS = 256
"""The same from one address."""
BACKLOG = 100
"""Accepted in one go; fewer than `OTHERS_OF_ADDRESS`, so that none is closed before it is read."""
IDLE = 120
"""For the next request on a connection [s]. Longer than most clients keep one (HTTPX 5 s, Firefox 115 s):
where the server closes first, a request that is sent just then is lost."""


class LimitedConnection(H11Protocol):
    """One connection; requests on it find `authorise` in the state of their scope."""

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, {**app_state, "authorise": self._authorise}, _loop)
        self._authorised = False
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take it, and close the oldest of those that are not authorised if there are too many."""
        super().connection_made(transport)
        self._opened = self.loop.time()
        self._deadline = self.loop.call_later(DEADLINE, self._expire)
        others = [each for each in self._all() if not each._authorised]
        neighbours = [each for each in others if each._address == self._address]
        for some, limit in ((neighbours, OTHERS_OF_ADDRESS), (others, OTHERS)):
            if len(some) > limit:
                oldest = min(some, key=lambda each: each._opened)
                self.connections.discard(oldest)
                oldest.transport.abort()
                return

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        super().connection_lost(exc)
        self._set_deadline(False)

    def data_received(self, data: bytes) -> None:
        """Parse, and see to it that what has begun goes on."""
        super().data_received(data)
        if self._authorised:
            answered = self.cycle.response_complete
            begun = self.conn.their_state is not h11.IDLE or bool(self.conn.trailing_data[0])
            self._set_deadline(answered and begun)

    def send_400_response(self, msg: str) -> None:
        """Called by Uvicorn with an exception of h11."""
        status = getattr(sys.exception(), "error_status_hint", 400)
        self._refuse(status, f"request: {str(sys.exception())[:200]}")

    def _all(self) -> "list[LimitedConnection]":
        return [each for each in self.connections if isinstance(each, LimitedConnection)]

    @property
    def _address(self) -> str | None:
        return self.client and self.client[0]

    def _authorise(self) -> bool:
        """Authorise this connection unless there are too many that are."""
        if not self._authorised and sum(each._authorised for each in self._all()) < AUTHORISED:
            self._authorised = True
            self._set_deadline(False)
        return self._authorised

    def _set_deadline(self, wanted: bool) -> None:
        """Begin one if it is wanted and there is none; end it if not."""
        if wanted and self._deadline is None:
            self._deadline = self.loop.call_later(DEADLINE, self._expire)
        elif not wanted and self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _expire(self) -> None:
        if self.conn.trailing_data[0]:  # browsers connect in advance, and would take this for a later answer
            self._refuse(408, f"request: not there within {DEADLINE:g} s; send it again")
        self.transport.abort()  # whether or not anybody reads what was sent

    def _refuse(self, status: int, sentence: str) -> None:
        """Close it, with an answer if none has begun."""
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            body = json.dumps({"error": sentence}).encode()
            headers = [("content-type", "application/json"), ("content-length", str(len(body)))]
            response = h11.Response(
                status_code=status, headers=[*headers, ("connection", "close")], reason=STATUS_PHRASES[status]
            )
            if self.conn.our_state is h11.SEND_RESPONSE and self.scope["method"] == "HEAD":
                body = b""
            for event in (response, h11.Data(data=body), h11.EndOfMessage()):
                self.transport.write(self.conn.send(event) or b"")
        if self.cycle is not None:  # its request may still be at work
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        self.transport.close()
