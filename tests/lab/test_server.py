"""What the server answers, and what it refuses: it stays up whatever is sent."""

import asyncio
import http.client
import io
import json
import random
import resource
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lab_requests import SETTINGS, UPLOADS, mutate, outcome
from lab_server import Address, served
from PIL import Image

from exosight.errors import InputError
from exosight.lab import connections, run_stream, security
from exosight.lab.pose_cache import PoseCache
from exosight.lab.security import LOOPBACK
from exosight.lab.server import access, address_of, application, listen
from exosight.lab.settings import View
from exosight.lab.system import LabSystem
from exosight.lab.uploads import LARGEST_UPLOAD
from exosight.lab.views import compute_view
from exosight.vision.ood_images import draw_ood_images

JSON = {"content-type": "application/json"}

TRICKS = (
    "/../pyproject.toml",
    "/%2e%2e/%2e%2e/etc/passwd",
    "/..%2fserver.py",
    "/page/index.html",
    "/style.css%00.html",
    "//etc/passwd",
    "/__init__.py",
    "/api",
    "/api/view/../../x",
    "/" + "a" * 8000,
)
GARBAGE = (
    b"\x00" * 100,
    b"GET / HTTP/9.9\r\n\r\n",
    b"A" * 100_000,
    b"POST /api/view HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -5\r\n\r\n",
)
STRANGERS = ({"origin": "http://evil.example"}, {"origin": "null"}, {"sec-fetch-site": "cross-site"})


@pytest.fixture
def impatient_address(lab: LabSystem, monkeypatch: pytest.MonkeyPatch) -> Iterator[Address]:
    """The lab with the token "secret"; what is not there soon does not come, and runs have one step."""
    monkeypatch.setattr(connections, "DEADLINE", 0.2)
    monkeypatch.setattr(security, "_SECONDS", 0.1)
    monkeypatch.setattr(run_stream, "run_trial", lambda settings, lab, tell: tell({"time": 0.0}))
    with served(application(lab, lab.start, LOOPBACK, "secret")) as address:
        yield address


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def sentence_of(answer: httpx.Response) -> str:
    assert set(answer.json()) == {"error"}
    assert "\n" not in answer.json()["error"]
    return answer.json()["error"]


def test_the_page_and_its_parts_are_served_from_here_alone(client: httpx.Client) -> None:
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for name in ("style.css", "main.js", "explore.js", "icon.svg"):
        assert client.get(f"/{name}").status_code == 200
        text = client.get(f"/{name}").text
        assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


def test_a_view_is_answered_with_picture_readings_guard_and_command(
    client: httpx.Client, lab: LabSystem
) -> None:
    told = client.post("/api/view", json={"drive": [[4.0], [2.4]]}).json()
    seen = compute_view(View(drive=((4.0,), (2.4,))), lab)
    net = float(seen.observation.readings[lab.schema.index("F_net")])
    assert told["readings"]["F_net"] == pytest.approx(net, abs=1e-5)
    assert told["command"] == "exosight lab --system published --drive 4 2.4"
    assert told["guard"]["state"] == "normal"
    assert client.post("/api/view", json={"drive": [[1], [0.5], [0.75]]}).json()["drive"] == [[0.75]]
    assert client.post("/api/view", json={}).json()["drive"] == []


