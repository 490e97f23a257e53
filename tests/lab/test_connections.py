"""How many connections the server keeps, and for how long, whoever opens them."""

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import httpx
import pytest
from lab_server import Address, served
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from exosight.lab import connections
from exosight.lab.security import SecurityMiddleware
from exosight.lab.server import server_of

HALF = b"GET / HTTP/1.1\r\nHost: lab\r\n"
SHOWN = HALF + b"Cookie: exosight_lab=secret\r\n"
GUARD = 60
"""Seconds after which a test that hangs fails."""


@pytest.fixture
def app() -> Starlette:
    """A page that demands the token "secret"."""

    async def page(_: Request) -> PlainTextResponse:
        return PlainTextResponse("here")

    security = Middleware(SecurityMiddleware, hosts=None, token="secret")
    return Starlette(routes=[Route("/", page, methods=["GET", "POST"])], middleware=[security])


@pytest.fixture
def here(app: Starlette) -> Iterator[Address]:
    with served(app) as address:
        yield address


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "DEADLINE", 0.1)


def opened(here: Address, sent: bytes, source: str = "127.0.0.1") -> socket.socket:
    line = socket.create_connection((here.host, here.port), timeout=GUARD, source_address=(source, 0))
    line.sendall(sent)
    return line


def answer(line: socket.socket) -> tuple[int, str]:
    """Status and body of the next answer, which tells its length."""
    stream = line.makefile("rb")
    status = int(stream.readline().split()[1])
    headers = dict(each.strip().lower().split(b": ", 1) for each in iter(stream.readline, b"\r\n"))
    return status, stream.read(int(headers[b"content-length"])).decode()


def is_closed(line: socket.socket) -> bool:
    """Waits until the other side closes."""
    try:
        return line.recv(1) == b""
    except ConnectionResetError:
        return True


def test_a_head_that_does_not_end_is_refused_and_its_connection_closed(here: Address, soon: None) -> None:
    with opened(here, HALF) as line:
        status, body = answer(line)
        assert status == 408
        assert json.loads(body)["error"].startswith("request: not there within")
        assert is_closed(line)


def test_a_connection_on_which_nothing_is_sent_is_closed_without_a_word(here: Address, soon: None) -> None:
    with opened(here, b"") as line:
        assert is_closed(line)


def test_a_wrong_token_does_not_prolong_a_connection(here: Address, soon: None) -> None:
    with opened(here, HALF + b"Cookie: exosight_lab=wrong\r\n\r\n") as line:
        assert answer(line)[0] == 401
        assert is_closed(line)


def test_an_authorised_connection_may_rest_but_not_stop_within_a_head(here: Address, soon: None) -> None:
    with opened(here, SHOWN + b"\r\n") as line:
        assert answer(line) == (200, "here")
        with opened(here, b"") as other:
            assert is_closed(other)  # the time of a connection that sends nothing is over
        line.sendall(SHOWN + b"\r\n")
        assert answer(line) == (200, "here")
        line.sendall(HALF)
        assert answer(line)[0] == 408
        assert is_closed(line)


def test_a_body_that_is_answered_already_has_little_time_left(here: Address, soon: None) -> None:
    head = SHOWN.replace(b"GET", b"POST") + b"Content-Length: 100\r\n\r\n"
    with opened(here, head) as line:
        assert answer(line) == (200, "here")
        line.sendall(b"part")
        assert is_closed(line)
    with opened(here, head) as line:
        assert answer(line) == (200, "here")
        line.sendall(b"x" * 100 + SHOWN + b"\r\n")  # all of it, and another request
        assert answer(line) == (200, "here")


def test_the_oldest_unauthorised_connection_of_an_address_makes_room(
    here: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "OTHERS_OF_ADDRESS", 3)
    with ExitStack() as stack:
        first = stack.enter_context(opened(here, SHOWN + b"\r\n"))
        assert answer(first) == (200, "here")
        elsewhere = stack.enter_context(opened(here, HALF, source="127.0.0.2"))
        lines = [stack.enter_context(opened(here, HALF)) for _ in range(4)]
        assert is_closed(lines[0])
        for line in (*lines[1:], elsewhere):
            line.sendall(b"Cookie: exosight_lab=secret\r\n\r\n")
            assert answer(line) == (200, "here")
        first.sendall(SHOWN + b"\r\n")
        assert answer(first) == (200, "here")


def test_the_oldest_unauthorised_connection_of_all_makes_room(
    here: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "OTHERS", 3)
    with ExitStack() as stack:
        lines = [stack.enter_context(opened(here, HALF, source=f"127.0.0.{2 + i}")) for i in range(4)]
        assert is_closed(lines[0])
        lines[1].sendall(b"Cookie: exosight_lab=secret\r\n\r\n")
        assert answer(lines[1]) == (200, "here")


def test_too_many_authorised_connections_are_told_so(here: Address, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "AUTHORISED", 1)
    with opened(here, SHOWN + b"\r\n") as first, opened(here, SHOWN + b"\r\n") as second:
        assert sorted((answer(first)[0], answer(second)[0])) == [200, 503]


def test_what_is_no_http_is_refused_in_a_sentence(here: Address, caplog: pytest.LogCaptureFixture) -> None:
    for sent, status in (
        (b"\x00" * 100 + b"\r\n\r\n", 400),
        (HALF + b"Content-Length: -5\r\n\r\n", 400),
        (HALF + b"A: " + b"a" * 20_000, 431),
        (HALF + b"Transfer-Encoding: gzip\r\n\r\n", 501),
        (HALF + b"Transfer-Encoding: chunked\r\n\r\nno chunk\r\n", 400),
    ):
        with opened(here, sent) as line:
            found, body = answer(line)
            assert found == status, sent[:80]
            assert "\n" not in json.loads(body)["error"]
            assert is_closed(line)
    with opened(here, HALF + b"Transfer-Encoding: chunked\r\n\r\n") as line:
        assert answer(line)[0] == 401
        line.sendall(b"no chunk\r\n")
        assert is_closed(line)
    with opened(
        here, HALF.replace(b"GET", b"HEAD") + b"Transfer-Encoding: chunked\r\n\r\nno chunk\r\n"
    ) as line:
        assert line.makefile("rb").read().startswith(b"HTTP/1.1 400 ")
    assert not caplog.records


def test_clients_give_an_idle_connection_up_before_the_server_does(app: Starlette) -> None:
    kept = server_of(app).config.timeout_keep_alive
    default: Any = httpx.Limits().keepalive_expiry
    assert kept > 10 * default
