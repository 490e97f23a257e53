"""A run of the closed loop as an answer that grows while it is worked out."""

import asyncio
import json
import threading
from collections.abc import AsyncIterator

from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from exosight.errors import ExosightError
from exosight.lab.closed_loop import Step, Stopped, run_trial
from exosight.lab.jobs import JobQueue
from exosight.lab.settings import LoopSettings
from exosight.lab.system import LabSystem

BUG = "a bug in exosight; please report it with what the terminal says"


class RunResponse(StreamingResponse):
    """The steps of a run, a line of JSON each; `error` in a line ends it early. It stops if nobody reads."""

    def __init__(self, settings: LoopSettings, lab: LabSystem, runs: JobQueue) -> None:
        super().__init__(self._lines(), media_type="application/x-ndjson")
        self._settings, self._lab, self._runs = settings, lab, runs
        self._steps: asyncio.Queue[Step | None] = asyncio.Queue()
        self._loop, self._gone = asyncio.get_running_loop(), threading.Event()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Run, and send."""
        self._job = self._runs.submit(self._run)
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._gone.set()
            self._job.cancel()

    async def _lines(self) -> AsyncIterator[bytes]:
        while (step := await self._steps.get()) is not None:
            yield json.dumps(step, allow_nan=False).encode() + b"\n"
        await self._job

    def _run(self) -> None:
        try:
            try:
                run_trial(self._settings, self._lab, self._tell)
            except ExosightError as error:
                self._tell({"error": str(error)})
            except Stopped:
                return
            except Exception:
                self._tell({"error": BUG})
                raise
            finally:
                self._tell(None)
        except Stopped:
            pass

    def _tell(self, step: Step | None) -> None:
        if self._gone.is_set():
            raise Stopped
        self._loop.call_soon_threadsafe(self._steps.put_nowait, step)
