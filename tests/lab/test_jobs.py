"""Heavy requests wait for each other, light ones for neither; whoever leaves is not worked for."""

import asyncio
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from typing import Any

import httpx
import pytest
from lab_server import Address, served
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request

from exosight.lab import jobs, run_stream, server
from exosight.lab.closed_loop import Step
from exosight.lab.jobs import JobQueue
from exosight.lab.pose_cache import PoseCache
from exosight.lab.security import LOOPBACK
from exosight.lab.settings import LoopSettings, View
from exosight.lab.system import LabSystem

GUARD = 60
"""Seconds after which a test that hangs fails."""
NEW = {"design": {"young": 222.0}}


@dataclass
class Blocked:
    """Heavy work that goes on until it is released."""

    released: threading.Event = field(default_factory=threading.Event)
    begun: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    runs: list[str] = field(default_factory=list)

    def work(self, *_: Any) -> dict[str, Any]:
        self.begun.release()
        assert self.released.wait(2 * GUARD)
        return {}

    def view(self, settings: View, _: LabSystem) -> dict[str, Any]:
        return self.work() if settings.design else {"light": True}

    def run(self, settings: LoopSettings, lab: LabSystem, tell: Callable[[Step], None]) -> None:
        self.runs.append("begun")
        self.work()
        self.runs.append("ended")


@pytest.fixture
def blocked(monkeypatch: pytest.MonkeyPatch) -> Iterator[Blocked]:
    heavy = Blocked()
    monkeypatch.setattr(server, "_warm_up", lambda *_: None)
    monkeypatch.setattr(server, "_answer", heavy.view)
    monkeypatch.setattr(server, "estimate", heavy.work)
    monkeypatch.setattr(run_stream, "run_trial", heavy.run)
    yield heavy
    heavy.released.set()


@pytest.fixture
def here(blocked: Blocked, lab: LabSystem) -> Iterator[Address]:
    fresh = replace(lab, poses=PoseCache())
    fresh.cached(View())  # a view of any other design is heavy
    with served(server.application(fresh, lab.start, LOOPBACK, None)) as address:
        yield address
        blocked.released.set()


def ask(here: Address, path: str, **sent: Any) -> httpx.Response:
    return httpx.post(f"{here}/api/{path}", timeout=GUARD, **sent)


def test_a_light_view_is_answered_while_fifty_heavy_requests_wait(here: Address, blocked: Blocked) -> None:
    heavy = [("estimate", {"content": b"x"}), ("view", {"json": NEW}), ("trial", {"json": {}})]
    with ThreadPoolExecutor(50) as pool:
        asked = [pool.submit(ask, here, heavy[i % 3][0], **heavy[i % 3][1]) for i in range(50)]
        for _ in range(3):  # two at a time, and one run
            assert blocked.begun.acquire(timeout=GUARD)
        assert ask(here, "view", json={}).json() == {"light": True}
        assert not any(each.done() for each in asked)
        blocked.released.set()
        wait(asked, GUARD)
    assert {each.result().status_code for each in asked} == {200}


def test_a_full_queue_says_when_to_try_again(
    here: Address, blocked: Blocked, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "WAITING", 2)
    with ThreadPoolExecutor(2) as pool:
        asked = [pool.submit(ask, here, "estimate", content=b"x") for _ in range(2)]
        for _ in asked:
            assert blocked.begun.acquire(timeout=GUARD)
        for path, sent in (("estimate", {"content": b"x"}), ("view", {"json": NEW}), ("path", {"json": {}})):
            refused = ask(here, path, **sent)
            assert refused.status_code == 503
            assert int(refused.headers["retry-after"]) > 0
            assert refused.json() == {"error": "lab: 2 others are waiting; try again in some seconds"}
        blocked.released.set()
    assert ask(here, "view", json=NEW).status_code == 200


def test_runs_whose_pages_have_left_keep_no_more_threads(here: Address, blocked: Blocked) -> None:
    for _ in range(8):
        with httpx.stream("POST", f"{here}/api/trial", json={}, timeout=GUARD) as left:
            assert left.status_code == 200
    with ThreadPoolExecutor(1) as pool:
        stays = pool.submit(ask, here, "trial", json={})
        assert ask(here, "view", json={}).json() == {"light": True}
        blocked.released.set()
        assert stays.result(GUARD).status_code == 200
    assert blocked.runs == ["begun", "ended"] * (len(blocked.runs) // 2)


def test_a_request_whose_page_has_left_gives_its_place_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "WAITING", 2)
    done: list[str] = []
    release = threading.Event()

    async def leave() -> None:
        queue, left = JobQueue("lab", threads=1), asyncio.Event()

        async def receive() -> dict[str, str]:
            await left.wait()
            return {"type": "http.disconnect"}

        first = queue.submit(release.wait, GUARD)
        second = asyncio.create_task(queue.do(Request({"type": "http"}, receive), done.append, "second"))
        await asyncio.sleep(0)
        with pytest.raises(HTTPException, match="503: lab: 2 others are waiting"):
            queue.check()
        left.set()
        with pytest.raises(ClientDisconnect):
            await second
        queue.check()
        third = queue.submit(done.append, "third")
        release.set()
        await first
        await third
        queue.close()

    asyncio.run(leave())
    assert done == ["third"]
