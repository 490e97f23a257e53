"""The lab's systems, its server, run as users run it, and a client of it."""

from collections.abc import Callable, Iterator

import httpx
import pytest
from example_systems import THUMB, write_assisted_thumb
from lab_server import Address, served

from exosight.lab.security import LOOPBACK
from exosight.lab.server import application
from exosight.lab.system import LabSystem, open_system


@pytest.fixture(scope="session")
def lab() -> LabSystem:
    """The published system."""
    return open_system("published")


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
    with served(application(lab, lab.start, LOOPBACK, None)) as each:
        yield each


@pytest.fixture(scope="module")
def guarded_address(lab: LabSystem) -> Iterator[Address]:
    """The lab as it is bound elsewhere: with the token "secret"."""
    with served(application(lab, lab.start, None, "secret")) as each:
        yield each


@pytest.fixture(scope="module")
def thumb_address(thumb: LabSystem) -> Iterator[Address]:
    """The lab of a system file."""
    with served(application(thumb, thumb.start, LOOPBACK, None)) as each:
        yield each


@pytest.fixture(scope="module")
def assisted_address(assisted: LabSystem) -> Iterator[Address]:
    """The lab of a system of two channels."""
    with served(application(assisted, assisted.start, LOOPBACK, None)) as each:
        yield each


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