def test_files_are_offered_for_saving(client: httpx.Client) -> None:
    picture = client.post("/api/save/picture.png", json={})
    image = cv2.imdecode(np.frombuffer(picture.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape == (128, 128)
    assert client.post("/api/save/readings.csv", json={}).text.startswith("sensor,unit,true")
    path = client.post("/api/save/path.csv", json={"sensor": "angle_1"}).text.splitlines()
    assert path[0] == "u [N],angle_1 [rad],way"
    assert len(path) == 1 + 41 + 41
    assert client.post("/api/save/other.exe", json={}).status_code == 404


def test_twenty_pages_at_once_each_get_their_own_view(client: httpx.Client, lab: LabSystem) -> None:
    wanted = [
        {"design": {"young": 200.0 + 5.0 * i}, "drive": [[round(0.05 * (29 + i), 2)]]} for i in range(20)
    ]

    def ask(view: dict[str, Any]) -> dict[str, Any]:
        return client.post("/api/view", json=view).json()

    with ThreadPoolExecutor(20) as pool:
        at_once = list(pool.map(ask, wanted))
    net = lab.schema.index("F_net")
    for view, told in list(zip(wanted, at_once, strict=True))[::4]:
        own = compute_view(
            View(view["design"], tuple(map(tuple, view["drive"]))), replace(lab, poses=PoseCache())
        )
        assert told["readings"]["F_net"] == pytest.approx(float(own.observation.readings[net]), abs=1e-5)
    assert len({told["readings"]["F_net"] for told in at_once}) == 20


def test_the_page_of_another_system_is_told_of_it(thumb_address: Any, thumb: LabSystem) -> None:
    with httpx.Client(base_url=str(thumb_address), timeout=120) as client:
        about = client.get("/api/about").json()
        assert about["system"] == "thumb"
        assert about["network"]["refusal"] == thumb.refusal
        told = client.post("/api/view", json={"drive": about["start"]["drive"]}).json()
        assert told["reading"] is None
        assert set(told["readings"]) == {each["name"] for each in about["sensors"]}
        assert client.post("/api/path", json={"sensor": "knuckle"}).json()["unloading"][-1][0] == -1
        refused = client.post("/api/trial", json={})
        assert refused.status_code == 400
        assert sentence_of(refused).startswith("measured: no estimates")


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_mutated_requests_are_answered_or_refused_in_a_sentence(
    impatient_address: Address, seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    outcome(impatient_address, mutate(random.Random(seed)))
    assert not caplog.records


def test_requests_that_are_not_mutated_are_answered(impatient_address: Address) -> None:
    sent: dict[str, Any] = {"headers": {"cookie": "exosight_lab=secret"}, "timeout": 60}
    for path, values in SETTINGS.items():
        assert httpx.post(f"{impatient_address}{path}", json=values, **sent).status_code == 200, path


def test_a_picture_is_estimated_and_an_unlike_one_is_told(client: httpx.Client, lab: LabSystem) -> None:
    told = client.post("/api/estimate", content=png(compute_view(lab.start, lab).image)).json()
    shown = client.post("/api/view", json={"drive": lab.start.drive}).json()
    assert told["reading"]["estimates"] == shown["reading"]["estimates"]
    assert told["reading"]["ood_score"] < 1
    strange = client.post("/api/estimate", content=png(draw_ood_images("text", 1, 0)[0])).json()
    assert strange["reading"]["ood_score"] > 1
    assert strange["guard"]["state"] == "hold"


def test_pictures_of_a_wrong_shape_or_size_are_refused(
    client: httpx.Client, alive: Callable[[], None]
) -> None:
    flat = client.post("/api/estimate", content=png(np.zeros((128, 300), np.uint8)))
    assert "expected a square picture" in sentence_of(flat)
    bomb = Image.new("1", (9000, 9000))  # ten kilobytes of PNG, 81 million pixels
    bomb.save(buffer := io.BytesIO(), "PNG")
    for address in UPLOADS:
        answer = client.post(address, content=buffer.getvalue())
        assert answer.status_code == 400
        assert "9000×9000 pixels" in sentence_of(answer)
    for address in UPLOADS:
        oversized = client.post(address, content=b"\x89PNG" + bytes(LARGEST_UPLOAD))
        assert oversized.status_code == 413
        assert "at most 8 MiB" in sentence_of(oversized)
    assert client.post("/api/view", content=b" " * 100_000, headers=JSON).status_code == 413
    alive()


@pytest.mark.parametrize("path", TRICKS)
def test_paths_lead_nowhere_else(
    client: httpx.Client, address: Any, path: str, alive: Callable[[], None]
) -> None:
    # By hand: a client would tidy the path up.
    with socket.create_connection((address.host, address.port), timeout=20) as line:
        line.sendall(f"GET {path} HTTP/1.1\r\nHost: {address.host}\r\nConnection: close\r\n\r\n".encode())
        answer = b"".join(iter(lambda: line.recv(65536), b""))
    assert answer.split(b" ")[1] in (b"404", b"400", b"307")
    assert b"root:" not in answer
    alive()


@pytest.mark.parametrize("garbage", GARBAGE)
def test_what_is_no_http_does_not_stop_it(address: Any, garbage: bytes, alive: Callable[[], None]) -> None:
    with socket.create_connection((address.host, address.port), timeout=20) as line:
        try:
            line.sendall(garbage)
            line.shutdown(socket.SHUT_WR)
            answer = line.recv(65536)
        except ConnectionError:  # it has hung up already
            answer = b""
    assert b" 200 " not in answer
    alive()


@pytest.mark.parametrize(
    ("method", "path", "status"), [("GET", "/api/view", 405), ("DELETE", "/", 405), ("GET", "/api/none", 404)]
)
def test_unknown_addresses_and_methods_are_refused(
    client: httpx.Client, method: str, path: str, status: int
) -> None:
    answer = client.request(method, path)
    assert answer.status_code == status
    assert sentence_of(answer)


def test_settings_come_as_json_or_not_at_all(client: httpx.Client) -> None:
    assert client.post("/api/view", content=b"{}", headers={"content-type": "text/plain"}).status_code == 415


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8765", "127.0.0.1.evil.example", "[::1", "", "@"]
)
def test_names_that_are_not_this_machine_are_refused(client: httpx.Client, host: str) -> None:
    assert client.get("/", headers={"host": host}).status_code in (400, 421)


@pytest.mark.parametrize("headers", STRANGERS)
def test_other_pages_may_not_ask(client: httpx.Client, headers: dict[str, str]) -> None:
    answer = client.post("/api/view", json={}, headers=headers)
    assert answer.status_code == 403
    assert "other pages" in sentence_of(answer)


def test_elsewhere_a_token_is_demanded(guarded_address: Any) -> None:
    with httpx.Client(base_url=str(guarded_address)) as stranger:
        for path in ("/", "/main.js", "/api/about", "/?token=", "/?token=wrong", "/?token=sécret"):
            assert stranger.get(path).status_code == 401
        stranger.cookies.set("exosight_lab", "wrong")
        assert stranger.get("/").status_code == 401
    with httpx.Client(base_url=str(guarded_address)) as guest:
        welcome = guest.get("/?token=secret")
        assert welcome.status_code == 303
        assert "HttpOnly" in welcome.headers["set-cookie"]
        assert "SameSite=strict" in welcome.headers["set-cookie"]
        assert guest.get("/api/about").status_code == 200


def test_half_open_connections_keep_no_one_out_who_shows_the_token(guarded_address: Any) -> None:
    """More of them than the server keeps, and twice as many open files as a process may usually have."""
    files, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, most), most))
    place = (guarded_address.host, guarded_address.port)
    with ExitStack() as stack:
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (files, most))
        for _ in range(520):
            line = stack.enter_context(socket.create_connection(place, timeout=20))
            line.sendall(b"POST /api/view HTTP/1.1\r\nHost: lab\r\nContent-")
        with httpx.Client(base_url=str(guarded_address), timeout=120) as guest:
            guest.cookies.set("exosight_lab", "secret")
            answer = guest.post("/api/view", json={"drive": [[2.4]]})
            assert answer.json()["drive"] == [[2.4]]


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("view", b"Content-Length: 1000000000000\r\n\r\n{", 413),
        ("estimate", b"Content-Length: 8388609\r\n\r\n", 413),
        ("path", b"Transfer-Encoding: chunked\r\n\r\n10001\r\n" + b" " * 0x10001 + b"\r\n", 413),
        ("trial", b"Content-Length: 2\r\n\r\n{", 408),
        ("estimate", b"Transfer-Encoding: chunked\r\n\r\n1\r\nx\r\n", 408),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_body_that_is_too_long_or_too_slow_is_refused_before_its_end(
    address: Any, monkeypatch: pytest.MonkeyPatch, path: str, body: bytes, status: int
) -> None:
    if status == 408:
        monkeypatch.setattr(security, "_SECONDS", 0.1)
    head = f"POST /api/{path} HTTP/1.1\r\nHost: {address.host}\r\nContent-Type: application/json\r\n"
    with socket.create_connection((address.host, address.port), timeout=60) as line:
        line.sendall(head.encode() + body)
        answer = http.client.HTTPResponse(line)
        answer.begin()
        assert answer.status == status
        assert set(json.load(answer)) == {"error"}


