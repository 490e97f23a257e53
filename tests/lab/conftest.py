"""The lab's systems, its server, run as users run it, and a client of it."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import httpx
import pytest
from example_systems import THUMB, write_assisted_thumb

from exosight.lab.security import LOOPBACK
from exosight.lab.server import application, listen, server_of
from exosight.lab.system import LabSystem, open_system


@dataclass(frozen=True)
class Address:
    host: str
    port: int

    def __str__(self) -> str:
        return f"http://{self.host}:{self.port}"


def served(lab: LabSystem, hosts: frozenset[str] | None, token: str | None) -> Iterator[Address]:
    listener = listen("127.0.0.1", 0)
    server = server_of(application(lab, lab.start, hosts, token))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive(), "the server ended before it began"
        time.sleep(0.02)
    yield Address("127.0.0.1", listener.getsockname()[1])
    server.should_exit = True
    thread.join(60)  # what it was asked for last may still be worked out
    listener.close()
    assert not thread.is_alive()


@pytest.fixture(scope="session")
def lab() -> LabSystem:
    """The published system."""
    return open_system()


@pytest.fixture(scope="session")
def thumb() -> LabSystem:
    """A system file."""
    return open_system(str(THUMB))


@pytest.fixture(scope="session")
def assisted(tmp_path_factory: pytest.TempPathFactory) -> LabSystem:
    """A system file of two channels, in N and N m."""
    file = tmp_path_factory.mktemp("systems") / "assisted.toml"
    write_assisted_thumb(file)
    return open_system(str(file))


@pytest.fixture(scope="module")
def address(lab: LabSystem) -> Iterator[Address]:
    """The lab on loopback, without a token."""
    yield from served(lab, LOOPBACK, None)


@pytest.fixture(scope="module")
def guarded_address(lab: LabSystem) -> Iterator[Address]:
    """The lab as it is bound elsewhere: with the token "secret"."""
    yield from served(lab, None, "secret")


@pytest.fixture(scope="module")
def thumb_address(thumb: LabSystem) -> Iterator[Address]:
    """The lab of a system file."""
    yield from served(thumb, LOOPBACK, None)


@pytest.fixture(scope="module")
def assisted_address(assisted: LabSystem) -> Iterator[Address]:
    """The lab of a system of two channels."""
    yield from served(assisted, LOOPBACK, None)


@pytest.fixture(scope="module")
def client(address: Address) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=str(address), timeout=120) as each:
        yield each


@pytest.fixture
def alive(client: httpx.Client) -> Callable[[], None]:
    """Whatever was sent before, a proper request is still answered."""

    def check() -> None:
        answer = client.post("/api/view", json={"drive": [[2.4]]})
        assert answer.status_code == 200
        assert answer.json()["drive"] == [[2.4]]

    return check
