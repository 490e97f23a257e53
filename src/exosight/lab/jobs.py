"""Work in threads: a queue for each kind of request, so that long ones do not delay short ones."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, ParamSpec, TypeVar

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request

WAITING = 64
"""Jobs that a queue takes, with those at work."""

P = ParamSpec("P")
R = TypeVar("R")


class JobQueue:
    """Jobs of one kind in threads of their own, in the order in which they come.

    name     of these jobs, in the sentence that refuses more
    threads  jobs at a time
    """

    def __init__(self, name: str, threads: int) -> None:
        self._name = name
        self._pool = ThreadPoolExecutor(threads)
        self._jobs: set[asyncio.Future[Any]] = set()

    def check(self) -> None:
        """Raises HTTPException 503 while it is full."""
        if len(self._jobs) >= WAITING:
            sentence = f"{self._name}: {len(self._jobs)} others are waiting; try again in some seconds"
            raise HTTPException(503, sentence, {"retry-after": "5"})

    def submit(self, job: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> asyncio.Future[R]:
        """The result to come. Cancelled before its turn, a job is not done; later, it is done for nobody."""
        future = asyncio.get_running_loop().run_in_executor(self._pool, partial(job, *args, **kwargs))
        self._jobs.add(future)
        future.add_done_callback(self._jobs.discard)
        return future

    async def do(self, request: Request, job: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """The result; ClientDisconnect as soon as whoever asked has gone. The body must have been read."""
        future = self.submit(job, *args, **kwargs)
        gone = asyncio.ensure_future(_disconnected(request))
        try:
            await asyncio.wait({future, gone}, return_when=asyncio.FIRST_COMPLETED)
            if not future.done():
                raise ClientDisconnect
            return future.result()
        finally:
            gone.cancel()
            future.cancel()

    def close(self) -> None:
        """Begin no other job."""
        self._pool.shutdown(wait=False, cancel_futures=True)


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