def test_only_this_machine_is_open_without_a_token() -> None:
    assert access("127.0.0.1") == (LOOPBACK, None)
    names, token = access("192.0.2.7")
    assert names == LOOPBACK | {"192.0.2.7"}
    assert token is not None
    assert len(token) >= 32
    assert access("0.0.0.0")[0] is None
    assert access("0.0.0.0")[1] != access("0.0.0.0")[1]


def test_the_address_is_printed_with_its_token_and_a_taken_port_is_refused() -> None:
    with listen("127.0.0.1", 0) as listener:
        port = listener.getsockname()[1]
        assert address_of("127.0.0.1", listener, None) == f"http://127.0.0.1:{port}/"
        assert address_of("::1", listener, "abc") == f"http://[::1]:{port}/?token=abc"
        with pytest.raises(InputError, match="choose another --port"):
            listen("127.0.0.1", port)
    with pytest.raises(InputError, match="choose another"):
        listen("no.such.host.invalid", 0)


def test_small_answers_leave_at_once() -> None:
    """Nagle's algorithm and delayed acknowledgement together make every answer 40 ms late."""

    async def set_on_a_connection() -> int:
        accepted: asyncio.Future[asyncio.StreamWriter] = asyncio.get_running_loop().create_future()
        listener = listen("127.0.0.1", 0)
        async with await asyncio.start_server(lambda _, writer: accepted.set_result(writer), sock=listener):
            _, client = await asyncio.open_connection(*listener.getsockname())
            server = await accepted
            found = server.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            client.close()
            server.close()
        return found

    assert asyncio.run(set_on_a_connection())


def test_pages_that_leave_in_the_middle_do_no_harm(address: Any, alive: Callable[[], None]) -> None:
    body = json.dumps({"view": {"design": {"young": 222}, "drive": [[4.0]]}}).encode()
    head = f"POST /api/path HTTP/1.1\r\nHost: {address.host}\r\nContent-Type: application/json\r\n"

    def ask_and_leave() -> None:
        with socket.create_connection((address.host, address.port), timeout=20) as line:
            line.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)

    threads = [threading.Thread(target=ask_and_leave) for _ in range(10)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    alive()
