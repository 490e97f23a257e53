"""The solved designs of a chunk in the making: solving takes nearly all the time, so a stop keeps them."""

import io
import time
from pathlib import Path
from threading import Lock
from zipfile import BadZipFile

import numpy as np

from exosight.dataset.store import chunk_name
from exosight.errors import DataError
from exosight.files import read_file, replace_file
from exosight.mechanics.batched_continuation import Solutions

SAVE_SECONDS = 1.0
"""Time between two saves at least [s]; longer where a save takes more than a twentieth of it."""

_LARGEST = 2**30  # [bytes]


class SolvedDesigns:
    """A file beside the chunk with the equilibria of its finished designs, written anew now and then.

    job   the identity of the job, of which alone the file is read; a damaged file counts as none

    Its methods are those of `exosight.mechanics.batched_continuation.Kept`.
    """

    def __init__(self, folder: Path, chunk: int, job: str) -> None:
        self._path = (folder / chunk_name(chunk)).with_suffix(".npz")
        self._job, self._lock = job, Lock()
        self._numbers: list[int] = []
        self._next = time.monotonic() + SAVE_SECONDS

    def restore(self, found: Solutions) -> list[int]:
        """Fill the rows of the designs in the file, and return their places in the chunk."""
        try:
            content = read_file(self._path, _LARGEST, "expected solved designs")
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                values = {name: file[name] for name in ("job", "numbers", *_rows(found))}
        except (DataError, OSError, ValueError, KeyError, EOFError, MemoryError, BadZipFile):
            return []
        numbers, rows = values["numbers"], _rows(found)
        if (
            str(values["job"]) != self._job
            or numbers.ndim != 1
            or not set(numbers.tolist()) <= set(range(len(found.q)))
        ):
            return []
        for name, row in rows.items():
            shape = (len(numbers), *row.shape[1:])
            if (values[name].shape, values[name].dtype) != (shape, row.dtype):
                return []
        for name, row in rows.items():
            row[numbers] = values[name]
        self._numbers = numbers.tolist()
        return list(self._numbers)

    def finished(self, number: int, found: Solutions) -> None:
        """Take note of a design; DataError if it is time to save and the file cannot be written."""
        with self._lock:
            self._numbers.append(number)
            started = time.monotonic()
            if started >= self._next or len(self._numbers) == len(found.q):
                self._save(found)
                ended = time.monotonic()
                self._next = ended + max(SAVE_SECONDS, 20 * (ended - started))

    def remove(self) -> None:
        """Remove the file, once the chunk is whole."""
        self._path.unlink(missing_ok=True)

    def _save(self, found: Solutions) -> None:
        buffer, rows = io.BytesIO(), {name: row[self._numbers] for name, row in _rows(found).items()}
        np.savez(buffer, allow_pickle=False, job=self._job, numbers=self._numbers, **rows)
        replace_file(self._path, buffer.getvalue())


def _rows(found: Solutions) -> dict[str, np.ndarray]:
    """All that is kept of designs, by name, each with a row for a design."""
    names = (name for name in Solutions._fields if name not in ("snaps", "history"))
    rows = {name: getattr(found, name) for name in names}
    return rows | {f"history_{i}": memory for i, memory in enumerate(found.history)}
