"""Requests to the lab that are mutated in head and body, and what has to become of them."""

import http.client
import io
import json
import random
import re
import socket
from collections.abc import Sequence

from lab_server import Address
from PIL import Image

GUARD = 60
"""Time that one request may take [s]."""

_VIEW = {
    "design": {"young": 222.0, "family": "sine", "r0": 8.0},
    "drive": [[4.0], [2.4]],
    "camera": {"shift_x": 0.1, "roll": 0.05, "zoom": 1.1, "corruption": "blur"},
}
_PLAIN = {"view": {"drive": [[2.4]]}, "channel": "u", "sensor": "F_net"}
_LOOP = {"target": 0.3, "law": "proportional", "gain": 5.0, "measured": "true", "disturbance": "lost"}
SETTINGS = {
    "/api/view": _VIEW,
    "/api/path": _PLAIN,
    "/api/trial": _PLAIN | _LOOP,
    "/api/save/picture.png": {"drive": [[2.4]]},
    "/api/save/readings.csv": _VIEW,
    "/api/save/path.csv": _PLAIN,
}
UPLOADS = ("/api/estimate", "/api/png")
PATHS = (*SETTINGS, "/", "/main.js", "/api/about", *UPLOADS, "/?token=secret")

_VALUES = (
    *("NaN", "-Infinity", "1e400", "-1", "0", "-0.0", "1e-320", "1e9", "9" * 400, "9" * 5000, "true", "null"),
    *("[]", "{}", '""', '"u"', '"\\u0000"', '"\\ud800"', '"\\u001b[31m"', f'"{"x" * 9000}"', '"../../etc"'),
    *("[" * 3000, '{"a":' * 3000, f"[{'[2.4],' * 70}[2.4]]", "[[[[1]]]]", '{"x": 1, "x": 2}'),
)  # fmt: skip
_JSON = re.compile(rb'"[^"]*"|-?\d+\.?\d*|[\[\]{}:,]')
_HEADS = (
    *("Host: elsewhere", "Host: [::1", "Host:", "Host: 127.0.0.1\r\nHost: b", "Origin: http://elsewhere"),
    *("Origin: null", "Sec-Fetch-Site: cross-site", "Cookie: exosight_lab=wrong", "Cookie: =\xe9"),
    *("Content-Type: text/plain", "Content-Type: application/json; charset=utf-16", "Content-Encoding: gzip"),
    *("Content-Length: 1e3", "Content-Length: -1", "Content-Length: 99999999999", "Content-Length: 1, 1"),
    *("Transfer-Encoding: chunked", "Transfer-Encoding: gzip, chunked", "Expect: 100-continue"),
    *("Cookie: =;;=", "Upgrade: websocket", "Connection: upgrade", "Connection: close", "Range: bytes=5-"),
    *("X: " + "x" * 5000, " folded", "no colon", "\x00: 1"),
)  # fmt: skip
_METHODS = ("GET", "POST", "HEAD", "PUT", "DELETE", "OPTIONS", "CONNECT", "TRACE", "get", "A" * 300, "")
_TARGETS = (
    "/api/view/",
    "/api//view",
    "/../etc/passwd",
    "/%00",
    "/%ff",
    "*",
    "http://[/",
    "//x",
    "/?" + "a=" * 900,
)


def mutate(draw: random.Random) -> bytes:
    """A request of HTTP/1.1 after none to four changes of its body and its head."""
    path = draw.choice(PATHS)
    body = _picture(draw) if path in UPLOADS else json.dumps(SETTINGS.get(path, {})).encode()
    for _ in range(draw.choice((0, 1, 1, 1, 2, 4))):
        body = draw.choice((_bytes, _cut, _rest, _value, _value, _tokens))(body, draw)
    method = "GET" if path in ("/", "/main.js", "/api/about", "/?token=secret") else "POST"
    heads = ["Host: 127.0.0.1", "Cookie: exosight_lab=secret", "Content-Type: application/json"]
    heads.append(f"Content-Length: {len(body)}")
    for _ in range(draw.choice((0, 0, 0, 1, 2))):
        change = draw.randrange(5)
        if change == 0:
            method = draw.choice(_METHODS)
        elif change == 1:
            path = draw.choice(_TARGETS)
        elif change == 2:
            heads.insert(draw.randint(0, len(heads)), draw.choice(_HEADS))
        elif change == 3:
            heads[draw.randrange(len(heads))] = draw.choice(_HEADS)
        else:
            heads.pop(draw.randrange(len(heads)))
            heads.append("Transfer-Encoding: chunked")
            body = _chunked(body, draw)
    head = "\r\n".join([f"{method} {path} HTTP/1.1", *heads, "", ""]).encode("latin-1")
    return _bytes(head + body, draw) if draw.random() < 0.1 else head + body


def outcome(address: Address, request: bytes) -> str:
    """ "answered", the status of a refusal, or "closed"; AssertionError unless refused in one sentence."""
    method = request.partition(b" ")[0].decode("latin-1")
    with socket.create_connection((address.host, address.port), timeout=GUARD) as line:
        try:
            line.sendall(request)
            answer = http.client.HTTPResponse(line, method=method)
            answer.begin()
            body = answer.read()
        except (ConnectionError, http.client.BadStatusLine):  # it has hung up on what it could not answer
            return "closed"
    if answer.status < 400:
        return "answered"
    assert answer.status in (400, 401, 403, 404, 405, 408, 413, 415, 421, 431, 501, 503), (
        answer.status,
        request,
    )
    if method != "HEAD":
        found = json.loads(body)
        assert set(found) == {"error"}, request
        assert found["error"].isprintable(), (found, request)
        assert len(found["error"]) < 1000, (found, request)
    return str(answer.status)


def _bytes(content: bytes, draw: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(draw.randint(1, 4)):
        if changed:
            changed[draw.randrange(len(changed))] = draw.randrange(256)
    return bytes(changed)


def _cut(content: bytes, draw: random.Random) -> bytes:
    return content[: draw.randint(0, len(content))]


def _rest(content: bytes, draw: random.Random) -> bytes:
    """Anything behind the first bytes, which tell the kind of a picture."""
    return content[: draw.choice((0, 4, 8))] + draw.randbytes(draw.randint(0, 300))


def _value(content: bytes, draw: random.Random) -> bytes:
    return _replaced(content, draw, draw.choice(_VALUES).encode())


def _tokens(content: bytes, draw: random.Random) -> bytes:
    found = _JSON.findall(content)
    return _replaced(content, draw, draw.choice(found)) if found else content


def _replaced(content: bytes, draw: random.Random, new: bytes) -> bytes:
    found: Sequence[re.Match[bytes]] = list(_JSON.finditer(content))
    if not found:
        return content + new
    one = draw.choice(found)
    return content[: one.start()] + new + content[one.end() :]


def _chunked(content: bytes, draw: random.Random) -> bytes:
    parts = [content[i : i + 50] for i in range(0, min(len(content), 1000), 50)]
    sizes = [draw.choice((b"%x" % len(part), b"%x" % len(part), b"-1", b"fffffffff", b"")) for part in parts]
    return b"".join(b"%s\r\n%s\r\n" % each for each in zip(sizes, parts, strict=True)) + b"0\r\n\r\n"


def _picture(draw: random.Random) -> bytes:
    image = Image.linear_gradient("L").resize((draw.choice((1, 128, 200)), 128))
    image.save(buffer := io.BytesIO(), draw.choice(("PNG", "JPEG", "TIFF", "BMP", "GIF", "WEBP")))
    return buffer.getvalue()
